"""The tracking environment: N robots, each following a clip next to the clip's object."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from mimicbench.core import rotations as rot
from mimicbench.core.motion import RobotMotion
from mimicbench.core.seeds import rng
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.sim.backends import make_physics
from mimicbench.sim.devices import tensor_device
from mimicbench.sim.physics import RobotState
from mimicbench.sim.scene import CONTROL_DT
from mimicbench.track.reference import ReferenceBank
from mimicbench.track.tracker import Moment, Step, TrackerKind


@dataclass(frozen=True)
class TrackingConfig:
    """How training episodes start, are disturbed, and end."""

    first_frame: float = 0.1
    """Share of episodes that start at the clip's first frame; the others start anywhere in it."""
    start_pos_noise: float = 0.03
    """Standard deviation of the root's start position [m]; a third of it upwards."""
    start_angle_noise: float = 0.03
    """Standard deviation of the root's start orientation and of the joint angles [rad]."""
    start_vel_noise: float = 0.2
    """Standard deviation of the root's [m/s, rad/s] and half of the joints' [rad/s] start velocities."""
    push: float = 0.4
    """Standard deviation of the horizontal velocity that a push adds [m/s]."""
    push_interval: float = 2.0
    """Mean time between pushes [s]."""
    max_pos_error: float = 0.4
    """An episode ends when the root is farther than this from its reference [m]; 0.5 in the paper (F.4)."""
    max_angle_error: float = 0.7
    """... or its orientation is farther than this [rad]."""
    max_drop: float = 0.2
    """... or it is this much lower [m]."""


class TrackingEnv:
    """Steps all robots together; episodes that end start again at once, each with a clip and object drawn anew."""

    def __init__(
        self,
        kind: TrackerKind,
        robot: Robot,
        motions: Sequence[RobotMotion],
        objects: Mapping[str, SceneObject],
        num_envs: int,
        config: TrackingConfig,
        seed: int,
        workers: int = 0,
        device: str = "cpu",
    ) -> None:
        self.kind, self.robot, self.config, self.num_envs = kind, robot, config, num_envs
        self.bank = ReferenceBank(motions, robot, tensor_device(device))
        self._objects = [objects[object_id] for object_id in self.bank.object_ids]
        self._rng = rng(seed, "tracking environment")
        clip = self._rng.integers(len(self.bank), size=num_envs)
        meshes = any(obj.hulls for obj in self._objects)
        self.physics = make_physics(
            device, robot, [self._objects[c] for c in clip], kind.gains, workers=workers, meshes=meshes
        )
        self.device = self.physics.device
        """Where all tensors live."""
        self.clip = torch.from_numpy(clip).to(self.device)
        self.index = torch.zeros(num_envs, dtype=torch.long, device=self.device)
        self.last_action = torch.zeros(num_envs, len(robot.joints), device=self.device)
        self._effort = torch.zeros(num_envs, device=self.device)
        self.ended = {"position": 0, "angle": 0, "drop": 0, "diverged": 0, "clip over": 0}
        """How many episodes ended for each reason."""
        self._start(np.arange(num_envs))

    moment: Moment
    """All robots now."""

    def observe(self) -> torch.Tensor:
        """(N, O) what the tracker sees now."""
        return self.kind.observe(self.moment)

    def step(
        self, action: torch.Tensor, target: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
        """Apply actions (N, J).

        Args:
            action: (N, J) what the tracker gave.
            target: (N, J) joint targets [rad] to apply, if not those that the action means on the clip's reference.

        Returns:
            observation (N, O) after restarts, reward (N,), done (N,) bool, time_out (N,) bool: done because the clip
            is over, not because the robot failed.
        """
        before = self.moment
        previous_reference = before.reference(0)
        if target is None:
            target = self.kind.target(self.robot, before.reference(1), action)
        self.physics.step(target, self.kind.measures_effort)
        self.index += 1
        effort = self.physics.effort.float() if self.kind.measures_effort else self._effort
        step = Step(action, self.last_action, before.state.joint_vel, previous_reference.joint_vel, effort)
        self.last_action = action
        self.moment = self._look()
        reward = self.kind.reward(self.moment, step)
        done, time_out = self._ends()
        reward = torch.where(self.physics.diverged, torch.zeros_like(reward), reward)
        if done.any():
            self._start(done.nonzero()[:, 0].cpu().numpy())
        return self.observe(), reward, done, time_out

    def _look(self) -> Moment:
        clip, index = self.clip, self.index.clone()
        return Moment(
            self.robot,
            self.physics.state(),
            self.physics.links,
            lambda k: self.bank.frame(clip, index + k),
            self.last_action,
        )

    def _ends(self) -> tuple[torch.Tensor, torch.Tensor]:
        config, state, ref = self.config, self.moment.state, self.moment.reference(0)
        far, turned, dropped = deviations(state, ref.root_pos_w, ref.root_quat_w, config)
        diverged = self.physics.diverged
        time_out = self.index >= self.bank.lengths[self.clip] - 1
        for reason, flags in (
            ("position", far),
            ("angle", turned),
            ("drop", dropped),
            ("diverged", diverged),
            ("clip over", time_out),
        ):
            self.ended[reason] += int(flags.sum())
        failed = far | turned | dropped | diverged
        return failed | time_out, time_out & ~failed

    def _start(self, ids: np.ndarray) -> None:
        """Put the robots `ids` on frames drawn at random, with noise, and exchange their objects."""
        config, draw, n = self.config, self._rng, len(ids)
        chosen = draw.integers(len(self.bank), size=n)
        share = np.where(draw.random(n) < config.first_frame, 0.0, draw.random(n))
        clip, env = (torch.from_numpy(array).to(self.device) for array in (chosen, ids))
        index = (torch.from_numpy(share).to(self.device) * (self.bank.lengths[clip] - 2)).long()
        self.clip, self.index = self.clip.clone(), self.index.clone()
        self.clip[env], self.index[env] = clip, index
        frame = self.bank.frame(clip, index)
        lin, ang, joint_pos, joint_vel = (
            array.cpu().numpy()
            for array in (frame.root_lin_vel_w, frame.root_ang_vel_w, frame.joint_pos, frame.joint_vel)
        )
        joints = len(self.robot.joints)
        pos = frame.root_pos_w.cpu().numpy() + draw.normal(size=(n, 3)) * config.start_pos_noise * np.array(
            [1, 1, 1 / 3]
        )
        turn = rot.from_rotvec(draw.normal(size=(n, 3)) * config.start_angle_noise)
        quat = rot.normalize(rot.multiply(turn, frame.root_quat_w.cpu().numpy().astype(float)))
        joint_pos = joint_pos + draw.normal(size=(n, joints)) * config.start_angle_noise
        joint_pos = np.clip(joint_pos, self.robot.joint_range[:, 0], self.robot.joint_range[:, 1])
        lin_vel = lin + draw.normal(size=(n, 3)) * config.start_vel_noise
        ang_vel = rot.rotate_inverse(quat, ang.astype(float)) + draw.normal(size=(n, 3)) * config.start_vel_noise
        joint_vel = joint_vel + draw.normal(size=(n, joints)) * config.start_vel_noise * 0.5
        self.physics.set_objects([self._objects[c] for c in chosen], ids)
        self.physics.reset(ids, pos, quat, joint_pos, lin_vel, ang_vel, joint_vel)
        self.last_action = self.last_action.clone()
        self.last_action[env] = 0.0
        self.moment = self._look()

    def disturb(self) -> None:
        """Push some of the robots, each about once in `push_interval`."""
        hit = np.flatnonzero(self._rng.random(self.num_envs) < CONTROL_DT / self.config.push_interval)
        push = np.zeros((len(hit), 3))
        push[:, :2] = self._rng.normal(size=(len(hit), 2)) * self.config.push
        self.physics.push(hit, push)


def deviations(
    state: RobotState, ref_pos_w: torch.Tensor, ref_quat_w: torch.Tensor, config: TrackingConfig
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Whether each robot is too far from, too much turned from, or too much below its reference, each (N,) bool."""
    far = (state.root_pos_w - ref_pos_w).norm(dim=-1) > config.max_pos_error
    turned = rot.angle_between(state.root_quat_w, ref_quat_w) > config.max_angle_error
    dropped = ref_pos_w[:, 2] - state.root_pos_w[:, 2] > config.max_drop
    return far, turned, dropped
