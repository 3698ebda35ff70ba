"""The clips that episodes follow or start from, laid end to end at the control rate."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from scipy.interpolate import CubicSpline
from torch import Tensor

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.motion import RobotMotion
from mimicbench.robots.description import Robot
from mimicbench.sensors.contact import BEARING
from mimicbench.sensors.context import Frame
from mimicbench.sim.physics import ObjectState
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.task import BodyPoints


class Laid(NamedTuple):
    """A clip at the control rate."""

    id: str
    object_id: str
    robot: np.ndarray
    """(T', 25 + 2 J) pose, velocity, wrists and ankles."""
    bears: np.ndarray
    """(T', B) which parts bear."""
    wrist_goal_w: np.ndarray
    """(2, 3) where left and right wrist are to go [m]; NaN without such a goal."""
    objects: np.ndarray
    """(T', 13) pose and velocities of the object; one row if it stays where it is."""


def lay(motion: RobotMotion, robot: Robot) -> Laid:
    """Resample a clip to the control rate by cubic splines, whose derivatives are the velocities."""
    rows = _robot_rows(motion, robot)
    goal = motion.wrist_goal_w if len(motion.wrist_goal_w) else np.full((2, 3), np.nan)
    bears, objects = _bearing_rows(motion, len(rows)), _object_rows(motion, len(rows))
    return Laid(motion.id, motion.object_id, rows, bears, goal, objects)


class ReferenceBank:
    """C clips in tables of frames. A clip that is over stays at its last frame, at rest."""

    def __init__(self, clips: Sequence[RobotMotion | Laid], robot: Robot, device: str = "cpu") -> None:
        """Lay clips that are not laid yet, end to end.

        `device` is where the tables and all their frames live.
        """
        if not clips:
            raise BadMotion("no clips to track; run `mimicbench retarget` first, or see why it kept none")
        laid = [clip if isinstance(clip, Laid) else lay(clip, robot) for clip in clips]
        self.ids = [clip.id for clip in laid]
        self.object_ids = [clip.object_id for clip in laid]
        self.lengths = torch.tensor([len(clip.robot) for clip in laid], device=device)
        """(C,) frames of each clip."""
        self.starts = torch.cumsum(self.lengths, 0) - self.lengths
        """(C,) row of each clip's first frame."""
        self._table = _joined([clip.robot for clip in laid], device)
        self._joints = len(robot.joints)
        self._bears = _joined([clip.bears for clip in laid], device)
        self.wrist_goal_w = _joined([clip.wrist_goal_w[None] for clip in laid], device)
        """(C, 2, 3) where left and right wrist are to go [m]; NaN without such a goal."""
        # objects that stay where they are need one row for the whole clip
        self._object_last = torch.tensor([len(clip.objects) - 1 for clip in laid], device=device)
        self._object_first = torch.cumsum(self._object_last + 1, 0) - self._object_last - 1
        self._objects = _joined([clip.objects for clip in laid], device)

    def __len__(self) -> int:
        return len(self.ids)

    def frame(self, clip: Tensor, index: Tensor) -> Frame:
        """The frames `index` (N,) of clips `clip` (N,), the last one where a clip is over."""
        place = self.starts[clip] + torch.minimum(index, self.lengths[clip] - 1)
        row = self._table.index_select(0, place)
        j = self._joints
        pos, quat, joint_pos, lin, ang, joint_vel, wrists, ankles = row.split([3, 4, j, 3, 3, j, 6, 6], -1)
        robot = {
            "root_pos_w": pos,
            "root_quat_w": quat,
            "root_lin_vel_w": lin,
            "root_ang_vel_w": ang,
            "joint_pos": joint_pos,
            "joint_vel": joint_vel,
            "wrist_pos_w": wrists.unflatten(-1, (2, 3)),
            "ankle_pos_w": ankles.unflatten(-1, (2, 3)),
        }
        return _BankFrame.at(robot, self, clip, index, place)

    def object(self, clip: Tensor, index: Tensor) -> ObjectState:
        """Where the objects are in the frames `index` (N,) of clips `clip` (N,)."""
        place = self._object_first[clip] + torch.minimum(index, self._object_last[clip])
        return ObjectState(*self._objects[place].split([3, 4, 3, 3], -1))

    def bears(self, place: Tensor) -> Tensor:
        """(N, B) which parts bear in the rows `place` (N,) of the table."""
        return self._bears[place]


class _BankFrame(Frame):
    """Frames of a bank. Beside the robots most trackers ask for nothing, so that is looked up when asked for."""

    _bank: ReferenceBank
    _clip: Tensor
    _index: Tensor
    _place: Tensor

    @classmethod
    def at(
        cls, robot: Mapping[str, Tensor], bank: ReferenceBank, clip: Tensor, index: Tensor, place: Tensor
    ) -> "_BankFrame":
        """Frames `index` (N,) of clips `clip` (N,), in rows `place` (N,) of the table; what they say of the robots."""
        frame = cls.__new__(cls)  # not by its fields, some of which are looked up later
        vars(frame).update(robot, _bank=bank, _clip=clip, _index=index, _place=place)
        return frame

    @cached_property
    def object(self) -> ObjectState:  # type: ignore[override]
        return self._bank.object(self._clip, self._index)

    @cached_property
    def wrist_goal_w(self) -> Tensor:  # type: ignore[override]
        return self._bank.wrist_goal_w[self._clip]

    @cached_property
    def bears(self) -> Tensor:  # type: ignore[override]
        return self._bank.bears(self._place)


def _joined(parts: Sequence[np.ndarray], device: str) -> Tensor:
    return torch.from_numpy(np.concatenate(parts).astype(np.float32)).to(device)


class _Curve(NamedTuple):
    """A pose over time at the control rate."""

    pos: np.ndarray
    quat: np.ndarray
    lin_vel: np.ndarray
    ang_vel_w: np.ndarray


def _at_control_rate(motion: RobotMotion) -> tuple[np.ndarray, np.ndarray]:
    """Times of the clip's frames (T,) and of control steps (T',) [s]."""
    times = np.arange(motion.frames) / motion.fps
    return times, np.arange(int(times[-1] / CONTROL_DT + 1e-6) + 1) * CONTROL_DT


def _pose_curve(times: np.ndarray, at: np.ndarray, pos: np.ndarray, quat: np.ndarray) -> _Curve:
    """Positions and orientations of frames by cubic splines; at rest at the end."""
    quat = quat.copy()
    # a quaternion and its negative are the same turn; keep to one side so that a spline may pass through them
    quat[1:] *= np.cumprod(np.where((quat[1:] * quat[:-1]).sum(-1) < 0, -1.0, 1.0))[:, None]
    along, turning = CubicSpline(times, pos), CubicSpline(times, quat)
    turned = rot.normalize(turning(at))
    lin, ang = along(at, 1), rot.angular_velocity(turned, 1 / CONTROL_DT)
    lin[-1], ang[-1] = 0, 0
    return _Curve(along(at), turned, lin, ang)


def _robot_rows(motion: RobotMotion, robot: Robot) -> np.ndarray:
    """(T', 25 + 2 J) pose, velocity, wrists and ankles."""
    if motion.joint_names != robot.joint_names:
        raise BadMotion(
            f"clip {motion.id} is for {motion.robot!r} with other joints than {robot.name!r}; retarget it again"
        )
    times, at = _at_control_rate(motion)
    root = _pose_curve(times, at, motion.root_pos_w, motion.root_quat_w)
    joints = CubicSpline(times, motion.joint_pos)
    joint_pos = np.clip(joints(at), robot.joint_range[:, 0], robot.joint_range[:, 1])
    joint_vel = joints(at, 1)
    joint_vel[-1] = 0
    links = robot.forward_kinematics(root.pos, root.quat, joint_pos)
    points = BodyPoints.of(robot, *links)
    ends = [pair.reshape(len(at), 6) for pair in (points.wrist_pos_w, points.ankle_pos_w)]
    return np.concatenate([root.pos, root.quat, joint_pos, root.lin_vel, root.ang_vel_w, joint_vel, *ends], -1)


def _bearing_rows(motion: RobotMotion, frames: int) -> np.ndarray:
    """(T', B) 1 where a part bears in the nearest frame of the clip, else 0; zeros for parts without labels."""
    _, at = _at_control_rate(motion)
    nearest = np.minimum(np.round(at * motion.fps).astype(int), motion.frames - 1)
    found = np.zeros((frames, len(BEARING)), np.float32)
    for part, name in enumerate(BEARING):
        if name in motion.contact_names:
            found[:, part] = motion.contacts[nearest, motion.contact_names.index(name)]
    return found


def _object_rows(motion: RobotMotion, frames: int) -> np.ndarray:
    """(T', 13) pose and velocities of the object, angular ones in its own frame; one row if it stays where it is."""
    if not len(motion.object_pos_w):
        return np.array([[0.0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0]])
    times, at = _at_control_rate(motion)
    curve = _pose_curve(times, at, motion.object_pos_w, motion.object_quat_w)
    assert len(at) == frames
    return np.concatenate([curve.pos, curve.quat, curve.lin_vel, rot.rotate_inverse(curve.quat, curve.ang_vel_w)], -1)
