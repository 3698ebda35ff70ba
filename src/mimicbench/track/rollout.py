"""Run a trained tracker over whole clips, from the first frame, and judge each by K and P."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from mimicbench.core import rotations as rot
from mimicbench.core.motion import RobotMotion
from mimicbench.core.seeds import rng
from mimicbench.envs.judge import Judge
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.sim.backends import make_physics
from mimicbench.sim.devices import tensor_device
from mimicbench.sim.scene import CONTROL_DT
from mimicbench.tasks.task import Task
from mimicbench.track.checkpoint import Tracker
from mimicbench.track.reference import ReferenceBank
from mimicbench.track.tracker import Moment

SETTLE = 1.0
"""[s] that an episode goes on, standing on the clip's last frame, after the clip is over."""


@dataclass(frozen=True)
class Rollout:
    """What happened on C clips."""

    judge: Judge
    steps: np.ndarray
    """(C,) control steps until the episode ended."""
    qpos: list[np.ndarray]
    """Per clip, (T, nq) simulator positions at every control step, if recorded."""
    qvel: list[np.ndarray]
    """Per clip, (T, nv)."""
    targets: list[np.ndarray]
    """Per clip, (T, J) joint targets that the tracker chose [rad]."""
    executed: list[np.ndarray]
    """Per clip, (T, J) joint targets that were applied: with noise if there was any [rad]."""


@torch.no_grad()
def track_clips(
    tracker: Tracker,
    robot: Robot,
    task: Task,
    motions: Sequence[RobotMotion],
    objects: Mapping[str, SceneObject],
    workers: int = 0,
    record: bool = False,
    action_noise: float = 0.0,
    seed: int = 0,
    settle: float = SETTLE,
    go_on: bool = True,
    device: str = "cpu",
) -> Rollout:
    """Track every clip from its first frame by the mean action.

    With `record`, keep the states and targets; with `action_noise` [rad], the applied targets are disturbed while the
    recorded clean ones are not: demonstrations of how to recover. Unless they are to `go_on`, robots that have
    fulfilled
    K, or have fallen, are left where they are: enough to know K, and quicker. The tracker's network moves to where the
    tensors of physics on `device` live.
    """
    n = len(motions)
    scene = [objects[motion.object_id] for motion in motions]
    bank = ReferenceBank(motions, robot, tensor_device(device))
    physics = make_physics(device, robot, scene, tracker.kind.gains, workers=workers)
    network = tracker.network.to(physics.device)
    clip, index = torch.arange(n, device=physics.device), torch.zeros(n, dtype=torch.long, device=physics.device)
    pos, quat, lin, ang, joint_pos, joint_vel = (
        array.cpu().numpy() for array in vars(bank.frame(clip, index)).values()
    )
    physics.reset(
        np.arange(n),
        pos,
        quat.astype(float),
        joint_pos,
        lin,
        rot.rotate_inverse(quat.astype(float), ang.astype(float)),
        joint_vel,
    )
    lengths = np.minimum(bank.lengths.cpu().numpy() + round(settle / CONTROL_DT), round(task.time_limit / CONTROL_DT))
    judge = Judge(task, robot, scene, CONTROL_DT, [motion.wrist_goal_w for motion in motions])
    action = torch.zeros(n, len(robot.joints), device=physics.device)
    draw = rng(seed, "action noise", *(motion.id for motion in motions))
    qpos, qvel, targets, executed = [], [], [], []
    for step in range(int(lengths.max())):
        moment = Moment(robot, physics.state(), physics.links, lambda k, at=index: bank.frame(clip, at + k), action)
        action = network(tracker.kind.observe(moment))
        target = tracker.kind.target(robot, moment.reference(1), action)
        applied = target
        if action_noise:
            applied = (
                target
                + torch.from_numpy(draw.normal(size=target.shape).astype(np.float32)).to(physics.device) * action_noise
            )
        if record:
            qpos.append(physics.qpos().astype(np.float32))
            qvel.append(physics.qvel().astype(np.float32))
            targets.append(target.cpu().numpy())
            executed.append(applied.cpu().numpy())
        active = step < lengths
        if not go_on:
            active &= ~(judge.over() | judge.fell)
        if not active.any():
            break
        physics.step(applied, True, None if active.all() else np.flatnonzero(active))
        index = index + 1
        judge.see(physics, active)
    per_clip = [
        [values[:length] for values, length in zip(np.stack(rows, 1), lengths, strict=True)] if rows else []
        for rows in (qpos, qvel, targets, executed)
    ]
    return Rollout(judge, lengths, *per_clip)
