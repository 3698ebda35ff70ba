"""The six tasks for LeRobot, as an environment of the Hub: `make_env("<user>/<repository>", trust_remote_code=True)`.

Observations have LeRobot's names. `agent_pos` is what the robot feels: gravity, height, velocities and joints, the
time, and at touch-points where the wrists are to go. `pixels` is what it sees: its elevation map in gray, which its
own cameras fill and which needs no OpenGL. Actions are angles around the robot's rest pose, in -1 to 1 radian.
"""

from functools import partial
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv

import mimicbench

SUITE = "mimicbench"
FELT = ("proprio", "time", "targets")
LOWEST, HIGHEST = -1.3, 0.7
"""[m] From the root: black and white in the picture of the elevation map. The floor is near -1."""


class AsLeRobotSees(gymnasium.ObservationWrapper):
    """One environment with LeRobot's names of observations."""

    def __init__(self, env: gymnasium.Env, task: str) -> None:
        """`task` is what is to be done, for policies that read."""
        super().__init__(env)
        self.task = self.task_description = task
        inner = env.observation_space
        assert isinstance(inner, gymnasium.spaces.Dict)
        self.felt = [name for name in FELT if name in inner.spaces]
        size = sum(int(np.prod(inner[name].shape or ())) for name in self.felt)
        cells = inner["elevation"].shape or ()
        self.observation_space = gymnasium.spaces.Dict(
            {
                "agent_pos": gymnasium.spaces.Box(-1000.0, 1000.0, (size,), np.float32),
                "pixels": gymnasium.spaces.Dict({"elevation": gymnasium.spaces.Box(0, 255, (*cells, 3), np.uint8)}),
            }
        )

    def observation(self, observation: dict[str, np.ndarray]) -> dict[str, Any]:
        """The same by LeRobot's names."""
        gray = 255 * (observation["elevation"] - LOWEST) / (HIGHEST - LOWEST)
        picture = np.repeat(gray.clip(0, 255).astype(np.uint8)[..., None], 3, axis=-1)
        felt = [observation[name].ravel() for name in self.felt]
        return {"agent_pos": np.concatenate(felt).astype(np.float32), "pixels": {"elevation": picture}}


def make_one(name: str, task: str, split: str) -> gymnasium.Env:
    """One environment."""
    observe = ("proprio", "time", "elevation")  # targets of the wrists are seen wherever there are any
    identity = f"mimicbench:mimicbench/{name}-v0"  # so that a process of its own imports mimicbench, too
    env = gymnasium.make(identity, split=split, observe=observe, action="residual")
    return AsLeRobotSees(env, task.replace("-", " "))


def make_env(
    n_envs: int = 1, use_async_envs: bool = False, cfg: Any = None, split: str = "train"
) -> dict[str, dict[int, VectorEnv]]:
    """`n_envs` environments of each task, by the task's place in the paper: {"mimicbench": {0: ..., 5: ...}}.

    With a configuration that names a `task`, such as `sit-chair`, of that one alone.
    """
    wanted = getattr(cfg, "task", None)
    names = list(mimicbench.ENVIRONMENTS)
    chosen = [name for name in names if wanted in (None, mimicbench.ENVIRONMENTS[name])]
    if not chosen:
        raise ValueError(f"there is no task {wanted!r}; choose from {', '.join(mimicbench.ENVIRONMENTS.values())}")
    made: dict[int, VectorEnv] = {}
    for name in chosen:
        each = [partial(make_one, name, mimicbench.ENVIRONMENTS[name], split)] * n_envs
        if use_async_envs:  # processes of their own, begun anew: what is forked shares threads and locks
            made[names.index(name)] = AsyncVectorEnv(each, context="spawn", autoreset_mode=AutoresetMode.SAME_STEP)
        else:
            made[names.index(name)] = SyncVectorEnv(each, autoreset_mode=AutoresetMode.SAME_STEP)
    return {SUITE: made}
