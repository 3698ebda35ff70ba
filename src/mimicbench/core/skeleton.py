"""Trees of joints, and where their joints are for given rotations."""

from dataclasses import dataclass, replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion


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
