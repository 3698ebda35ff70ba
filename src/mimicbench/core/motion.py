"""The motions that flow between the stages, and how they are stored.

Conventions of every array here: world frame z up, metres, radians, quaternions wxyz; the object stands at the
origin facing +x; `_w` world frame; T frames at `fps`. The files are `.npz` without pickles that say all of this
themselves: names, orders, frame and rate travel inside (see docs/formats.md).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.files import read_npz, write_npz
from mimicbench.core.motion_file import (
    SCHEMA,
    check_contacts,
    check_conventions,
    check_frames,
    check_scene,
    check_unit,
    documented,
    read_id,
    read_quat,
    read_scene,
    scene_arrays,
)
from mimicbench.core.skeleton import Skeleton, forward_kinematics


@dataclass(frozen=True)
class HumanMotion:
    """A human clip: local joint rotations on a skeleton, next to an object."""

    id: str
    task: str
    skeleton: Skeleton
    fps: float
    root_pos_w: np.ndarray
    """(T, 3) position of the root joint [m]."""
    local_quat: np.ndarray
    """(T, J, 4) rotation of each joint relative to its parent; the root's is relative to the world."""
    object_id: str
    contact_names: tuple[str, ...] = ()
    contacts: np.ndarray = field(default_factory=lambda: np.zeros((0, 0), bool))
    """(T, C) whether each body of `contact_names` bears on the floor or the object."""
    style: Mapping[str, float] = field(default_factory=dict)
    """What the clip chose beyond start pose and object, by name."""
    source: str = "synthetic"
    """Where it came from: `synthetic`, or the imported file's name."""
    object_pos_w: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    """(T, 3) where a movable object's origin is [m]; empty if the object stays at the origin."""
    object_quat_w: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))
    """(T, 4) how it is turned; empty if it stays."""
    wrist_goal_w: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    """(2, 3) where left and right wrist are to go [m], NaN for a hand that has nothing to do; empty if the task has no
    such goal."""

    def __post_init__(self) -> None:
        joints = len(self.skeleton.joint_names)
        check_frames(
            self.id, self.fps, {"root_pos_w": (self.root_pos_w, (3,)), "local_quat": (self.local_quat, (joints, 4))}
        )
        check_unit(self.id, "local_quat", self.local_quat)
        check_contacts(self.id, self.frames, self.contact_names, self.contacts)
        check_scene(self.id, self.frames, self.object_pos_w, self.object_quat_w, self.wrist_goal_w)

    @property
    def frames(self) -> int:
        """T."""
        return len(self.root_pos_w)

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return (self.frames - 1) / self.fps

    def forward_kinematics(self) -> tuple[np.ndarray, np.ndarray]:
        """World positions (T, J, 3) [m] and orientations (T, J, 4) of all joints."""
        return forward_kinematics(self.skeleton, self.root_pos_w, self.local_quat)

    def thinned(self, step: int) -> "HumanMotion":
        """Every `step`-th frame of it."""
        names = ("root_pos_w", "local_quat", "contacts", "object_pos_w", "object_quat_w")
        return replace(self, fps=self.fps / step, **{name: getattr(self, name)[::step] for name in names})

    def save(self, path: Path) -> None:
        """Write one `.npz` file, atomically."""
        header = {
            "schema": SCHEMA,
            "type": "human_motion",
            "id": self.id,
            "task": self.task,
            "skeleton": self.skeleton.name,
            "joint_names": list(self.skeleton.joint_names),
            "parents": list(self.skeleton.parents),
            "fps": self.fps,
            "object_id": self.object_id,
            "contact_names": list(self.contact_names),
            "style": dict(self.style),
            "source": self.source,
            "quaternion_order": "wxyz",
            "frame": "z up, object at the origin facing +x",
            "units": "m, s, rad",
        }
        write_npz(
            path,
            header,
            {
                "offsets": self.skeleton.offsets,
                "root_pos_w": self.root_pos_w.astype(np.float32),
                "local_quat": self.local_quat.astype(np.float32),
                "contacts": self.contacts,
                **scene_arrays(self.object_pos_w, self.object_quat_w, self.wrist_goal_w),
            },
        )

    @staticmethod
    def load(path: Path) -> "HumanMotion":
        """Read a file that `save` wrote. Raises BadFile or BadMotion."""
        header, data = read_npz(path, "human_motion")
        check_conventions(path, header)
        with documented(path):
            skeleton = Skeleton(
                header["skeleton"],
                tuple(header["joint_names"]),
                tuple(header["parents"]),
                data["offsets"].astype(float),
            )
            return HumanMotion(
                read_id(header, "id"),
                header["task"],
                skeleton,
                header["fps"],
                data["root_pos_w"].astype(float),
                read_quat(data["local_quat"]),
                read_id(header, "object_id"),
                tuple(header["contact_names"]),
                data["contacts"],
                header["style"],
                header["source"],
                **read_scene(data),
            )


@dataclass(frozen=True)
class RobotMotion:
    """A robot clip: free root and joint angles, next to an object."""

    id: str
    task: str
    robot: str
    joint_names: tuple[str, ...]
    fps: float
    root_pos_w: np.ndarray
    """(T, 3) position of the root link [m]."""
    root_quat_w: np.ndarray
    """(T, 4) orientation of the root link."""
    joint_pos: np.ndarray
    """(T, N) joint angles [rad] in the order of `joint_names`."""
    object_id: str
    reference_id: str
    """The human clip that it was made from."""
    contact_names: tuple[str, ...] = ()
    contacts: np.ndarray = field(default_factory=lambda: np.zeros((0, 0), bool))
    """(T, C) contact labels carried over from the human clip."""
    style: Mapping[str, float] = field(default_factory=dict)
    measures: Mapping[str, float] = field(default_factory=dict)
    """What the retargeting measured of itself, by name."""
    success: bool = True
    """Whether the clip fulfils the task's kinematic metric K."""
    object_pos_w: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    """(T, 3) where a movable object's origin is [m]; empty if the object stays at the origin."""
    object_quat_w: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))
    """(T, 4) how it is turned; empty if it stays."""
    wrist_goal_w: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    """(2, 3) where left and right wrist are to go [m], NaN for a hand that has nothing to do; empty if the task has no
    such goal."""

    def __post_init__(self) -> None:
        n = len(self.joint_names)
        arrays = {
            "root_pos_w": (self.root_pos_w, (3,)),
            "root_quat_w": (self.root_quat_w, (4,)),
            "joint_pos": (self.joint_pos, (n,)),
        }
        check_frames(self.id, self.fps, arrays)
        check_unit(self.id, "root_quat_w", self.root_quat_w)
        check_contacts(self.id, self.frames, self.contact_names, self.contacts)
        check_scene(self.id, self.frames, self.object_pos_w, self.object_quat_w, self.wrist_goal_w)

    @property
    def frames(self) -> int:
        """T."""
        return len(self.root_pos_w)

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return (self.frames - 1) / self.fps

    def first(self, frames: int) -> "RobotMotion":
        """Its first so many frames, or all of them if there are fewer."""
        if frames >= self.frames:
            return self
        per_frame = ("root_pos_w", "root_quat_w", "joint_pos", "contacts", "object_pos_w", "object_quat_w")
        return replace(self, **{name: getattr(self, name)[:frames] for name in per_frame})

    def resampled(self, fps: float) -> "RobotMotion":
        """The same motion at another frame rate."""
        if fps == self.fps:
            return self
        contacts = self.contacts
        if contacts.size:
            contacts = contacts[np.round(rot.resample_times(self.frames, self.fps, fps)).astype(int)]
        return replace(
            self,
            fps=fps,
            contacts=contacts,
            root_pos_w=rot.resample(self.root_pos_w, self.fps, fps),
            root_quat_w=rot.resample_quat(self.root_quat_w, self.fps, fps),
            joint_pos=rot.resample(self.joint_pos, self.fps, fps),
            **self._resampled_object(fps),
        )

    def _resampled_object(self, fps: float) -> dict[str, np.ndarray]:
        if not len(self.object_pos_w):
            return {}
        return {
            "object_pos_w": rot.resample(self.object_pos_w, self.fps, fps),
            "object_quat_w": rot.resample_quat(self.object_quat_w, self.fps, fps),
        }

    def save(self, path: Path) -> None:
        """Write one `.npz` file, atomically."""
        header = {
            "schema": SCHEMA,
            "type": "robot_motion",
            "id": self.id,
            "task": self.task,
            "robot": self.robot,
            "joint_names": list(self.joint_names),
            "fps": self.fps,
            "object_id": self.object_id,
            "reference_id": self.reference_id,
            "contact_names": list(self.contact_names),
            "style": dict(self.style),
            "measures": dict(self.measures),
            "success": self.success,
            "quaternion_order": "wxyz",
            "frame": "z up, object at the origin facing +x",
            "units": "m, s, rad",
        }
        write_npz(
            path,
            header,
            {
                "root_pos_w": self.root_pos_w.astype(np.float32),
                "root_quat_w": self.root_quat_w.astype(np.float32),
                "joint_pos": self.joint_pos.astype(np.float32),
                "contacts": self.contacts,
                **scene_arrays(self.object_pos_w, self.object_quat_w, self.wrist_goal_w),
            },
        )

    @staticmethod
    def load(path: Path, robot: str | None = None) -> "RobotMotion":
        """Read a file that `save` wrote; `robot` is the one it must be for. Raises BadFile or BadMotion."""
        header, data = read_npz(path, "robot_motion")
        check_conventions(path, header)
        with documented(path):
            if robot is not None and header["robot"] != robot:
                raise BadMotion(
                    f"{path} is a motion of robot {header['robot']!r}, not of {robot!r}; retarget its "
                    f"reference to {robot!r} first"
                )
            return RobotMotion(
                read_id(header, "id"),
                header["task"],
                header["robot"],
                tuple(header["joint_names"]),
                header["fps"],
                data["root_pos_w"].astype(float),
                read_quat(data["root_quat_w"]),
                data["joint_pos"].astype(float),
                read_id(header, "object_id"),
                read_id(header, "reference_id"),
                tuple(header["contact_names"]),
                data["contacts"],
                header["style"],
                header["measures"],
                header["success"],
                **read_scene(data),
            )
