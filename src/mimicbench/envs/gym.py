"""The tasks as Gymnasium environments, single (`TaskEnv`) and batched (`TaskVectorEnv`).

`gymnasium.make("mimicbench/SitChair-v0")` and `gymnasium.make_vec` find them once mimicbench is imported.
"""

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from mimicbench.core.errors import MimicbenchError, UnknownName
from mimicbench.envs.episodes import Episodes, GymConfig
from mimicbench.envs.spaces import action_space, batched, observation_space
from mimicbench.envs.view import View
from mimicbench.sim.scene import CONTROL_DT
from mimicbench.tasks.registry import TASKS

Observation = dict[str, Any]
"""Arrays by the names of senses; see TaskEnv."""


class TaskEnv(gymnasium.Env[Observation, np.ndarray]):
    """A Unitree H1 beside an object that it has not met before, and a household task to do with it.

    ## Description

    | id | task | object | time limit |
    |---|---|---|---|
    | `mimicbench/SitChair-v0` | sit down and stay for 0.3 s | chair, fixed | 20 s |
    | `mimicbench/SitSofa-v0` | the same | sofa, fixed | 20 s |
    | `mimicbench/LieBed-v0` | lie down, pelvis and ankles on it, for 0.3 s | bed, fixed | 20 s |
    | `mimicbench/LieSofa-v0` | lie down, pelvis on it and ankles up, for 0.3 s | sofa, fixed | 20 s |
    | `mimicbench/TouchPoints-v0` | both wrists within 0.1 m of their targets for 1 s | household object, fixed | 10 s |
    | `mimicbench/LiftBox-v0` | hold the box 0.2 m up between the wrists when time is over | box, movable | 10 s |

    One step is one control frame of 0.02 s, in which the action holds for four physics steps. The exact conditions, K,
    are in docs/definitions.md.

    ## Action space

    `Box(19)`, float32, one number for each joint in the order of `robot.joint_names`; the bounds are the robot's
    limits. By `control`:
    target angles [rad] that a PD controller with the gains `gains` drives to, target velocities [rad/s], or torques
    [N m]. Actions beyond
    the bounds are not clipped: joint stops and torque limits decide what becomes of them. Numbers that are not finite
    are refused.

    ## Observation space

    `Dict` of arrays, those that `observe` names; float32 and clipped to +-1000 but for pictures.

    - `proprio` (48): direction of gravity in the root frame (3), root height above the floor [m] (1), linear [m/s]
      (3) and angular velocity
      [rad/s] (3) of the root in its own frame, joint angles [rad] (19) and velocities [rad/s] (19).
    - `state` (300): the paper's S_current (appendix G.1): joint angles, joint velocities; of all 20 links relative to
      the root positions (60),
      rotation vectors (60), linear (60) and angular velocities (60), in the root frame; the last action (19; 0 at
      first); direction of gravity (3).
    - `time` (1): since the start of the episode [s].
    - `elevation` (128, 128): height [m] relative to the root of the highest point that the cameras see in each cell
      of 4 cm, for TouchPoints
      1 cm (appendix C.2); row along the robot's heading, column to its left, the robot in the middle. Four cameras
      around the pelvis, for TouchPoints
      and LiftBox one above it. It costs some milliseconds a robot and step.
    - `target_elevation` (128, 128), for TouchPoints with `elevation`: the same map with nothing on the floor but the
      two targets.
    - `depth` (C, height, width): along the axis of each of the C cameras that `elevation` is made of, 50 m at most
      [m], by rays. `cameras` is the
      pictures' size; at 90 x 120 four cost about 11 ms a robot and step.
    - `color` (C, height, width, 3), uint8: what they see; for TouchPoints with one red pixel for each target, hidden
      or not. Needs OpenGL.
    - `labels` (C, height, width), uint8: of what they see (mimicbench.sensors.render): 0 nothing, 1 floor, 2 object,
      3 + i link i of the robot. Needs OpenGL.
    - `targets` (2, 3), for TouchPoints only and always: where left and right wrist are to go, in the root frame [m].

    Nothing else is known of the object. The box to be lifted is seen through `elevation` and the cameras alone.

    ## Rewards

    1 in the step in which an episode ends with K fulfilled, 0 in every other: the sum over an episode is its success.

    ## Starting state

    Every reset draws another object of the split, which stands at the origin and faces +x (appendix C.1). With
    `starts`, the robot is in the
    first frame of one of these motions, velocities included; for the four tasks that navigate it is moved to within 2 m
    of the origin.
    Without, it stands at rest: for these four tasks 1 to 2 m from the origin, within 100 degrees of the object's front
    and 0.45 m clear of it,
    with any heading; for the other two in front of the object, facing it, at most 0.3 m (TouchPoints: 0.1 m) behind
    where it could begin at
    once, 0.1 m to the side and turned by 0.2 rad. TouchPoints draws a pair of points that two hands can reach.

    `reset(seed=n)` gives the episode n: the same object, start and goal every time. Later resets without a seed draw
    the seeds of their
    episodes from n; `info["seed"]` is the one of the present episode, with which it can be had again.

    ## Episode end

    Terminated when K is fulfilled (LiftBox: never, for K is judged in the last frame), or when the physics break down,
    which
    `info["diverged"]` says. Truncated at the time limit. Falling ends no episode.

    ## Information

    `success` (K has been fulfilled; of LiftBox: holds in this frame), `effort` (the largest e_i of the episode [W^2],
    which P is judged by,
    appendix D.2), `fell`, `diverged`, `object_id`, `reference_id` (the motion that it started from, or empty), `seed`.

    ## Arguments

    Those of `mimicbench.envs.episodes.GymConfig`: `split`, `control`, `gains`, `observe`, `cameras`, `time_limit`,
    `starts`, `objects`, `pool`,
    `robot`, `workers`, `device`, `height`, `width`; and `render_mode`, None or `"rgb_array"`, which needs OpenGL.

    ## Version history

    - v0: first version. Numbers may change until v1.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": round(1 / CONTROL_DT)}

    def __init__(self, task: str, render_mode: str | None = None, **arguments: Any) -> None:
        """Make the environment of a task by its name, such as `sit-chair`; see the class for the other arguments."""
        config = _config(arguments)
        _check_render_mode(render_mode)
        self.render_mode = render_mode
        self.episodes = Episodes(TASKS.get(task), 1, replace(config, workers=1))
        self.action_space = action_space(self.episodes.robot, config.control)
        self.observation_space = observation_space(self.episodes)
        self._view: View | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin the episode `seed`, or without it the next one. There are no options."""
        super().reset(seed=seed)
        self.episodes.begin(np.zeros(1, int), [_next_seed(self.np_random) if seed is None else seed])
        return self._observe(), self._info()

    def step(self, action: np.ndarray) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """One control step of 0.02 s."""
        outcome = self.episodes.step(np.asarray(action)[None], np.ones(1, bool))
        return (
            self._observe(),
            float(outcome.reward[0]),
            bool(outcome.terminated[0]),
            bool(outcome.truncated[0]),
            self._info(),
        )

    def _observe(self) -> Observation:
        return {name: values[0] for name, values in self.episodes.observe().items()}

    def _info(self) -> dict[str, Any]:
        return _row(self.episodes.info(), 0)

    def render(self) -> np.ndarray | None:  # type: ignore[override]
        """A picture (height, width, 3), uint8; None without a render mode."""
        if self.render_mode is None:
            gymnasium.logger.warn('render() gives pictures only with render_mode="rgb_array"')
            return None
        self._view = self._view or _view(self.episodes)
        return _draw(self._view, self.episodes, 0)

    def close(self) -> None:
        """Give the OpenGL contexts back, if there are any."""
        self.episodes.close()
        if self._view is not None:
            self._view.close()


class TaskVectorEnv(VectorEnv[Observation, np.ndarray, np.ndarray]):
    """N environments like TaskEnv in one batched simulation.

    Observations, actions, rewards and infos are those of TaskEnv, stacked.

    Environment i of `reset(seed=n)` goes through the same episodes as a TaskEnv of `reset(seed=n + i)`, bit for bit,
    with any number of workers.

    Further arguments:
        num_envs: N.
        autoreset_mode: What happens to environments whose episode has ended. `NextStep` (default): the next step
            begins another one, ignores the
            action and has reward 0. `SameStep`: another one begins at once; `info["final_obs"]` and
            `info["final_info"]` hold the
            last frame of the one that ended. `Disabled`: nothing, until `reset(options={"reset_mask": mask})` with an
            array (N,) of bool.
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
        config = _config(arguments)
        _check_render_mode(render_mode)
        self.render_mode = render_mode
        self.autoreset_mode = _mode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        self.num_envs = num_envs
        self.episodes = Episodes(TASKS.get(task), num_envs, config)
        self.single_action_space = action_space(self.episodes.robot, config.control)
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
            options: nothing, or `reset_mask` (N,) bool.
        """
        if seed is None or isinstance(seed, int | np.integer):
            seed = [None if seed is None else int(seed) + env for env in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise MimicbenchError(
                f"{len(seed)} seeds are given for {self.num_envs} environments; give one for each, or a single number"
            )
        mask = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs, bool)))
        if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
            raise MimicbenchError(f"reset_mask must hold {self.num_envs} booleans, at least one of them true")
        if not self._randoms:
            self._randoms = [seeding.np_random()[0] for _ in range(self.num_envs)]
        chosen = [(env, own) for env, own in enumerate(seed) if mask[env]]
        for env, own in chosen:
            if own is not None:
                self._randoms[env] = seeding.np_random(own)[0]
        self._begin(np.flatnonzero(mask), [own for _, own in chosen])
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

    def _begin(self, ids: np.ndarray, seeds: Sequence[int | None] | None = None) -> None:
        """Begin episodes in the environments `ids`, from seeds of their own where none is given."""
        given = seeds or [None] * len(ids)
        self.episodes.begin(
            ids,
            [_next_seed(self._randoms[env]) if seed is None else seed for env, seed in zip(ids, given, strict=True)],
        )
        self._ended[ids] = False

    def _last_frames(self, ended: np.ndarray) -> dict[str, Any]:
        """What SameStep says of the episodes `ended` (N,) before others take their places."""
        seen = self.episodes.observe()
        observations = np.full(self.num_envs, None, object)
        for env in np.flatnonzero(ended).tolist():
            observations[env] = _row(seen, env)
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
        self._view = self._view or _view(self.episodes)
        return tuple(_draw(self._view, self.episodes, env) for env in range(self.num_envs))

    def close_extras(self) -> None:
        """Give the OpenGL contexts back, if there are any."""
        self.episodes.close()
        if self._view is not None:
            self._view.close()


def _config(arguments: dict[str, Any]) -> GymConfig:
    known = [field.name for field in fields(GymConfig)]
    for name in arguments:
        if name not in known:
            raise UnknownName("argument of the environment", name, known)
    return GymConfig(**arguments)


def _check_render_mode(render_mode: str | None) -> None:
    if render_mode not in (None, *TaskEnv.metadata["render_modes"]):
        raise UnknownName("render mode", render_mode, TaskEnv.metadata["render_modes"])


def _mode(mode: str | AutoresetMode) -> AutoresetMode:
    known = [each.value for each in AutoresetMode]
    if not isinstance(mode, AutoresetMode) and mode not in known:
        raise UnknownName("autoreset mode", mode, known)
    return AutoresetMode(mode)


def _next_seed(random: np.random.Generator) -> int:
    return int(random.integers(2**31))


def _row(values: Mapping[str, np.ndarray], env: int) -> dict[str, Any]:
    """One environment's part of stacked values, on its own."""
    rows = {name: array[env] for name, array in values.items()}
    return {
        name: row.copy() if isinstance(row, np.ndarray) else row.item() if isinstance(row, np.generic) else row
        for name, row in rows.items()
    }


def _masked(info: Mapping[str, np.ndarray], mask: np.ndarray) -> dict[str, Any]:
    """Facts as Gymnasium's vector environments give them, each with a mask `_name` of whom it is known of."""
    return {**info, **{f"_{name}": mask.copy() for name in info}}


def _view(episodes: Episodes) -> View:
    return View(episodes.robot, episodes.config.height, episodes.config.width)


def _draw(view: View, episodes: Episodes, env: int) -> np.ndarray:
    start = episodes.starts[env]
    return view.draw(env, start.obj, episodes.qpos()[env], start.wrist_goal_w)
