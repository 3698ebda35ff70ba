"""What a task is: an object family, a time limit, and a kinematic metric K over named quantities."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body.body import body_of
from mimicbench.robots.description import Robot
from mimicbench.robots.rigs import Rig

REST = 1.5
"""[s] What is learned from a clip ends so long after it first fulfils K; clips rest for much longer."""


@dataclass(frozen=True)
class ObjectFacts:
    """What K needs to know of N objects and goals. Taken from their labels; no policy ever sees it."""

    objects: list[SceneObject]
    """One per scene."""
    seat_height: np.ndarray
    """(N,) H [m]; NaN where there is no seat."""
    low: np.ndarray
    """(N, 3) lowest corner of the bounding box at the origin [m]."""
    high: np.ndarray
    """(N, 3) highest corner [m]."""
    pos_w: np.ndarray
    """(N, 3) where the objects are now [m]; the origin unless they move."""
    quat_w: np.ndarray
    """(N, 4) how they are turned now."""
    wrist_goal_w: np.ndarray
    """(N, 2, 3) where left and right wrist are to go [m]; NaN for a wrist without such a goal."""

    @staticmethod
    def of(objects: Sequence[SceneObject], wrist_goals: Sequence[np.ndarray] | None = None) -> "ObjectFacts":
        """Gather the facts of several objects; `wrist_goals` are (2, 3) or empty, one per object."""
        bounds = [obj.bounds() for obj in objects]
        heights = [np.nan if obj.seat_height is None else obj.seat_height for obj in objects]
        nowhere = np.full((2, 3), np.nan)
        goals = (
            [goal if len(goal) else nowhere for goal in wrist_goals]
            if wrist_goals is not None
            else [nowhere] * len(objects)
        )
        n = len(objects)
        return ObjectFacts(
            list(objects),
            np.array(heights),
            np.array([low for low, _ in bounds]),
            np.array([high for _, high in bounds]),
            np.zeros((n, 3)),
            np.tile(rot.IDENTITY, (n, 1)),
            np.array(goals),
        )

    def repeated(self, frames: int) -> "ObjectFacts":
        """Of one scene: the same in each of several frames."""
        return ObjectFacts(
            list(self.objects) * frames,
            *(np.repeat(value, frames, 0) for name, value in vars(self).items() if name != "objects"),
        )

    def moved(self, pos_w: np.ndarray, quat_w: np.ndarray) -> "ObjectFacts":
        """The same with the objects at (N, 3) and turned by (N, 4)."""
        return replace(self, pos_w=pos_w, quat_w=quat_w)

    def exchange(self, ids: np.ndarray, others: "ObjectFacts") -> None:
        """Replace the facts of scenes `ids` (n,), here and now, by those of `others`."""
        for row, env in enumerate(ids):
            self.objects[env] = others.objects[row]
        for name in ("seat_height", "low", "high", "pos_w", "quat_w", "wrist_goal_w"):
            getattr(self, name)[ids] = getattr(others, name)

    def interior_xy(self, pos_w: np.ndarray) -> np.ndarray:
        """(N,) whether positions (N, 3) lie in the fixed object's interior in the bird-eye view (appendix D.1)."""
        return np.all((pos_w[:, :2] >= self.low[:, :2]) & (pos_w[:, :2] <= self.high[:, :2]), axis=-1)

    def on_plane(self, pos_w: np.ndarray, band: float) -> np.ndarray:
        """(N,) whether positions (N, 3) are in the interior seen from above, at a height in [H, H + band] (appendix
        D.1).
        """
        height = pos_w[:, 2] - self.seat_height
        return self.interior_xy(pos_w) & (height >= 0) & (height <= band)

    def distance(self, pos_w: np.ndarray, where: np.ndarray) -> np.ndarray:
        """(N, K) from positions (N, K, 3) to the surface of each object where it is now [m].

        0 inside of it, infinity where not `where` (N,).
        """
        away = np.full(pos_w.shape[:2], np.inf)
        for env in np.flatnonzero(where).tolist():
            away[env] = self.objects[env].distance(rot.rotate_inverse(self.quat_w[env], pos_w[env] - self.pos_w[env]))
        return away


@dataclass(frozen=True)
class BodyPoints:
    """Key positions of the robot, or of a person, in N scenes, world frame [m]."""

    pelvis_pos_w: np.ndarray
    """(N, 3) the root."""
    ankle_pos_w: np.ndarray
    """(N, 2, 3) left, right."""
    wrist_pos_w: np.ndarray
    """(N, 2, 3) left, right."""

    @staticmethod
    def of(robot: Robot, link_pos_w: np.ndarray, link_quat_w: np.ndarray) -> "BodyPoints":
        """From link poses (N, L, 3) and (N, L, 4)."""
        points = [robot.keypoints[f"{side}_{name}"] for name in ("ankle", "wrist") for side in ("left", "right")]
        pos_w = link_pos_w[:, [link for link, _ in points]]
        off = [i for i, (_, offset) in enumerate(points) if any(offset)]  # the others are their links' origins
        pos_w[:, off] += rot.rotate(
            link_quat_w[:, [points[i][0] for i in off]], np.array([points[i][1] for i in off]).reshape(-1, 3)
        )
        return BodyPoints(link_pos_w[:, 0], pos_w[:, :2], pos_w[:, 2:])


@dataclass(frozen=True)
class Task:
    """One task of the benchmark."""

    name: str
    """As on the command line and in artefacts, such as `sit-chair`."""
    abbreviation: str
    """As in the paper's tables."""
    title: str
    family: str
    """Objects it is done with."""
    time_limit: float
    """[s] (appendix C.1)."""
    hold_time: float
    """[s] that the condition has to hold without a break."""
    holds: Callable[[BodyPoints, ObjectFacts], np.ndarray]
    """(N,) whether the condition of K holds in a frame."""
    in_last_frame: bool
    """K is judged in the last frame of the episode, not at any time in it."""
    requires_seat: bool
    """Whether the object must have something to sit or lie on."""
    upright: bool
    """Whether who lies down has fallen."""
    max_start_distance: float | None
    """[m] Starts are clipped to this distance from the object (appendix C.1)."""
    rig: Rig
    """The robot's cameras (appendix C.2)."""
    map_cell: float
    """[m] Side of a cell of the elevation map (appendix C.2)."""
    wrist_goals: bool = False
    """Whether every episode has a target for each wrist."""

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
        body = body_of(motion.skeleton)
        pos_w, _ = motion.forward_kinematics()
        points = BodyPoints(
            pos_w[:, body.pelvis], pos_w[:, [leg.end for leg in body.legs]], pos_w[:, [arm.end for arm in body.arms]]
        )
        return self._judge(self._held(points, motion, obj), motion.fps)

    def trimmed(self, motion: RobotMotion, obj: SceneObject, robot: Robot) -> RobotMotion:
        """A robot motion up to REST seconds after it first fulfils K: nobody needs to learn how to go on resting.

        The motion itself where K is judged in the last frame, or never fulfilled.
        """
        if self.in_last_frame:
            return motion
        end = first_run(self.held(motion, obj, robot), self.hold_frames(motion.fps))
        return motion if end is None else motion.first(end + 1 + round(REST * motion.fps))

    def held(self, motion: RobotMotion, obj: SceneObject, robot: Robot) -> np.ndarray:
        """(T,) whether the condition of K holds in each frame of a robot motion."""
        points = BodyPoints.of(
            robot, *robot.forward_kinematics(motion.root_pos_w, motion.root_quat_w, motion.joint_pos)
        )
        return self._held(points, motion, obj)

    def _held(self, points: BodyPoints, motion: HumanMotion | RobotMotion, obj: SceneObject) -> np.ndarray:
        facts = ObjectFacts.of([obj], [motion.wrist_goal_w]).repeated(motion.frames)
        if len(motion.object_pos_w):
            facts = facts.moved(motion.object_pos_w, motion.object_quat_w)
        return self.holds(points, facts)

    def _judge(self, holds: np.ndarray, fps: float) -> bool:
        needed = self.hold_frames(fps)
        return bool(holds[-needed:].all()) if self.in_last_frame else longest_run(holds) >= needed


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
