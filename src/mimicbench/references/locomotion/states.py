"""What a body does at one moment: where its feet and its pelvis are and how they move, and as far as it is known the
whole pose.
"""

from dataclasses import dataclass, replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.motion import HumanMotion
from mimicbench.core.skeleton import forward_kinematics
from mimicbench.references.body.body import Body, body_of
from mimicbench.references.locomotion.feet import FeetStart
from mimicbench.references.locomotion.route import ahead_of
from mimicbench.references.locomotion.walking import FPS, UPRIGHT, Walk

LONG_AGO = 10.0
"""Since when a foot stands that has not moved yet [s]."""


@dataclass(frozen=True)
class Pose:
    """The joints of a body in motion."""

    local_quat: np.ndarray
    """(J, 4) rotation of each joint relative to its parent; the pelvis's is relative to the world."""
    rate: np.ndarray
    """(J, 3) how fast it turns, in its own frame [rad/s]."""
    known: np.ndarray
    """(J,) bool; joints that are not known begin as a plan does."""


@dataclass(frozen=True)
class RigidState:
    """Where a rigid body is, such as a movable object or a pelvis, and how it moves."""

    pos_w: np.ndarray
    """(3,) of its origin [m]."""
    quat_w: np.ndarray
    """(4,)"""
    vel_w: np.ndarray
    """(3,) [m/s]"""
    rate: np.ndarray
    """(3,) how fast it turns, in its own frame [rad/s]."""


@dataclass(frozen=True)
class FootPoints:
    """What is known of feet whose plan is not; axis 0 is left, right."""

    pos_w: np.ndarray
    """(2, 3) ankles [m]."""
    vel_w: np.ndarray
    """(2, 3) [m/s]"""
    quat_w: np.ndarray
    """(2, 4), level on the floor at yaw 0 when it is the identity."""
    bears: np.ndarray
    """(2,) whether each foot bears."""
    since: np.ndarray | None = None
    """(2,) for how long it has borne or swung [s]; if not given, long ago, and what swings has done so as its height
    tells."""


@dataclass(frozen=True)
class BodyState:
    """A body in motion at one moment; axis 0 of what concerns the feet is left, right."""

    feet: FeetStart
    since: np.ndarray
    """(2,) for how long each foot has borne, or swung [s]."""
    pelvis_pos_w: np.ndarray
    """(3,) [m]."""
    pelvis_vel_w: np.ndarray
    """(3,) [m/s]"""
    yaw: float
    """Heading of the pelvis [rad]."""
    yaw_rate: float
    """[rad/s]"""
    roll: float
    """List of the pelvis, left side up positive [rad]."""
    roll_rate: float
    """[rad/s]"""
    look: float
    """Turn of the head relative to the pelvis [rad]."""
    look_rate: float
    """[rad/s]"""
    lean: float
    """Pitch of the pelvis, forward positive [rad]."""
    lean_rate: float
    """[rad/s]"""
    pose: Pose | None = None
    """All joints; walks and plans begin upright and calm where it is not given."""
    box: RigidState | None = None
    """The movable object, if the task has one; it stands at the origin where it is not given."""

    @property
    def place(self) -> np.ndarray:
        """(2,) where a route from here begins [m]: as far as the pelvis is, in the middle between the feet."""
        middle, forward = self.feet.pos_w[:, :2].mean(0), ahead_of(self.yaw)
        return middle + ((self.pelvis_pos_w[:2] - middle) @ forward) * forward

    def moved(self, xy: np.ndarray, yaw: float) -> "BodyState":
        """The same state with its `place` at (2,) [m] and its heading `yaw` [rad]."""
        turn = rot.from_yaw(np.array(yaw - self.yaw))
        here = np.append(self.place, 0.0)

        def put(points: np.ndarray) -> np.ndarray:
            return rot.rotate(turn, points - here) + np.append(xy, 0.0)

        feet = replace(
            self.feet,
            pos_w=put(self.feet.pos_w),
            vel_w=rot.rotate(turn, self.feet.vel_w),
            yaw=self.feet.yaw + yaw - self.yaw,
        )
        pose, box = self.pose, self.box
        if pose is not None:
            quat = pose.local_quat.copy()
            quat[0] = rot.multiply(turn, quat[0])
            pose = replace(pose, local_quat=quat)
        if box is not None:
            box = replace(
                box, pos_w=put(box.pos_w), quat_w=rot.multiply(turn, box.quat_w), vel_w=rot.rotate(turn, box.vel_w)
            )
        pelvis, velocity = put(self.pelvis_pos_w), rot.rotate(turn, self.pelvis_vel_w)
        return replace(self, feet=feet, pelvis_pos_w=pelvis, pelvis_vel_w=velocity, yaw=yaw, pose=pose, box=box)


def state_of_walk(way: Walk, frame: int) -> BodyState:
    """What the body does at a frame of a walk."""
    now, steps = way.time[frame], way.steps
    since = np.full(2, LONG_AGO)
    for side in (0, 1):
        events = np.concatenate([steps.lift_off[steps.side == side], steps.touch_down[steps.side == side]])
        past = now - events[events <= now + 1e-9]
        since[side] = past.min(initial=LONG_AGO)
    feet = way.feet
    tracks = _rates(
        (
            feet.pos_w,
            feet.yaw,
            feet.pitch,
            way.pelvis_pos_w,
            way.yaw + way.twist,
            way.list,
            way.look,
            way.bend + UPRIGHT,
        ),
        frame,
        FPS,
    )
    return _state(tracks, feet.contact[frame], since)


def state_of_motion(motion: HumanMotion, frame: int) -> BodyState:
    """What the body does at a frame of any clip whose feet have contact labels.

    Raises BadMotion without labels or with a single frame.
    """
    names = [name for name in ("left_foot", "right_foot") if name in motion.contact_names]
    if len(names) < 2 or motion.frames < 2:
        raise BadMotion(
            f"{motion.id}: planning from a frame needs two frames or more and contact labels of both "
            "feet; detect contacts first"
        )
    body = body_of(motion.skeleton)
    first = max(0, frame - 1)
    near = slice(first, frame + 2)
    pos, quat = forward_kinematics(motion.skeleton, motion.root_pos_w[near], motion.local_quat[near])
    ankles = [leg.end for leg in body.legs]
    pelvis = quat[:, body.pelvis]
    yaw, heading, pitch = _headings(pelvis, quat[:, ankles])
    look = rot.wrap_angle(rot.yaw_of(quat[:, body.head]) - yaw)
    tracks = _rates(
        (pos[:, ankles], heading, pitch, pos[:, body.pelvis], yaw, _roll(pelvis), look, _pitch(pelvis)),
        frame - first,
        motion.fps,
    )
    bears = motion.contacts[:, [motion.contact_names.index(name) for name in names]].astype(bool)
    since = np.full(2, LONG_AGO)
    for side in (0, 1):
        changes = np.flatnonzero(np.diff(bears[: frame + 1, side]))
        if len(changes):
            since[side] = (frame - changes[-1] - 0.5) / motion.fps
    return replace(_state(tracks, bears[frame], since), pose=_pose(motion, frame), box=_box(motion, frame))


def state_of_points(body: Body, pelvis: RigidState, feet: FootPoints, box: RigidState | None = None) -> BodyState:
    """The state of who is only known by pelvis and feet, such as a robot; trunk, head and arms begin as a plan does.

    Args:
        body: The person who stands for it, whose legs must be as long.
        pelvis: Its pelvis.
        feet: Its feet.
        box: The movable object, if there is one.
    """
    yaw = float(rot.yaw_of(pelvis.quat_w))
    _, heading, pitch = _headings(pelvis.quat_w[None], feet.quat_w[None])
    vel, still = np.where(feet.bears[:, None], 0.0, feet.vel_w), np.zeros(2)
    start = FeetStart(feet.pos_w, vel, heading[0], still, pitch[0], still, feet.bears)
    joints = len(body.skeleton.joint_names)
    quat, rate = np.tile(rot.IDENTITY, (joints, 1)), np.zeros((joints, 3))
    quat[body.pelvis], rate[body.pelvis] = pelvis.quat_w, pelvis.rate
    turning = float(rot.rotate(pelvis.quat_w, pelvis.rate)[2])
    since = np.full(2, LONG_AGO) if feet.since is None else feet.since
    pose = Pose(quat, rate, np.arange(joints) == body.pelvis)
    return BodyState(
        start,
        since,
        pelvis.pos_w,
        pelvis.vel_w,
        yaw,
        turning,
        float(_roll(pelvis.quat_w)),
        0.0,
        0.0,
        0.0,
        float(_pitch(pelvis.quat_w)),
        0.0,
        pose,
        box,
    )


def _headings(pelvis: np.ndarray, foot: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Headings (T,) of the pelvis (T, 4), (T, 2) of the feet (T, 2, 4), and the feet's pitch (T, 2) [rad].

    Headings of the feet are given near that of the pelvis, so that none is a turn away.
    """
    yaw = np.unwrap(rot.yaw_of(pelvis))
    return yaw, yaw[:, None] + rot.wrap_angle(rot.yaw_of(foot) - yaw[:, None]), _pitch(foot)


def _roll(quat: np.ndarray) -> np.ndarray:
    w, x, y, z = np.moveaxis(quat, -1, 0)
    return np.arctan2(2 * (w * x + y * z), 1 - 2 * (x**2 + y**2))


def _pitch(quat: np.ndarray) -> np.ndarray:
    return np.arcsin(np.clip(-rot.rotate(quat, np.array([1.0, 0.0, 0.0]))[..., 2], -1, 1))


def _turning(quat: np.ndarray, frame: int, fps: float) -> np.ndarray:
    """(..., 3) how fast rotations (T, ..., 4) turn at a frame, in their own frame [rad/s]."""
    before, behind = max(0, frame - 1), min(len(quat) - 1, frame + 1)
    return rot.to_rotvec(rot.multiply(rot.conjugate(quat[before]), quat[behind])) * fps / (behind - before)


def _pose(motion: HumanMotion, frame: int) -> Pose:
    joints = len(motion.skeleton.joint_names)
    return Pose(motion.local_quat[frame], _turning(motion.local_quat, frame, motion.fps), np.ones(joints, bool))


def _box(motion: HumanMotion, frame: int) -> RigidState | None:
    if not len(motion.object_pos_w):
        return None
    ((pos, velocity),) = _rates((motion.object_pos_w,), frame, motion.fps)
    return RigidState(pos, motion.object_quat_w[frame], velocity, _turning(motion.object_quat_w, frame, motion.fps))


def _rates(tracks: tuple[np.ndarray, ...], frame: int, fps: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Values of tracks (T, ...) at a frame, and how fast they change there."""
    before, behind = max(0, frame - 1), min(len(tracks[0]) - 1, frame + 1)
    return [(track[frame], (track[behind] - track[before]) * fps / max(1, behind - before)) for track in tracks]


def _state(tracks: list[tuple[np.ndarray, np.ndarray]], bears: np.ndarray, since: np.ndarray) -> BodyState:
    ankles, foot_yaw, foot_pitch, pelvis, yaw, roll, look, lean = tracks
    # what bears is still, whatever the differences across its landing say
    feet = FeetStart(*ankles, *foot_yaw, *foot_pitch, bears)
    return BodyState(
        feet,
        since,
        *pelvis,
        float(yaw[0]),
        float(yaw[1]),
        float(roll[0]),
        float(roll[1]),
        float(look[0]),
        float(look[1]),
        float(lean[0]),
        float(lean[1]),
    )
