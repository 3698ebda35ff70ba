"""The tasks as LeRobot's policies see them: the names and numbers of the demonstrations, as Gymnasium environments.

`agent_pos` is the paper's S_current, `environment_state` the box around the object and where there are some the targets
of the wrists, `pixels` the elevation map in gray, which the robot's own cameras fill and which needs no OpenGL. Actions
are joint targets [rad]. A policy that LeRobot trained on `mimicbench demos` drives them as they are.
"""

from functools import partial
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv

import mimicbench
from mimicbench.core.errors import UnknownName
from mimicbench.drawing.opengl import NoPictures
from mimicbench.sensors.scene import PICTURE, SCENE
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.registry import DEFAULT_TASK, TASKS

SUITE = "mimicbench"
TASK_IDS = {task: f"mimicbench/{name}-v0" for name, task in mimicbench.ENVIRONMENTS.items()}


class AsLeRobotSees(gymnasium.ObservationWrapper):
    """One environment with LeRobot's names of observations."""

    def __init__(self, env: gymnasium.Env, task: str, images: bool) -> None:
        """`task` is what is to be done, for policies that read, in the words of the demonstrations."""
        super().__init__(env)
        self.task = self.task_description = task
        inner = env.observation_space
        assert isinstance(inner, gymnasium.spaces.Dict)
        self._scene = [name for name in SCENE if name in inner.spaces]
        size = sum(int(np.prod(inner[name].shape or ())) for name in self._scene)
        numbers = partial(gymnasium.spaces.Box, -1000.0, 1000.0, dtype=np.float32)
        found: dict[str, gymnasium.Space] = {
            "agent_pos": numbers(shape=inner["state"].shape),
            "environment_state": numbers(shape=(size,)),
        }
        if images:
            picture = gymnasium.spaces.Box(0, 255, (*(inner[PICTURE].shape or ()), 3), np.uint8)
            found["pixels"] = gymnasium.spaces.Dict({"elevation": picture})
        self.images = images
        self.observation_space = gymnasium.spaces.Dict(found)

    def observation(self, observation: dict[str, np.ndarray]) -> dict[str, Any]:
        """The same by LeRobot's names."""
        scene = np.concatenate([observation[name].ravel() for name in self._scene])
        seen = {"agent_pos": observation["state"], "environment_state": scene}
        if not self.images:
            return seen
        return {**seen, "pixels": {"elevation": np.repeat(observation[PICTURE][..., None], 3, axis=-1)}}

    def render(self) -> np.ndarray:  # type: ignore[override]
        """A picture (height, width, 3), uint8; a black one where there is no OpenGL, for LeRobot always wants some."""
        try:
            return np.asarray(self.env.render())
        except NoPictures:
            return np.zeros((64, 64, 3), np.uint8)


def make_one(
    task: str = DEFAULT_TASK, split: str = "test", images: bool = False, max_steps: int | None = None, **arguments: Any
) -> gymnasium.Env:
    """One environment of a task by its name, with episodes of at most `max_steps`, or as long as the task's;
    `arguments` are TaskEnv's. Raises UnknownName.
    """
    if task not in TASK_IDS:
        raise UnknownName("task", task, list(TASK_IDS))
    observe = ("state", "scene", *([PICTURE] if images else []))  # targets of the wrists come wherever there are any
    given = {"render_mode": "rgb_array", "height": 240, "width": 320, "max_episode_steps": max_steps, **arguments}
    if max_steps is not None:  # Gymnasium ends an episode from outside, where nothing is rewarded any more
        given = {"time_limit": max_steps * CONTROL_DT, **given}
    env = gymnasium.make(f"mimicbench:{TASK_IDS[task]}", split=split, observe=observe, **given)
    return AsLeRobotSees(env, TASKS.get(task).title, images)


def make_env(
    n_envs: int = 1, use_async_envs: bool = False, cfg: Any = None, split: str = "train", images: bool = True
) -> dict[str, dict[int, VectorEnv]]:
    """`n_envs` environments of each task, by the task's place in the paper: {"mimicbench": {0: ..., 5: ...}}.

    With a configuration that names a `task`, of that one alone. Raises UnknownName.
    """
    wanted = getattr(cfg, "task", None)
    if wanted is not None and wanted not in TASK_IDS:
        raise UnknownName("task", wanted, list(TASK_IDS))
    made: dict[int, VectorEnv] = {}
    for number, task in enumerate(TASK_IDS):
        if wanted not in (None, task):
            continue
        each = [partial(make_one, task, split, images)] * n_envs
        if use_async_envs:  # processes of their own, begun anew: what is forked shares threads and locks
            made[number] = AsyncVectorEnv(each, context="spawn", autoreset_mode=AutoresetMode.SAME_STEP)
        else:
            made[number] = SyncVectorEnv(each, autoreset_mode=AutoresetMode.SAME_STEP)
    return {SUITE: made}
