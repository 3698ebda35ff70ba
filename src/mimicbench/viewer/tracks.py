"""What moves on the page: people, clips of robots, and episodes that grow while they are acted out."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Protocol

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.core.skeleton import Skeleton
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.task import BodyPoints, ObjectInfo, Task, first_run, human_points, object_info


@dataclass(frozen=True)
class Pose:
    """One frame of a track, world frame."""

    pos_w: np.ndarray
    """(B, 3) of the bodies: joints of a person, links of a robot [m]."""
    quat_w: np.ndarray
    """(B, 4)."""
    object_pos_w: np.ndarray
    """(3,) [m]."""
    object_quat_w: np.ndarray
    """(4,)."""


@dataclass(frozen=True)
class Curves:
    """What the joints had to do in T control steps."""

    time: np.ndarray
    """(T,) [s] when a step's e is known: where something acts, at its end; of stored states, at its beginning."""
    effort: np.ndarray
    """(T,) e of each step, which P is judged by [W^2]; NaN where it is not known."""
    torque: np.ndarray
    """(T, J) [N m]."""
    power: np.ndarray
    """(T, J) torque times velocity [W]."""

    def until(self, time: float) -> int:
        """How many of the steps are told of by a time [s]: those that end then, too."""
        return int(np.searchsorted(self.time, time + 1e-6, side="right"))


@dataclass(frozen=True)
class State:
    """All that the physics of a scene is in one control step."""

    qpos: np.ndarray
    """(nq,)."""
    qvel: np.ndarray
    """(nv,)."""
    target: np.ndarray
    """(J,) joint targets [rad]."""
    gains: str
    """Which of the robot's gains drive it."""


class Track(Protocol):
    """Somebody's way through time."""

    @property
    def title(self) -> str:
        """What it is called."""
        ...

    @property
    def fps(self) -> float:
        """Frames per second."""
        ...

    @property
    def figure(self) -> Skeleton | Robot:
        """Whose body it is."""
        ...

    def __len__(self) -> int:
        """Frames, by now."""
        ...

    def pose(self, frame: int) -> Pose:
        """Where everything is in a frame."""
        ...

    def lacks(self, frame: int) -> str:
        """What the condition of K lacks in a frame, in words; empty where it holds."""
        ...

    def fulfilled(self) -> int | None:
        """The frame in which K is first fulfilled, by now; of a task judged in its last frame: that one, or None."""
        ...

    def curves(self) -> Curves | None:
        """What the joints had to do; None where nobody knows."""
        ...

    def state(self, frame: int) -> State | None:
        """All that the physics was in a frame; None where there was none."""
        ...


@dataclass(frozen=True)
class Recording:
    """States of a simulation, a row a control step."""

    qpos: np.ndarray
    """(T, nq)."""
    qvel: np.ndarray
    """(T, nv)."""
    target: np.ndarray
    """(T, J) joint targets [rad]."""
    gains: str
    """Which of the robot's gains drove it."""


@dataclass(frozen=True)
class StoredTrack:
    """A motion that is known from its first frame to its last."""

    title: str
    fps: float
    figure: Skeleton | Robot
    task: Task
    pos_w: np.ndarray
    """(T, B, 3) [m]."""
    quat_w: np.ndarray
    """(T, B, 4)."""
    points: BodyPoints
    """Of all frames."""
    info: ObjectInfo
    """Of all frames."""
    known: Curves | None = None
    recording: Recording | None = None
    _holds: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_holds", np.asarray(self.task.holds(self.points, self.info)))

    def __len__(self) -> int:
        return len(self.pos_w)

    def pose(self, frame: int) -> Pose:
        """Where everything is in a frame."""
        return Pose(self.pos_w[frame], self.quat_w[frame], self.info.pos_w[frame], self.info.quat_w[frame])

    def lacks(self, frame: int) -> str:
        """What the condition of K lacks in a frame."""
        one = slice(frame, frame + 1)
        names = (entry.name for entry in fields(BodyPoints))
        points = BodyPoints(*(getattr(self.points, name)[one] for name in names))
        return self.task.failure_reason(points, self.info.map(lambda values: values[one]))[0]

    def fulfilled(self) -> int | None:
        """The frame in which K is first fulfilled."""
        return first_fulfilled(self.task, self._holds, self.fps)

    def curves(self) -> Curves | None:
        """What the joints had to do."""
        return self.known

    def state(self, frame: int) -> State | None:
        """All that the physics was in a frame."""
        if self.recording is None:
            return None
        known = self.recording
        return State(known.qpos[frame], known.qvel[frame], known.target[frame], known.gains)


def first_fulfilled(task: Task, holds: np.ndarray, fps: float) -> int | None:
    """The frame of (T,) in which K is first fulfilled; of a task judged in its last frame: that one, if it is then."""
    needed = task.hold_frames(fps)
    if task.in_last_frame:
        return len(holds) - 1 if len(holds) >= needed and bool(holds[-needed:].all()) else None
    return first_run(holds, needed)


def human_track(task: Task, motion: HumanMotion, obj: SceneObject) -> StoredTrack:
    """A person's clip."""
    pos_w, quat_w = motion.forward_kinematics()
    points, info = human_points(motion, pos_w), object_info(motion, obj)
    return StoredTrack("human", motion.fps, motion.skeleton, task, pos_w, quat_w, points, info)


def robot_track(
    task: Task, motion: RobotMotion, obj: SceneObject, robot: Robot, title: str = "retargeted"
) -> StoredTrack:
    """A clip of a robot."""
    pos_w, quat_w = robot.forward_kinematics(motion.root_pos_w, motion.root_quat_w, motion.joint_pos)
    points, info = BodyPoints.of(robot, pos_w, quat_w), object_info(motion, obj)
    return StoredTrack(title, motion.fps, robot, task, pos_w, quat_w, points, info)


def recorded_track(
    title: str, task: Task, obj: SceneObject, robot: Robot, recording: Recording, wrist_goal_w: np.ndarray
) -> StoredTrack:
    """A stored episode, with targets (2, 3) for the wrists or none (0, 3).

    Its e is worked out of the states at the control steps, not of the substeps as P's is.
    """
    qpos, joints = recording.qpos, len(robot.joints)
    pos_w, quat_w = robot.forward_kinematics(qpos[:, :3], rot.normalize(qpos[:, 3:7]), qpos[:, 7 : 7 + joints])
    info = ObjectInfo.of([obj], [wrist_goal_w]).repeated(len(qpos))
    if obj.movable:
        info = info.moved(qpos[:, -7:-4], qpos[:, -4:])
    velocity = recording.qvel[:, 6 : 6 + joints]
    torque = torques(robot, recording.gains, qpos[:, 7 : 7 + joints], velocity, recording.target)
    power = torque * velocity
    known = Curves(np.arange(len(qpos)) * CONTROL_DT, (power**2).sum(-1), torque, power)
    points = BodyPoints.of(robot, pos_w, quat_w)
    return StoredTrack(title, 1 / CONTROL_DT, robot, task, pos_w, quat_w, points, info, known, recording)


def torques(robot: Robot, gains: str, joint_pos: np.ndarray, joint_vel: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(..., J) what the robot's controllers ask of the joints in a state, within their limits [N m]."""
    chosen, limit = robot.gains[gains], np.array([joint.torque_limit for joint in robot.joints])
    wanted = np.array(chosen.kp) * (target - joint_pos) - np.array(chosen.kd) * joint_vel
    return np.clip(wanted, -limit, limit)
