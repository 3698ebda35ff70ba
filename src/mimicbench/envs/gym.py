"""The tasks as Gymnasium environments: `gymnasium.make("mimicbench/SitChair-v0")`, once mimicbench is imported."""

from collections.abc import Collection, Mapping
from dataclasses import fields, replace
from typing import Any

import gymnasium
import numpy as np

from mimicbench.core.errors import UnknownName
from mimicbench.envs.episodes import Episodes, GymConfig, check_seed
from mimicbench.envs.spaces import action_space, observation_space
from mimicbench.envs.view import View
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.registry import TASKS

Observation = dict[str, Any]
"""Arrays by the names of senses; see TaskEnv."""


class TaskEnv(gymnasium.Env[Observation, np.ndarray]):
    """A Unitree H1 beside a piece of furniture, and a household task to do with it.

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
    limits. By `control`: target angles [rad] that a PD controller with the gains `gains` drives to, target velocities
    [rad/s], or torques [N m]. Actions beyond the bounds are not clipped: joint stops and torque limits decide what
    becomes of them. Numbers that are not finite are refused. With `action="residual"` the bounds are -1 and 1, and
    actions are added to the robot's rest pose [rad].

    ## Observation space

    `Dict` of arrays, those that `observe` names; float32 and clipped to +-1000 but for pictures.

    - `proprio` (48): direction of gravity in the root frame (3), root height above the floor [m] (1), linear [m/s]
      (3) and angular velocity [rad/s] (3) of the root in its own frame, joint angles [rad] (19) and velocities [rad/s]
      (19).
    - `state` (300): the paper's S_current (appendix G.1): joint angles, joint velocities; of all 20 links relative to
      the root positions (60), rotation vectors (60), linear (60) and angular velocities (60), in the root frame; the
      last joint targets (19; 0 at first); direction of gravity (3).
    - `time` (1): since the start of the episode [s].
    - `elevation` (128, 128): height [m] relative to the root of the highest point that the cameras see in each cell
      of 4 cm, for TouchPoints 1 cm (appendix C.2); row along the robot's heading, column to its left, the robot in the
      middle. Four cameras around the pelvis, for TouchPoints and LiftBox one above it. It costs some milliseconds a
      robot and step.
    - `target_elevation` (128, 128), for TouchPoints with `elevation`: the same map with nothing on the floor but the
      two targets.
    - `depth` (C, height, width): along the axis of each of the C cameras that `elevation` is made of, 50 m at most
      [m], by rays. `cameras` is the pictures' size; at 90 x 120 four cost about 11 ms a robot and step.
    - `color` (C, height, width, 3), uint8: what they see; for TouchPoints with one red pixel for each target, hidden
      or not. Needs OpenGL.
    - `labels` (C, height, width), uint8: of what they see (mimicbench.sensors.render): 0 nothing, 1 floor, 2 object,
      3 + i link i of the robot. Needs OpenGL.
    - `targets` (2, 3), for TouchPoints only and always: where left and right wrist are to go, in the root frame [m].
    - `hands` (2), for TouchPoints: which of the two have a target, 1 or 0.

    All other terms are in docs/senses.md; privileged ones, which no robot can measure, are said to be so there. By
    default nothing else is known of the object. The box to be lifted is seen through `elevation` and the cameras alone.

    ## Rewards

    `reward="sparse"`: 1 in the step in which an episode ends with K fulfilled, 0 in every other: the sum over an
    episode is its success. (For shorter episodes give `time_limit`: with `max_episode_steps`, `gymnasium.make` ends
    them from outside, where the environment does not know of it; `make_vec` tells it.) `reward="dense"`: in every
    step exp(-d), d being what is missing of the condition of K in all [m]: 1 while it holds, 0 after a fall.
    Episodes then go on to the time limit, so that holding on pays.

    ## Starting state

    Every reset draws another object of the split, which stands at the origin and faces +x (appendix C.1). With
    `starts`, the robot is in the first frame of one of these motions, velocities included; for the four tasks that
    navigate it is moved to within 2 m of the origin. Without, it stands at rest: for these four tasks 1 to 2 m from the
    origin, within 100 degrees of the object's front and 0.45 m clear of it, with any heading; for the other two in
    front of the object, facing it, at most 0.3 m (TouchPoints: 0.1 m) behind where it could begin at once, 0.1 m to the
    side and turned by 0.2 rad. TouchPoints draws a pair of points that two hands can reach.

    `reset(seed=n)` gives the episode n: the same object, start and goal every time. Later resets without a seed draw
    the seeds of their episodes from n; `info["seed"]` is the one of the present episode, with which it can be had
    again. `options={"start": k}` begins with motion k of `starts`, or beside object k of those to meet, whatever the
    seed; `info["start"]` is the present one.

    ## Episode end

    Terminated when K is fulfilled (LiftBox: never, for K is judged in the last frame; with the dense reward or
    `terminate_on_success=False`: never), or when the physics break down, which `info["diverged"]` says. Truncated at
    the time limit, or after `max_episode_steps` if they are fewer; Gymnasium makes that the task's unless told
    otherwise, so give both for episodes that are longer. Falling ends no episode.

    ## Information

    Numbers only. `success` and `is_success` (K has been fulfilled; of LiftBox: holds in this frame), `stays` (its
    condition has held for 0.3 s, or as long as K asks where that is longer, and the robot has not fallen: what
    evaluation asks at the time limit), `effort` (the largest e_i of the episode [W^2], which P is judged by, appendix
    D.2), `fell`, `diverged`, `start`, `seed`. `env.unwrapped.object_ids()` and `reference_ids()` are the ids of the
    present object and of the motion that the episode started from.

    ## Arguments

    Those of `mimicbench.envs.episodes.GymConfig`; and `render_mode`, None or `"rgb_array"`, which needs OpenGL.

    ## Version history

    - v0: first version. Numbers may change until v1.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": round(1 / CONTROL_DT)}

    def __init__(self, task: str, render_mode: str | None = None, **arguments: Any) -> None:
        """Make the environment of a task by its name, such as `sit-chair`; see the class for the other arguments."""
        config = config_of(arguments)
        check_render_mode(render_mode)
        self.render_mode = render_mode
        self.episodes = Episodes(TASKS.get(task), 1, replace(config, workers=1))
        self.action_space = action_space(self.episodes.robot, config.control, config.action)
        self.observation_space = observation_space(self.episodes)
        self._view: View | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin the episode `seed`, or without it the next one; with `options["start"]` from that start."""
        given = known_options(options, ("start",)).get("start")
        if seed is not None:
            seed = check_seed(seed)
        super().reset(seed=seed)
        own = [next_seed(self.np_random) if seed is None else seed]
        self.episodes.begin(np.zeros(1, int), own, None if given is None else [given])
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
        return row_of(self.episodes.info(), 0)

    def object_ids(self) -> list[str]:
        """The id of the present object."""
        return self.episodes.object_ids()

    def reference_ids(self) -> list[str]:
        """The id of the motion that the episode started from; empty if it was drawn by rule."""
        return self.episodes.reference_ids()

    def render(self) -> np.ndarray | None:  # type: ignore[override]
        """A picture (height, width, 3), uint8; None without a render mode."""
        if self.render_mode is None:
            gymnasium.logger.warn('render() gives pictures only with render_mode="rgb_array"')
            return None
        self._view = self._view or view_of(self.episodes)
        return draw(self._view, self.episodes, 0)

    def close(self) -> None:
        """Give the OpenGL contexts back, if there are any."""
        self.episodes.close()
        if self._view is not None:
            self._view.close()


def config_of(arguments: dict[str, Any]) -> GymConfig:
    """The configuration that an environment's arguments describe. Raises UnknownName, MimicbenchError."""
    known = [field.name for field in fields(GymConfig)]
    for name in arguments:
        if name not in known:
            raise UnknownName("argument of the environment", name, known)
    return GymConfig(**arguments)


def check_render_mode(render_mode: str | None) -> None:
    """Raises UnknownName if there is no such mode."""
    if render_mode not in (None, *TaskEnv.metadata["render_modes"]):
        raise UnknownName("render mode", render_mode, TaskEnv.metadata["render_modes"])


def known_options(options: Mapping[str, Any] | None, known: Collection[str]) -> Mapping[str, Any]:
    """The options of a reset. Raises UnknownName if there is one that means nothing."""
    for name in options or {}:
        if name not in known:
            raise UnknownName("option of reset", name, list(known))
    return options or {}


def next_seed(random: np.random.Generator) -> int:
    """The seed of the next episode."""
    return int(random.integers(2**31))


def row_of(values: Mapping[str, np.ndarray], env: int) -> dict[str, Any]:
    """One environment's part of stacked values, on its own."""
    rows = {name: array[env] for name, array in values.items()}
    return {
        name: row.copy() if isinstance(row, np.ndarray) else row.item() if isinstance(row, np.generic) else row
        for name, row in rows.items()
    }


def view_of(episodes: Episodes) -> View:
    """What draws these episodes."""
    return View(episodes.robot, episodes.config.height, episodes.config.width)


def draw(view: View, episodes: Episodes, env: int) -> np.ndarray:
    """A picture of an episode. Raises MimicbenchError before it has begun, NoPictures."""
    qpos, start = episodes.qpos()[env], episodes.starts[env]
    return view.draw(env, start.obj, qpos, start.wrist_goal_w)
