"""Whether the boxes of an object hang together."""

import numpy as np

from mimicbench.core import rotations as rot


def joined(obj, gap=1e-4):
    """Whether all boxes can be reached from the first by boxes that touch, to within `gap` [m]."""
    turn = rot.to_matrix(obj.box_quat)
    near = np.array([[boxes_touch(obj, turn, a, b, gap) for b in range(len(turn))] for a in range(len(turn))])
    reached = np.zeros(len(turn), bool)
    reached[0] = True
    for _ in turn:
        reached = near[reached].any(0) | reached
    return bool(reached.all())


def boxes_touch(obj, turn, a, b, gap):
    """Separating axes of two boxes: their six face normals and the nine crosses of their edges."""
    axes = np.concatenate([turn[a].T, turn[b].T, np.cross(turn[a].T[:, None], turn[b].T[None]).reshape(9, 3)])
    axes = axes[np.linalg.norm(axes, axis=1) > 1e-6]
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    reach = sum(np.abs(axes @ turn[i]) @ obj.box_half[i] for i in (a, b))
    return bool((np.abs(axes @ (obj.box_pos[a] - obj.box_pos[b])) <= reach + gap).all())
