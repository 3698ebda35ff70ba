"""What a task is: an object family, a time limit, and a kinematic metric K over named quantities."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.objects.shape import SLOTS, SceneObject
from mimicbench.references.body.body import body_of
from mimicbench.robots.description import Robot
from mimicbench.robots.rigs import Rig
from mimicbench.tasks.body_points import Array, BodyPoints
from mimicbench.tasks.goal import GoalSpec

_FAR = 1e6
"""[m] Where boxes are that an object does not have."""
SLACK = 0.05
"""[m] A clip may miss the condition of K by so much while it rests: robots settle lower than they were retargeted, and
one chair's clip in ten ends up to 4 cm above where a seated pelvis may be."""

REST = 1.5
"""[s] What is learned from a clip goes on at least so long after it first fulfils K."""
STILL, PAUSE = 0.1, 0.5
"""[rad], [s] At rest is who had no joint farther away than this for this time."""


@dataclass(frozen=True)
class ObjectInfo:
    """What K needs to know of N objects and goals. Taken from their labels; no policy ever sees it."""

    seat_height: Array
    """(N,) H [m]; NaN where there is no seat."""
    low: Array
    """(N, 3) lowest corner of the bounding box at the origin [m]."""
    high: Array
    """(N, 3) highest corner [m]."""
    box_pos: Array
    """(N, SLOTS, 3) centers of the boxes in the object's frame [m]; far away for slots that it leaves empty."""
    box_quat: Array
    """(N, SLOTS, 4) how they are turned."""
    box_half: Array
    """(N, SLOTS, 3) half sizes [m]."""
    pos_w: Array
    """(N, 3) where the objects are now [m]; the origin unless they move."""
    quat_w: Array
    """(N, 4) how they are turned now."""
    wrist_goal_w: Array
    """(N, 2, 3) where left and right wrist are to go [m]; NaN for a wrist without such a goal."""

    @staticmethod
    def of(objects: Sequence[SceneObject], wrist_goals: Sequence[np.ndarray] | None = None) -> "ObjectInfo":
        """Gather what is known of several objects; `wrist_goals` are (2, 3) or empty, one per object."""
        n = len(objects)
        boxes = np.full((n, SLOTS, 3), _FAR), np.tile(rot.IDENTITY, (n, SLOTS, 1)), np.ones((n, SLOTS, 3))
        for row, obj in enumerate(objects):
            for array, values in zip(boxes, (obj.box_pos, obj.box_quat, obj.box_half), strict=True):
                array[row, : len(values)] = values
        bounds = [obj.bounds() for obj in objects]
        heights = [np.nan if obj.seat_height is None else obj.seat_height for obj in objects]
        nowhere = np.full((2, 3), np.nan)
        goals = [nowhere] * n if wrist_goals is None else [goal if len(goal) else nowhere for goal in wrist_goals]
        low, high = (np.array(corners) for corners in zip(*bounds, strict=True))
        pose = np.zeros((n, 3)), np.tile(rot.IDENTITY, (n, 1))
        return ObjectInfo(np.array(heights), low, high, *boxes, *pose, np.array(goals))

    def map(self, function: Callable[[Array], Array]) -> "ObjectInfo":
        """The same with every array replaced by what `function` makes of it."""
        return ObjectInfo(*(function(value) for value in vars(self).values()))

    def repeated(self, frames: int) -> "ObjectInfo":
        """Of one scene: the same in each of several frames."""
        return self.map(lambda value: np.broadcast_to(value, (frames, *value.shape[1:])))

    def moved(self, pos_w: Array, quat_w: Array) -> "ObjectInfo":
        """The same with the objects at (N, 3) and turned by (N, 4)."""
        return replace(self, pos_w=pos_w, quat_w=quat_w)

    def interior_xy(self, pos_w: Array) -> Array:
        """(N,) whether positions (N, 3) lie in the fixed object's interior in the bird-eye view (appendix D.1)."""
        return ((pos_w[:, :2] >= self.low[:, :2]) & (pos_w[:, :2] <= self.high[:, :2])).all(-1)

    def on_plane(self, pos_w: Array, band: float) -> Array:
        """(N,) whether positions (N, 3) are in the interior seen from above, at a height in [H, H + band]."""
        height = pos_w[:, 2] - self.seat_height
        return self.interior_xy(pos_w) & (height >= 0) & (height <= band)

    def beside(self, pos_w: np.ndarray) -> np.ndarray:
        """(N,) how far positions (N, 3) are outside of the interior in the bird-eye view [m]; in it, as a negative
        number, how far they are from its edge.
        """
        out = np.maximum(self.low[:, :2] - pos_w[:, :2], pos_w[:, :2] - self.high[:, :2])
        return np.linalg.norm(np.maximum(out, 0.0), axis=-1) + np.minimum(out.max(-1), 0.0)

    def away(self, pos_w: np.ndarray) -> np.ndarray:
        """(N, K) how far positions (N, K, 3) are from the object's surface [m]; 0 inside."""
        local = rot.rotate_inverse(self.quat_w[:, None], pos_w - self.pos_w[:, None])
        away = rot.rotate_inverse(self.box_quat[:, None], local[:, :, None] - self.box_pos[:, None])
        return np.linalg.norm(np.maximum(np.abs(away) - self.box_half[:, None], 0.0), axis=-1).min(-1)

    def within(self, pos_w: Array, reach: float) -> Array:
        """(N, K) whether positions (N, K, 3) are no farther than `reach` [m] from the object's surface, or inside."""
        local = rot.rotate_inverse(self.quat_w[:, None], pos_w - self.pos_w[:, None])
        away = rot.rotate_inverse(self.box_quat[:, None], local[:, :, None] - self.box_pos[:, None])
        outside = (abs(away) - self.box_half[:, None]).clip(0.0)
        return ((outside * outside).sum(-1) <= reach * reach).any(-1)


@dataclass(frozen=True)
class Shortfall:
    """One thing that the condition of K asks for, and how much of it is missing."""

    words: str
    """What is wrong; `{}` stands for how much, such as `pelvis {} too high`."""
    measure: Callable[[BodyPoints, ObjectInfo], np.ndarray]
    """(N,) how much [m], of NumPy arrays; at most 0 where nothing is missing, NaN where nothing is asked for."""


@dataclass(frozen=True)
class Task:
    """One task of the benchmark."""

    name: str
    """As on the command line and in artefacts, such as `sit-chair`."""
    abbreviation: str
    """As in the paper's tables."""
    title: str
    action: str
    """What is done at the object, as in "fell while sitting down"."""
    family: str
    """Objects it is done with."""
    time_limit: float
    """[s] (appendix C.1)."""
    hold_time: float
    """[s] that the condition has to hold without a break."""
    holds: Callable[[BodyPoints, ObjectInfo], np.ndarray]
    """(N,) whether the condition of K holds in a frame."""
    shortfalls: tuple[Shortfall, ...]
    """The same condition in parts: it holds where none of them is above 0."""
    goal: GoalSpec
    """What the robot has to find, or is told."""
    in_last_frame: bool
    """K is judged in the last frame of the episode, not at any time in it."""
    requires_seat: bool
    """Whether the object must have something to sit or lie on."""
    upright: bool
    """Whether who leans as far as one who lies has fallen; not where one lies down, or bends down to the floor."""
    max_start_distance: float | None
    """[m] Starts are clipped to this distance from the object (appendix C.1)."""
    rig: Rig
    """The robot's cameras (appendix C.2)."""
    map_cell: float
    """[m] Side of a cell of the elevation map (appendix C.2)."""
    wrist_goals: bool = False
    """Whether every episode has a target for each wrist."""
    rest: float = REST
    """[s] What is learned from a clip ends at the latest so long after it first fulfils K; clips rest for much
    longer."""
    moves_object: bool = False
    """Whether the object is to be moved."""
    height_weight: float = 10.0
    """lambda_height of the paper's tracking reward (appendix F.3)."""

    def failure_reason(self, body: BodyPoints, obj: ObjectInfo) -> list[str]:
        """(N,) what the condition of K lacks in each scene, of NumPy arrays, the most first; empty where it holds.

        Such as `pelvis 3 cm beside the seat, pelvis 1 cm too high`.
        """
        missing = np.array([part.measure(body, obj) for part in self.shortfalls])
        words = [part.words for part in self.shortfalls]
        return [
            ", ".join(words[i].format(_centimeters(row[i])) for i in np.argsort(-row, kind="stable") if row[i] > 0)
            for row in missing.T
        ]

    def __reduce__(self) -> tuple[Any, ...]:
        """Workers are sent a registered task's name: its functions need not be such as can be sent."""
        from mimicbench.tasks.registry import TASKS

        if self.name in TASKS and TASKS.get(self.name) is self:
            return _registered, (self.name,)
        return Task, tuple(getattr(self, entry.name) for entry in fields(self))

    def hold_frames(self, fps: float) -> int:
        """Frames in a row that count as holding."""
        return max(1, round(self.hold_time * fps))

    def fulfilled(self, motion: RobotMotion, obj: SceneObject, robot: Robot) -> bool:
        """Whether a robot motion fulfils K: the filter between retargeting and tracking (section 4.1)."""
        return self._judge(self.held(motion, obj, robot), motion.fps)

    def fulfilled_by_human(self, motion: HumanMotion, obj: SceneObject) -> bool:
        """Whether a human motion fulfils K, with the person's pelvis, ankles and wrists in place of the robot's: the
        filter before retargeting.
        """
        points = human_points(motion, motion.forward_kinematics()[0])
        return self._judge(self.holds(points, object_info(motion, obj)), motion.fps)

    def trimmed(self, motion: RobotMotion, obj: SceneObject, robot: Robot) -> RobotMotion:
        """A robot motion up to where it comes to rest, REST to `rest` seconds after it first fulfils K: nobody needs to
        learn how to go on resting.

        Where its condition is lost by more than SLACK before that, as by people who cross their legs once they lie,
        half of the way to there: the last pose is held from then on, and K would not hold in it. The motion itself
        where K is judged in the last frame, or never fulfilled.
        """
        if self.in_last_frame:
            return motion
        points, info = _robot_points(motion, robot), object_info(motion, obj)
        end = first_run(self.holds(points, info), self.hold_frames(motion.fps))
        if end is None:
            return motion
        last = _at_rest(motion, end + round(REST * motion.fps), end + round(self.rest * motion.fps))
        missing = np.nanmax([part.measure(points, info) for part in self.shortfalls], axis=0)
        lost = np.flatnonzero(missing[end : last + 1] > SLACK)
        if len(lost):
            last = end + int(lost[0]) // 2
        return motion.first(last + 1)

    def held(self, motion: RobotMotion, obj: SceneObject, robot: Robot) -> np.ndarray:
        """(T,) whether the condition of K holds in each frame of a robot motion."""
        return self.holds(_robot_points(motion, robot), object_info(motion, obj))

    def _judge(self, holds: np.ndarray, fps: float) -> bool:
        needed = self.hold_frames(fps)
        return bool(holds[-needed:].all()) if self.in_last_frame else longest_run(holds) >= needed


def _at_rest(motion: RobotMotion, first: int, last: int) -> int:
    """The first frame in first..last that no joint was farther than STILL away from for PAUSE, or if there is none, as
    of who turns over at once, that in which joints had moved least.
    """
    pause, pos = round(PAUSE * motion.fps), motion.joint_pos
    frames = range(first, min(last, motion.frames - 1) + 1)
    if len(frames) < 2:
        return first
    moved = [np.abs(pos[frame - pause : frame] - pos[frame]).max() for frame in frames]
    still = np.flatnonzero(np.array(moved) <= STILL)
    return first + int(still[0] if len(still) else np.argmin(moved))


def _robot_points(motion: RobotMotion, robot: Robot) -> BodyPoints:
    return BodyPoints.of(robot, *robot.forward_kinematics(motion.root_pos_w, motion.root_quat_w, motion.joint_pos))


def object_info(motion: HumanMotion | RobotMotion, obj: SceneObject) -> ObjectInfo:
    """Object and goals in each frame of a motion."""
    info = ObjectInfo.of([obj], [motion.wrist_goal_w]).repeated(motion.frames)
    if len(motion.object_pos_w):
        info = info.moved(motion.object_pos_w, motion.object_quat_w)
    return info


def human_points(motion: HumanMotion, joint_pos_w: np.ndarray) -> BodyPoints:
    """What K looks at, of a person whose joints are at (T, J, 3) [m]."""
    body = body_of(motion.skeleton)
    ends = [[limb.end for limb in limbs] for limbs in (body.legs, body.arms)]
    return BodyPoints(joint_pos_w[:, body.pelvis], joint_pos_w[:, ends[0]], joint_pos_w[:, ends[1]])


def _centimeters(length: float) -> str:
    """Such as `3 cm`."""
    return f"{100 * length:.0f} cm" if length > 0.015 else f"{1000 * length:.1f} mm"


def _registered(name: str) -> Task:
    from mimicbench.tasks.registry import TASKS

    return TASKS.get(name)


def longest_run(values: np.ndarray) -> int:
    """Length of the longest run of true values in (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(values, np.int8), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def first_run(values: np.ndarray, length: int) -> int | None:
    """Index of the frame that first ends a run of `length` true values in (T,); None if there is no such run."""
    if len(values) < length:
        return None
    ends = np.flatnonzero(np.lib.stride_tricks.sliding_window_view(np.asarray(values, bool), length).all(-1))
    return int(ends[0]) + length - 1 if len(ends) else None
