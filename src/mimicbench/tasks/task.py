"""What a task is: an object family, a time limit, and a kinematic metric K over named quantities."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mimicbench.core.motion import RobotMotion
from mimicbench.objects.shape import SceneObject
from mimicbench.robot.description import Robot


@dataclass(frozen=True)
class ObjectFacts:
    """What K needs to know of N objects. Taken from their labels; no policy ever sees it."""

    seat_height: np.ndarray
    """(N,) H [m]; NaN where there is no seat."""
    low: np.ndarray
    """(N, 3) lowest corner of the bounding box [m]."""
    high: np.ndarray
    """(N, 3) highest corner [m]."""

    @staticmethod
    def of(objects: Sequence[SceneObject]) -> "ObjectFacts":
        """Gather the facts of several objects."""
        bounds = [obj.bounds() for obj in objects]
        heights = [np.nan if obj.seat_height is None else obj.seat_height for obj in objects]
        return ObjectFacts(np.array(heights), np.array([low for low, _ in bounds]), np.array([high for _, high in bounds]))

    def interior_xy(self, pos_w: np.ndarray) -> np.ndarray:
        """(N,) whether positions (N, 3) lie in the object's interior in the bird-eye view (appendix D.1)."""
        return np.all((pos_w[:, :2] >= self.low[:, :2]) & (pos_w[:, :2] <= self.high[:, :2]), axis=-1)


@dataclass(frozen=True)
class BodyPoints:
    """The robot's key positions in N scenes, world frame [m]."""

    pelvis_pos_w: np.ndarray
    """(N, 3) the root."""
    ankle_pos_w: np.ndarray
    """(N, 2, 3) left, right."""
    wrist_pos_w: np.ndarray
    """(N, 2, 3) left, right."""

    @staticmethod
    def of(robot: Robot, link_pos_w: np.ndarray, link_quat_w: np.ndarray) -> "BodyPoints":
        """From link poses (N, L, 3) and (N, L, 4)."""

        def pair(name: str) -> np.ndarray:
            return np.stack([robot.keypoint_pos(f"{side}_{name}", link_pos_w, link_quat_w) for side in ("left", "right")], 1)

        return BodyPoints(link_pos_w[:, 0], pair("ankle"), pair("wrist"))


@dataclass(frozen=True)
class Task:
    """One task of the benchmark."""

    slug: str
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
    requires_seat: bool
    """Whether the object must have something to sit or lie on."""
    max_start_distance: float | None
    """[m] Starts are clipped to this distance from the object (appendix C.1)."""

    def hold_frames(self, fps: float) -> int:
        """Frames in a row that count as holding."""
        return max(1, round(self.hold_time * fps))

    def fulfilled(self, motion: RobotMotion, obj: SceneObject, robot: Robot) -> bool:
        """Whether a robot motion fulfils K: the filter between retargeting and tracking (section 4.1)."""
        points = BodyPoints.of(robot, *robot.forward_kinematics(motion.root_pos_w, motion.root_quat_w, motion.joint_pos))
        holds = self.holds(points, ObjectFacts.of([obj] * motion.frames))
        return longest_run(holds) >= self.hold_frames(motion.fps)


def longest_run(values: np.ndarray) -> int:
    """Length of the longest run of true values in (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(values, np.int8), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))
