"""N episodes of a task side by side: the part of the Gymnasium environments that knows nothing of Gymnasium."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from mimicbench.core import rotations as rot
from mimicbench.core.errors import MimicbenchError, UnknownName
from mimicbench.core.motion import RobotMotion
from mimicbench.envs.eyes import Eyes
from mimicbench.envs.judge import Judge
from mimicbench.envs.start import Start, Starts, put_at_start
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.registry import ROBOTS
from mimicbench.sensors.elevation import camera_map
from mimicbench.sensors.proprioception import body_state, root_turn, s_current
from mimicbench.sensors.rays import ray_depth
from mimicbench.sensors.targets import target_map
from mimicbench.sim.backends import check_device, make_physics
from mimicbench.sim.physics import LinkState, Physics
from mimicbench.sim.scene import CONTROL_DT
from mimicbench.tasks.task import BodyPoints, Task

SENSES = ("proprio", "state", "time", "elevation", "depth", "color", "labels")
"""What can be observed, besides the targets of tasks that have some."""
BOUND = 1000.0
"""Observations beyond this are clipped; no robot that is still in one piece comes near it."""


@dataclass(frozen=True)
class EnvConfig:
    """The arguments of an environment, all of them optional."""

    split: str = "train"
    """Which objects to meet: `train`, `test`, or `all`."""
    control: str = "position"
    """What actions are: `position`, `velocity` or `torque`."""
    preset: str = "improved"
    """Which of the robot's gains drive position and velocity control: `improved`, or the paper's 100/5 on all joints,
    `paper`."""
    observe: Sequence[str] = ("proprio", "state", "time")
    """Which of `proprio`, `state`, `time`, `elevation`, `depth`, `color` and `labels` are observed; the last two need
    OpenGL."""
    cameras: tuple[int, int] = (90, 120)
    """Height and width of what one of the robot's cameras observes [px]; the paper's are 360 and 480."""
    time_limit: float | None = None
    """Seconds to a truncation; None: the task's, 20 s or 10 s (appendix C.1)."""
    starts: Sequence[RobotMotion] | Path | str | None = None
    """Motions in whose first frames episodes start, beside the motions' objects: as such, or the folder of a
    `--workdir`, whose
    retargeted clips are taken. None: starts are drawn by rule."""
    objects: Sequence[str | SceneObject] | None = None
    """The objects to meet instead of those of the split, as objects or by their ids; with `starts`, those that have no
    id to be made from."""
    pool: int = 1000
    """How many objects of the task's family there are to meet, both splits together: numbers 0 to pool - 1 of seed
    0."""
    robot: str = "h1"
    """The robot."""
    workers: int = 0
    """Threads that step the physics; 0: all processors. Never changes a result. Single environments use one."""
    device: str = "cpu"
    """What computes the physics: `cpu`, `cuda`, `cuda:1` for another GPU, or `warp-cpu`, for tests. Observations are
    NumPy arrays on all of them."""
    height: int = 480
    """Of the pictures [px]."""
    width: int = 640
    """Of the pictures [px]."""

    def __post_init__(self) -> None:
        check_device(self.device)
        for sense in self.observe:
            if sense not in SENSES:
                raise UnknownName("observation", sense, list(SENSES))
        if self.time_limit is not None and not CONTROL_DT <= self.time_limit <= 3600:
            raise MimicbenchError(
                f"a time limit of {self.time_limit} s is none; give seconds from {CONTROL_DT} to 3600"
            )
        if not 1 <= self.pool <= 99999:
            raise MimicbenchError(f"a pool of {self.pool} objects is none; give a number from 1 to 99999")
        for height, width in ((self.height, self.width), self.cameras):
            if not (16 <= height <= 4096 and 16 <= width <= 4096):
                raise MimicbenchError(f"pictures can have 16 to 4096 rows and columns, not {height} x {width}")


@dataclass(frozen=True)
class Outcome:
    """What one control step did to N episodes."""

    reward: np.ndarray
    """(N,) 1 where the episode ends with K fulfilled, else 0."""
    terminated: np.ndarray
    """(N,) whether K is fulfilled, or the physics broke down."""
    truncated: np.ndarray
    """(N,) whether the time is over."""


class Episodes:
    """N episodes, each with its own robot, object, goal and clock. `begin` all of them before anything else."""

    def __init__(self, task: Task, num_envs: int, config: EnvConfig) -> None:
        if num_envs < 1:
            raise MimicbenchError(f"{num_envs} environments are none; give at least 1")
        self.task, self.num_envs, self.config = task, num_envs, config
        self.robot = ROBOTS.get(config.robot)
        self.limit = round((config.time_limit or task.time_limit) / CONTROL_DT)
        """Control steps to a truncation."""
        self._draw = Starts(task, self.robot, config.split, config.objects, config.pool, config.starts).draw
        self.starts: list[Start] = []
        """(N,) how each episode started."""
        self.seeds = np.zeros(num_envs, np.int64)
        """(N,) of each episode."""
        self._last_target = np.zeros((num_envs, len(self.robot.joints)), np.float32)
        self._scene: tuple[Physics, Judge] | None = None
        self._links: LinkState | None = None
        self._eyes = Eyes(self.robot, task.rig, *config.cameras)

    @property
    def physics(self) -> Physics:
        """The physics that all episodes run in."""
        return self._running()[0]

    @property
    def judge(self) -> Judge:
        """The judge that watches them."""
        return self._running()[1]

    def _running(self) -> tuple[Physics, Judge]:
        if self._scene is None:
            raise MimicbenchError("no episode has begun; call reset() first")
        return self._scene

    def begin(self, ids: np.ndarray, seeds: Sequence[int]) -> None:
        """Begin the episodes `ids` (n,) anew, each from its seed. The first time, that must be all."""
        starts = [self._draw(seed) for seed in seeds]
        objects, goals = [start.obj for start in starts], [start.wrist_goal_w for start in starts]
        if self._scene is None:
            if len(ids) != self.num_envs:
                raise MimicbenchError("no episode has begun; call reset() for all environments first")
            config, self.starts = self.config, starts
            room = any(not isinstance(obj, str) and obj.hulls for obj in (*(config.objects or ()), *objects))
            physics = make_physics(
                config.device, self.robot, objects, config.preset, config.control, config.workers, meshes=room
            )
            self._scene = physics, Judge(self.task, self.robot, objects, CONTROL_DT, goals)
        else:
            self.physics.set_objects(objects, ids)
            self.judge.restart(ids, objects, goals)
        for env, start, seed in zip(ids, starts, seeds, strict=True):
            self.starts[env], self.seeds[env] = start, seed
        put_at_start(self.physics, ids, starts)
        self._last_target[ids] = 0.0
        self._links = None

    def step(self, target: np.ndarray, running: np.ndarray) -> Outcome:
        """One control step of the episodes `running` (N,) bool with joint targets (N, J).

        The others stay as they are.
        """
        target = np.asarray(target, np.float32)
        ids = None if running.all() else np.flatnonzero(running)
        if target.shape != self._last_target.shape or not np.isfinite(target if ids is None else target[ids]).all():
            raise MimicbenchError(
                f"actions must be {' x '.join(map(str, self._last_target.shape))} finite numbers, one "
                "for each joint of each robot"
            )
        target = target.copy() if ids is None else np.where(running[:, None], target, self._last_target)
        if ids is None or len(ids):
            self.physics.step(torch.from_numpy(target), True, ids)
        self._last_target, self._links = target, None
        judge = self.judge
        judge.see(self.physics, running, self._look())
        terminated = running & judge.over()
        truncated = running & ~terminated & (judge.steps >= self.limit)
        reward = ((terminated | truncated) & self.success()).astype(float)
        return Outcome(reward, terminated, truncated)

    def _look(self) -> LinkState:
        """Where all links are now, worked out once for each step."""
        if self._links is None:
            self._links = self.physics.links()
        return self._links

    def success(self) -> np.ndarray:
        """(N,) whether K is fulfilled: at some time, or for lift-box now."""
        return self.judge.success & ~self.judge.diverged

    def close(self) -> None:
        """Give the OpenGL context back, if there is one."""
        self._eyes.close()

    def observe(self) -> dict[str, np.ndarray]:
        """What all robots sense now, one row a robot. See gym.TaskEnv."""
        state, senses = self.physics.state(), self.config.observe
        turn = root_turn(state) if "proprio" in senses or "state" in senses else None
        seen: dict[str, np.ndarray] = {}
        if "proprio" in senses:
            seen["proprio"] = body_state(state, turn).cpu().numpy()
        if "state" in senses:
            seen["state"] = (
                s_current(state, self._look(), torch.from_numpy(self._last_target).to(self.physics.device), turn)
                .cpu()
                .numpy()
            )
        if "time" in senses:
            seen["time"] = (self.judge.steps[:, None] * CONTROL_DT).astype(np.float32)
        if "elevation" in senses:
            seen["elevation"] = camera_map(
                self.physics, rig=self.task.rig, cell=self.task.map_cell, workers=self.config.workers
            ).numpy()
        if "depth" in senses:
            seen["depth"] = ray_depth(self.physics, None, *self.config.cameras, rig=self.task.rig)
        if "color" in senses or "labels" in senses:
            qpos = self.physics.qpos()
            looks = [
                self._eyes.look(env, start.obj, qpos[env], start.wrist_goal_w) for env, start in enumerate(self.starts)
            ]
            seen |= {
                name: np.stack([getattr(look, name) for look in looks])
                for name in ("color", "labels")
                if name in senses
            }
        if self.task.wrist_goals:
            goal, qpos = self.judge.wrist_goal_w, self.physics.qpos()
            root_pos, root_quat = qpos[:, :3], qpos[:, 3:7]
            links = self.physics.links()
            wrists = BodyPoints.of(self.robot, links.pos_w.cpu().numpy(), links.quat_w.cpu().numpy()).wrist_pos_w
            place = np.where(np.isnan(goal), wrists, goal)  # a hand that has nothing to do is where it should be
            seen["targets"] = rot.rotate_inverse(root_quat[:, None], place - root_pos[:, None]).astype(np.float32)
            if "elevation" in senses:
                seen["target_elevation"] = target_map(root_pos, root_quat, goal, self.task.map_cell).numpy()
        for values in seen.values():
            if not (values.max() <= BOUND and values.min() >= -BOUND):
                # of a scene that broke: its episode ends with `diverged`, but what is returned has to be in the space
                np.nan_to_num(values, copy=False)
                np.clip(values, -BOUND, BOUND, out=values)
        return seen

    def facts(self) -> dict[str, np.ndarray]:
        """What is known of each episode now, one entry a robot. See gym.TaskEnv."""
        judge = self.judge
        return {
            "success": self.success(),
            "effort": judge.effort().copy(),
            "fell": judge.fell.copy(),
            "diverged": judge.diverged.copy(),
            "object_id": np.array([start.obj.id for start in self.starts], object),
            "reference_id": np.array([start.reference_id for start in self.starts], object),
            "seed": self.seeds.copy(),
        }
