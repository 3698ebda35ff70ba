"""The motions that flow between the stages, and how they are stored.

Conventions of every array here: world frame z up, metres, radians, quaternions wxyz; the object stands at the
origin facing +x; `_w` world frame; T frames at `fps`. The files are `.npz` without pickles that say all of this
themselves: names, orders, frame and rate travel inside (see docs/formats.md).
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.files import read_npz, write_npz

SCHEMA = 1
MAX_FRAMES = 200_000  # more than an hour at 50 fps: nothing we read is longer


@dataclass(frozen=True)
class Skeleton:
    """A tree of joints. Parents come before their children."""

    name: str
    joint_names: tuple[str, ...]
    parents: tuple[int, ...]
    """Index of each joint's parent, -1 for the root."""
    offsets: np.ndarray
    """(J, 3) rest position of each joint in its parent's frame [m]; x forward, y left, z up in the rest pose."""

    def __post_init__(self) -> None:
        joints = len(self.joint_names)
        if len(self.parents) != joints or self.offsets.shape != (joints, 3) or not np.isfinite(self.offsets).all():
            raise BadMotion(
                f"skeleton {self.name} needs a parent and three finite offsets for each of its {joints} joints"
            )
        if any(not -1 <= parent < i for i, parent in enumerate(self.parents)):
            raise BadMotion(f"skeleton {self.name}: parents must come before their children; sort its joints")

    def scaled(self, factor: float) -> "Skeleton":
        """The same tree with every bone `factor` times as long."""
        return replace(self, offsets=self.offsets * factor)

    def index(self, joint: str) -> int:
        """Index of a joint by name."""
        try:
            return self.joint_names.index(joint)
        except ValueError:
            raise BadMotion(
                f"skeleton {self.name} has no joint {joint!r}; it has {', '.join(self.joint_names)}"
            ) from None


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
        _check_frames(
            self.id, self.fps, {"root_pos_w": (self.root_pos_w, (3,)), "local_quat": (self.local_quat, (joints, 4))}
        )
        _check_unit(self.id, "local_quat", self.local_quat)
        _check_contacts(self.id, self.frames, self.contact_names, self.contacts)
        _check_scene(self.id, self.frames, self.object_pos_w, self.object_quat_w, self.wrist_goal_w)

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
                **_scene_arrays(self),
            },
        )

    @staticmethod
    def load(path: Path) -> "HumanMotion":
        """Read a file that `save` wrote. Raises BadFile or BadMotion."""
        header, data = read_npz(path, "human_motion")
        _check_conventions(path, header)
        with _documented(path):
            skeleton = Skeleton(
                header["skeleton"],
                tuple(header["joint_names"]),
                tuple(header["parents"]),
                data["offsets"].astype(float),
            )
            return HumanMotion(
                header["id"],
                header["task"],
                skeleton,
                header["fps"],
                data["root_pos_w"].astype(float),
                _read_quat(data["local_quat"]),
                header["object_id"],
                tuple(header["contact_names"]),
                data["contacts"],
                header["style"],
                header["source"],
                **_read_scene(data),
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
        _check_frames(self.id, self.fps, arrays)
        _check_unit(self.id, "root_quat_w", self.root_quat_w)
        _check_contacts(self.id, self.frames, self.contact_names, self.contacts)
        _check_scene(self.id, self.frames, self.object_pos_w, self.object_quat_w, self.wrist_goal_w)

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
                **_scene_arrays(self),
            },
        )

    @staticmethod
    def load(path: Path, robot: str | None = None) -> "RobotMotion":
        """Read a file that `save` wrote; `robot` is the one it must be for. Raises BadFile or BadMotion."""
        header, data = read_npz(path, "robot_motion")
        _check_conventions(path, header)
        with _documented(path):
            if robot is not None and header["robot"] != robot:
                raise BadMotion(
                    f"{path} is a motion of robot {header['robot']!r}, not of {robot!r}; retarget its "
                    f"reference to {robot!r} first"
                )
            return RobotMotion(
                header["id"],
                header["task"],
                header["robot"],
                tuple(header["joint_names"]),
                header["fps"],
                data["root_pos_w"].astype(float),
                _read_quat(data["root_quat_w"]),
                data["joint_pos"].astype(float),
                header["object_id"],
                header["reference_id"],
                tuple(header["contact_names"]),
                data["contacts"],
                header["style"],
                header["measures"],
                header["success"],
                **_read_scene(data),
            )


def forward_kinematics(
    skeleton: Skeleton, root_pos_w: np.ndarray, local_quat: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """World positions (..., J, 3) and orientations (..., J, 4) from root positions (..., 3) and local rotations
    (..., J, 4).

    G_i = G_parent q_i and p_i = p_parent + G_parent offset_i.
    """
    pos = np.empty((*local_quat.shape[:-1], 3))
    quat = np.empty(local_quat.shape)
    for i, parent in enumerate(skeleton.parents):
        if parent < 0:
            pos[..., i, :], quat[..., i, :] = root_pos_w, local_quat[..., i, :]
        else:
            pos[..., i, :] = pos[..., parent, :] + rot.rotate(quat[..., parent, :], skeleton.offsets[i])
            quat[..., i, :] = rot.multiply(quat[..., parent, :], local_quat[..., i, :])
    return pos, quat


def _check_frames(clip: str, fps: float, arrays: dict[str, tuple[np.ndarray, tuple[int, ...]]]) -> None:
    if not (np.isfinite(fps) and 1 <= fps <= 1000):
        raise BadMotion(f"clip {clip}: {fps} frames per second is not a frame rate; give one between 1 and 1000")
    frames = len(next(iter(arrays.values()))[0])
    if not 2 <= frames <= MAX_FRAMES:
        raise BadMotion(f"clip {clip} has {frames} frames; a motion needs between 2 and {MAX_FRAMES}")
    for name, (array, shape) in arrays.items():
        if array.shape != (frames, *shape):
            raise BadMotion(f"clip {clip}: {name} has shape {array.shape}, expected {(frames, *shape)}")
        if not np.isfinite(array).all():
            raise BadMotion(f"clip {clip}: {name} holds NaN or infinity; mend or drop the clip")


def _check_unit(clip: str, name: str, quat: np.ndarray) -> None:
    worst = np.abs((quat**2).sum(-1) - 1).max()
    if worst > 1e-2:
        raise BadMotion(
            f"clip {clip}: {name} is not of unit length (off by {worst:.2g}); are these quaternions in the order wxyz?"
        )


def _check_contacts(clip: str, frames: int, names: tuple[str, ...], contacts: np.ndarray) -> None:
    if names and contacts.shape != (frames, len(names)):
        raise BadMotion(f"clip {clip}: contacts has shape {contacts.shape}, expected {(frames, len(names))}")


def _check_scene(
    clip: str, frames: int, object_pos: np.ndarray, object_quat: np.ndarray, wrist_goal: np.ndarray
) -> None:
    if len(object_pos) or len(object_quat):
        _check_frames(
            clip,
            1.0,
            {
                "root_pos_w": (np.zeros((frames, 0)), (0,)),
                "object_pos_w": (object_pos, (3,)),
                "object_quat_w": (object_quat, (4,)),
            },
        )
        _check_unit(clip, "object_quat_w", object_quat)
    known = np.isfinite(wrist_goal).all(-1)
    if wrist_goal.shape not in ((0, 3), (2, 3)) or not (known | np.isnan(wrist_goal).all(-1)).all():
        raise BadMotion(
            f"clip {clip}: wrist_goal_w must be two places of three finite numbers, left and right, or none; three NaN "
            "for a hand without a goal"
        )
    if len(wrist_goal) and not known.any():
        raise BadMotion(f"clip {clip}: wrist_goal_w has no place for either hand; leave it empty")


_SCENE = {"object_pos_w": 3, "object_quat_w": 4, "wrist_goal_w": 3}


def _scene_arrays(motion: HumanMotion | RobotMotion) -> dict[str, np.ndarray]:
    """What a clip says of its object and goal, if anything."""
    return {name: getattr(motion, name).astype(np.float32) for name in _SCENE if len(getattr(motion, name))}


def _read_scene(data: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    arrays = {name: data[name].astype(float) for name in _SCENE if name in data}
    if "object_quat_w" in arrays:
        arrays["object_quat_w"] = _read_quat(arrays["object_quat_w"])
    return arrays


def _check_conventions(path: Path, header: dict) -> None:
    order = header.get("quaternion_order")
    if order != "wxyz":
        raise BadMotion(
            f"{path} does not say that its quaternions are wxyz (it says {order!r}); convert it and "
            "set quaternion_order"
        )
    if header.get("schema") != SCHEMA:
        raise BadMotion(f"{path} has schema {header.get('schema')!r}, this version reads {SCHEMA}; make it again")


@contextmanager
def _documented(path: Path) -> Iterator[None]:
    """Turn what goes wrong while reading a file of other content than documented into one sentence."""
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BadMotion(
            f"{path} is not a motion as docs/formats.md describes it ({error!r}); make it again or convert it"
        ) from None


def _read_quat(stored: np.ndarray) -> np.ndarray:
    """Stored quaternions in double precision, of unit length if they nearly were.

    What is farther off stays, to be refused.
    """
    quat = stored.astype(float)
    length = np.sqrt((quat**2).sum(-1, keepdims=True))
    return np.where(abs(length - 1) < 5e-3, quat / np.where(length > 0, length, 1.0), quat)
