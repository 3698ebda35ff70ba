"""N episodes of a task side by side, each from a seed: what there is of Gymnasium environments without Gymnasium."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from mimicbench.core.errors import MimicbenchError, UnknownName
from mimicbench.core.motion import RobotMotion
from mimicbench.core.run import MOST_WORKERS
from mimicbench.envs.initial_states import InitialState, stacked
from mimicbench.envs.metrics import EpisodeMetrics
from mimicbench.envs.nearness import nearness
from mimicbench.envs.rule_starts import Starts
from mimicbench.envs.vec_env import EnvConfig, VecEnv
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.registry import DEFAULT_ROBOT, ROBOTS
from mimicbench.sensors.observations import TERMS, chosen_terms
from mimicbench.sim.backends import check_device
from mimicbench.sim.physics import PhysicsConfig
from mimicbench.sim.rows import Rows
from mimicbench.sim.threads import one_torch_thread
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.task import Task

MAX_SEED = 1 << 63
"""Seeds are smaller."""
REWARDS, ACTIONS = ("sparse", "dense"), ("target", "residual")


@dataclass(frozen=True)
class GymConfig:
    """The arguments of an environment, all of them optional."""

    split: str = "train"
    """Which objects to meet: `train`, `test`, or `all`."""
    control: str = "position"
    """What actions are: `position`, `velocity` or `torque`."""
    action: str = "target"
    """How actions say it: `target`, as they are; or `residual`, of position control only: in -1 to 1, as angles [rad]
    around the robot's rest pose."""
    reward: str = "sparse"
    """`sparse`: 1 in the step in which an episode ends with K fulfilled. `dense`: in every step from 0 to 1, by how
    near the condition of K is to holding; 0 after a fall."""
    terminate_on_success: bool | None = None
    """Whether an episode ends when K is fulfilled; None: with the sparse reward only. Evaluation goes on to the time
    limit."""
    gains: str = "improved"
    """Which of the robot's gains drive position and velocity control: `improved`, or the paper's 100/5 on all joints,
    `paper`."""
    observe: Sequence[str] = ("proprio", "state", "time")
    """Names of what is observed (sensors.observations), such as `proprio`, `state`, `elevation`, `depth`; `color` and
    `labels` need OpenGL."""
    cameras: tuple[int, int] = (90, 120)
    """Height and width of what one of the robot's cameras observes [px]; the paper's are 360 and 480."""
    time_limit: float | None = None
    """Seconds to a truncation; None: the task's, 20 s or 10 s (appendix C.1)."""
    max_episode_steps: int | None = None
    """Control steps to a truncation, if that comes earlier. Gymnasium gives the task's, unless it is told another."""
    starts: Sequence[RobotMotion] | Path | str | None = None
    """Motions in whose first frames episodes start, beside the motions' objects: as such, or the folder of a
    `--workdir`, whose retargeted clips are taken. None: starts are drawn by rule."""
    objects: Sequence[str | SceneObject] | None = None
    """The objects to meet instead of those of the split, as objects or by their ids; with `starts`, those that have no
    id to be made from."""
    pool: int = 1000
    """How many objects of the task's family there are to meet, both splits together: numbers 0 to pool - 1 of seed
    0."""
    robot: str = DEFAULT_ROBOT
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
        if isinstance(self.observe, str):
            object.__setattr__(self, "observe", (self.observe,))
        if isinstance(self.objects, str | SceneObject):
            object.__setattr__(self, "objects", (self.objects,))
        for what, name, known in (("reward", self.reward, REWARDS), ("action", self.action, ACTIONS)):
            if name not in known:
                raise UnknownName(what, name, list(known))
        if not isinstance(self.workers, int) or not 0 <= self.workers <= MOST_WORKERS:
            raise MimicbenchError(f"workers={self.workers!r}; give 1 to {MOST_WORKERS}, or 0 for all processors")
        if self.action == "residual" and self.control != "position":
            raise MimicbenchError(
                f'action="residual" is of angles around a pose, which {self.control} control does not take; choose '
                'control="position"'
            )
        self._check_kinds()
        if self.max_episode_steps is not None and self.max_episode_steps < 1:
            raise MimicbenchError(f"{self.max_episode_steps} steps are no episode; give max_episode_steps of 1 or more")
        for name in self.observe:
            if name not in TERMS:
                raise UnknownName("observation", name, list(TERMS))
        if self.time_limit is not None and not CONTROL_DT <= self.time_limit <= 3600:
            raise MimicbenchError(
                f"a time limit of {self.time_limit} s is none; give seconds from {CONTROL_DT} to 3600"
            )
        if not 1 <= self.pool <= 99999:
            raise MimicbenchError(f"a pool of {self.pool} objects is none; give a number from 1 to 99999")
        if not hasattr(self.cameras, "__len__") or len(self.cameras) != 2:
            raise MimicbenchError(
                f"cameras={self.cameras!r} is no size; give their height and width, such as (90, 120)"
            )
        for height, width in ((self.height, self.width), self.cameras):
            whole = isinstance(height, int | np.integer) and isinstance(width, int | np.integer)
            if not (whole and 16 <= height <= 4096 and 16 <= width <= 4096):
                raise MimicbenchError(f"pictures can have 16 to 4096 rows and columns, not {height} x {width}")

    def _check_kinds(self) -> None:
        """Raise MimicbenchError for a number that is none, or is not whole where it has to be."""
        whole: dict[str, object] = {"pool": self.pool}
        if self.max_episode_steps is not None:
            whole["max_episode_steps"] = self.max_episode_steps
        for name, value in whole.items():
            if not isinstance(value, int | np.integer):
                raise MimicbenchError(f"{name}={value!r}; give a whole number")
        if self.time_limit is not None and not isinstance(self.time_limit, int | float | np.number):
            raise MimicbenchError(f"time_limit={self.time_limit!r}; give seconds")
        if not isinstance(self.observe, Sequence):
            raise MimicbenchError(f"observe={self.observe!r}; give names of observations, such as ('proprio', 'time')")


@dataclass(frozen=True)
class Outcome:
    """What one control step did to N episodes."""

    reward: np.ndarray
    """(N,) 1 where the episode ends with K fulfilled, else 0; nearness, with `reward` "dense"."""
    terminated: np.ndarray
    """(N,) whether the physics broke down, or K is fulfilled where that ends an episode."""
    truncated: np.ndarray
    """(N,) whether the time is over."""


class Episodes:
    """N episodes, each with its own robot, object, goal and clock. `begin` all of them before anything else."""

    def __init__(self, task: Task, num_envs: int, config: GymConfig) -> None:
        if num_envs < 1:
            raise MimicbenchError(f"{num_envs} environments are none; give at least 1")
        self.task, self.num_envs, self.config = task, num_envs, config
        self.robot = ROBOTS.get(config.robot)
        steps = round((config.time_limit or task.time_limit) / CONTROL_DT)
        self.limit = min(steps, config.max_episode_steps or steps)
        """Control steps to a truncation."""
        ends = config.terminate_on_success
        self.ends_with_success = config.reward == "sparse" if ends is None else ends
        given = ("targets", "target_elevation") if "elevation" in config.observe else ("targets",)
        self.terms = chosen_terms(tuple(dict.fromkeys((*config.observe, *given))), task)
        """What is observed; targets always, where the task has some."""
        if not self.terms:
            raise MimicbenchError("nothing is observed; name at least one term, such as observe=('proprio',)")
        self._middle = np.array(self.robot.rest_pose if config.action == "residual" else 0.0, np.float32)
        self._starts = Starts(task, self.robot, config.split, config.objects, config.pool, config.starts)
        self.starts: list[InitialState] = []
        """(N,) how each episode started."""
        self.seeds, self.numbers = np.zeros((2, num_envs), np.int64)
        """(N,) of each episode; the place of its motion among `starts`, or of its object among those to meet."""
        self._env: VecEnv | None = None

    @property
    def env(self) -> VecEnv:
        """The environment that all episodes run in. Raises MimicbenchError before the first has begun."""
        if self._env is None:
            raise MimicbenchError("no episode has begun; call reset() first")
        return self._env

    @property
    def metrics(self) -> EpisodeMetrics:
        """What the episodes come to."""
        assert self.env.metrics is not None
        return self.env.metrics

    def begin(self, ids: np.ndarray, seeds: Sequence[int], numbers: Sequence[int] | None = None) -> None:
        """Begin the episodes `ids` (n,) anew, each from its seed, or from the start with a number. First of all, all.

        Raises MimicbenchError if there is no such seed or start.
        """
        drawn = [
            self._starts.draw(check_seed(seed), None if numbers is None else numbers[i]) for i, seed in enumerate(seeds)
        ]
        starts = [start for start, _ in drawn]
        if self._env is None:
            if len(ids) != self.num_envs:
                raise MimicbenchError("no episode has begun; call reset() for all environments first")
            self._env, self.starts = self._make([start.obj for start in starts]), list(starts)
        for env, (start, number), seed in zip(ids, drawn, seeds, strict=True):
            self.starts[env], self.seeds[env], self.numbers[env] = start, seed, number
        rows = Rows.of(ids.tolist(), self.num_envs, self._env.device)
        self._env.reset(rows, stacked(starts, self._env.physics))

    def _make(self, scenes: list[SceneObject]) -> VecEnv:
        config = self.config
        physics = PhysicsConfig(config.gains, config.control, meshes=self._starts.has_hulls)
        env_config = EnvConfig(config.device, config.workers, physics, config.cameras)
        return VecEnv(self.task, self.robot, scenes, env_config)

    def step(self, action: np.ndarray, running: np.ndarray) -> Outcome:
        """One control step of the episodes `running` (N,) bool with actions (N, J); the others stay."""
        action, shape = (
            np.array(action, np.float32),
            (self.num_envs, len(self.robot.joints)),
        )  # the caller keeps its own
        some = None if running.all() else running
        if action.shape != shape or not np.isfinite(action if some is None else action[some]).all():
            raise MimicbenchError(
                f"actions must be {' x '.join(map(str, shape))} finite numbers, one for each joint of each robot"
            )
        env, metrics = self.env, self.metrics
        target = action + self._middle
        if some is not None:
            target = np.where(running[:, None], target, env.last_target.cpu().numpy())
            action = np.where(running[:, None], action, env.last_action.cpu().numpy())
        if running.any():
            mask = None if some is None else torch.from_numpy(running).to(env.device)
            env.step(*(torch.from_numpy(part).to(env.device) for part in (target, action)), running=mask)
        over = metrics.over() if self.ends_with_success else metrics.diverged
        terminated = running & over.cpu().numpy()
        truncated = running & ~terminated & (metrics.steps.cpu().numpy() >= self.limit)
        if self.config.reward == "dense":
            return Outcome(np.where(running, nearness(self.env), 0.0), terminated, truncated)
        reward = ((terminated | truncated) & self.success()).astype(float)
        return Outcome(reward, terminated, truncated)

    def success(self) -> np.ndarray:
        """(N,) whether K is fulfilled: at some time, or for lift-box now."""
        return self.metrics.success.cpu().numpy() & ~self.metrics.diverged.cpu().numpy()

    def qpos(self) -> np.ndarray:
        """(N, nq) the simulator's positions now."""
        return self.env.physics.qpos()

    def close(self) -> None:
        """Give the OpenGL context back, if there is one."""
        if self._env is not None:
            self._env.close()

    @one_torch_thread
    def observe(self) -> dict[str, np.ndarray]:
        """What all robots sense now, one row a robot. See gym.TaskEnv."""
        obs = self.env.observe([term.name for term in self.terms])
        seen = {name: values.cpu().numpy() for name, values in obs.items()}
        for term in self.terms:
            values = seen[term.name]
            if not (values.max() <= term.high and values.min() >= term.low):
                # of a scene that broke: its episode ends with `diverged`, but what is returned has to be in the space
                np.nan_to_num(values, copy=False)
                np.clip(values, term.low, term.high, out=values)
        return seen

    def info(self) -> dict[str, np.ndarray]:
        """What is known of each episode now, one entry a robot. See gym.TaskEnv."""
        metrics, success = self.metrics, self.success()
        return {
            "success": success,
            "is_success": success.copy(),
            "stays": metrics.stays.cpu().numpy(),
            "effort": metrics.effort().cpu().numpy().copy(),
            "fell": metrics.fell.cpu().numpy().copy(),
            "diverged": metrics.diverged.cpu().numpy().copy(),
            "start": self.numbers.copy(),
            "seed": self.seeds.copy(),
        }

    def object_ids(self) -> list[str]:
        """Of the object in each scene."""
        return [start.obj.id for start in self.starts]

    def reference_ids(self) -> list[str]:
        """Of the motion that each episode started from; empty where the start was drawn by rule."""
        return [start.reference_id for start in self.starts]


def check_seed(seed: object) -> int:
    """The seed as it is. Raises MimicbenchError if it is none."""
    if not isinstance(seed, int | np.integer) or not 0 <= seed < MAX_SEED:
        raise MimicbenchError(f"{seed!r} is no seed; give a whole number from 0 to {MAX_SEED - 1}")
    return int(seed)
