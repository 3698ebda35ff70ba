"""Many episodes of a task as one Gymnasium vector environment: `gymnasium.make_vec("mimicbench/SitChair-v0")`."""

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from mimicbench.core.errors import MimicbenchError, UnknownName
from mimicbench.envs.episodes import Episodes, check_seed
from mimicbench.envs.gym import (
    Observation,
    TaskEnv,
    check_render_mode,
    config_of,
    draw,
    known_options,
    next_seed,
    row_of,
    view_of,
)
from mimicbench.envs.spaces import action_space, batched, observation_space
from mimicbench.envs.view import View
from mimicbench.tasks.registry import TASKS


class TaskVectorEnv(VectorEnv[Observation, np.ndarray, np.ndarray]):
    """N environments like TaskEnv in one batched simulation.

    Observations, actions, rewards and infos are those of TaskEnv, stacked.

    Environment i of `reset(seed=n)` goes through the same episodes as a TaskEnv of `reset(seed=n + i)`, bit for bit,
    with any number of workers.

    Further arguments:
        num_envs: N.
        autoreset_mode: What happens to environments whose episode has ended. `NextStep` (default): the next step
            begins another one, ignores the action and has reward 0. `SameStep`: another one begins at once;
            `info["final_obs"]` and `info["final_info"]` hold the last frame of the one that ended. `Disabled`: nothing,
            until `reset(options={"reset_mask": mask})` with an array (N,) of bool.
    """

    metadata: dict[str, Any] = {**TaskEnv.metadata, "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        task: str,
        num_envs: int = 1,
        render_mode: str | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        **arguments: Any,
    ) -> None:
        """Make `num_envs` environments of a task by its name, such as `sit-chair`.

        See TaskEnv for the other arguments.
        """
        config = config_of(arguments)
        check_render_mode(render_mode)
        self.render_mode = render_mode
        self.autoreset_mode = _mode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        self.num_envs = num_envs
        self.episodes = Episodes(TASKS.get(task), num_envs, config)
        self.single_action_space = action_space(self.episodes.robot, config.control, config.action)
        self.single_observation_space = observation_space(self.episodes)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batched(self.single_observation_space, num_envs)
        self._randoms: list[np.random.Generator] = []
        self._ended = np.zeros(num_envs, bool)
        self._view: View | None = None

    def reset(  # type: ignore[override]
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin new episodes everywhere, or where `options["reset_mask"]` is true.

        Args:
            seed: n for the episodes n, n + 1, ...; or one seed, or None, for each environment.
            options: nothing, or `reset_mask` (N,) bool, or `start` (N,): the number of each one's start.
        """
        if seed is None or isinstance(seed, int | np.integer):
            seed = [None if seed is None else int(seed) + env for env in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise MimicbenchError(
                f"{len(seed)} seeds are given for {self.num_envs} environments; give one for each, or a single number"
            )
        given = known_options(options, ("reset_mask", "start"))
        mask = np.asarray(given.get("reset_mask", np.ones(self.num_envs, bool)))
        if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
            raise MimicbenchError(f"reset_mask must hold {self.num_envs} booleans, at least one of them true")
        starts = None if "start" not in given else np.asarray(given["start"])
        if starts is not None and (starts.shape != (self.num_envs,) or starts.dtype.kind not in "iu"):
            raise MimicbenchError(f"start must hold {self.num_envs} whole numbers, one for each environment")
        if not self._randoms:
            self._randoms = [seeding.np_random()[0] for _ in range(self.num_envs)]
        chosen = [(env, own) for env, own in enumerate(seed) if mask[env]]
        for env, own in chosen:
            if own is not None:
                self._randoms[env] = seeding.np_random(check_seed(own))[0]
        self._begin(np.flatnonzero(mask), [own for _, own in chosen], None if starts is None else starts[mask])
        return self.episodes.observe(), _masked(self.episodes.info(), mask)

    def step(self, actions: np.ndarray) -> tuple[Observation, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """One control step of 0.02 s everywhere, but where an episode begins instead."""
        waiting = self._ended.copy()
        if self.autoreset_mode is AutoresetMode.DISABLED and waiting.any():
            raise MimicbenchError("some episodes have ended; call reset() with their reset_mask first")
        if waiting.any():
            self._begin(np.flatnonzero(waiting))
        outcome = self.episodes.step(actions, ~waiting)
        self._ended = outcome.terminated | outcome.truncated
        last: dict[str, Any] = {}
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._ended.any():
            last = self._last_frames(self._ended)
            self._begin(np.flatnonzero(self._ended))
        info = _masked(self.episodes.info(), np.ones(self.num_envs, bool)) | last
        return self.episodes.observe(), outcome.reward, outcome.terminated, outcome.truncated, info

    def _begin(
        self, ids: np.ndarray, seeds: Sequence[int | None] | None = None, starts: np.ndarray | None = None
    ) -> None:
        """Begin episodes in the environments `ids`, from seeds of their own where none is given."""
        given = seeds or [None] * len(ids)
        own = [next_seed(self._randoms[env]) if seed is None else seed for env, seed in zip(ids, given, strict=True)]
        self.episodes.begin(ids, own, None if starts is None else starts.tolist())
        self._ended[ids] = False

    def _last_frames(self, ended: np.ndarray) -> dict[str, Any]:
        """What SameStep says of the episodes `ended` (N,) before others take their places."""
        seen = self.episodes.observe()
        observations = np.full(self.num_envs, None, object)
        for env in np.flatnonzero(ended).tolist():
            observations[env] = row_of(seen, env)
        return {
            "final_obs": observations,
            "_final_obs": ended.copy(),
            "final_info": _masked(self.episodes.info(), ended),
            "_final_info": ended.copy(),
        }

    def render(self) -> tuple[np.ndarray, ...] | None:  # type: ignore[override]
        """A picture (height, width, 3), uint8, of each environment; None without a render mode."""
        if self.render_mode is None:
            gymnasium.logger.warn('render() gives pictures only with render_mode="rgb_array"')
            return None
        self._view = self._view or view_of(self.episodes)
        return tuple(draw(self._view, self.episodes, env) for env in range(self.num_envs))

    def object_ids(self) -> list[str]:
        """The id of the object in each environment."""
        return self.episodes.object_ids()

    def reference_ids(self) -> list[str]:
        """The id of the motion that each episode started from; empty where the start was drawn by rule."""
        return self.episodes.reference_ids()

    def close_extras(self) -> None:
        """Give the OpenGL contexts back, if there are any."""
        self.episodes.close()
        if self._view is not None:
            self._view.close()


def _mode(mode: str | AutoresetMode) -> AutoresetMode:
    known = [each.value for each in AutoresetMode]
    if not isinstance(mode, AutoresetMode) and mode not in known:
        raise UnknownName("autoreset mode", mode, known)
    return AutoresetMode(mode)


def _masked(info: Mapping[str, np.ndarray], mask: np.ndarray) -> dict[str, Any]:
    """Facts as Gymnasium's vector environments give them, each with a mask `_name` of whom it is known of."""
    return {**info, **{f"_{name}": mask.copy() for name in info}}
