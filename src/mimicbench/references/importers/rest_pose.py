"""From any source's rest pose and joints into ours: standing, legs straight down, arms hanging, x forward, y left, z
up.

What a joint's rotation means depends on the pose in which all rotations are zero. Sources rest in a T-pose, an A-pose,
or along their bones. For every joint j there is one constant rotation A_j, the same in every frame, with

    G_j (ours) = G_j (theirs) A_j        offset_j (ours) = A_parent^-1 offset_j (theirs)

for world orientations G. No joint moves by that: p_j = p_parent + G_parent offset_j is the same on both sides.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.skeleton import Skeleton
from mimicbench.references.body.body import Body

SNAP = np.radians(12.0)
"""Rest poses face along an axis; hips that are askew by less than this do not change that [rad]."""
STRAIGHT = 0.8
"""Least cosine between the legs of a rest pose and the vertical."""
ERECT, ACROSS = 0.7, 0.5
"""Least cosine between the way from pelvis to head and the vertical, and most of that between hips and vertical."""


@dataclass(frozen=True)
class Adopted:
    """A motion on one of our skeletons' joints, still in the source's rest pose. Missing joints were put in."""

    pos: np.ndarray
    """(T, 3) of the root [m]."""
    quat: np.ndarray
    """(T, J, 4) orientations in the world."""
    offsets: np.ndarray
    """(J, 3) in the frames of the parents [m]; NaN at ends that the source does not have."""
    off: np.ndarray
    """(J,) how far each joint is from where a constant bone puts it, 99 % of the time [m]."""

    @property
    def residual(self) -> float:
        """The largest of these [m]."""
        return float(self.off.max())


def adopt(standard: Skeleton, sources: Sequence[int | None], pos: np.ndarray, quat: np.ndarray) -> Adopted:
    """Take the joints of a skeleton of ours from a source's world positions (T, N, 3) and orientations (T, N, 4).

    Args:
        standard: the skeleton that is wanted.
        sources: for each of its joints the source's, or None where there is none. A joint that is missing between
            two others lies on the bone between them, evenly spaced, and does not turn. Source joints that are not asked
            for are skipped: the bone across them has the length that it has on average.
        pos: all of the source's positions [m].
        quat: all of its orientations.
    """
    joints = len(standard.parents)
    found = np.empty((len(pos), joints, 4))
    offsets = np.full((joints, 3), np.nan)
    anchor: list[int] = []  # nearest joint that the source has, for each of ours; the root is always there
    off = np.zeros(joints)
    for j, parent in enumerate(standard.parents):
        source = sources[j]
        if source is None:
            found[:, j] = found[:, parent]
            anchor.append(anchor[parent])
            continue
        found[:, j] = quat[:, source]
        anchor.append(j)
        if parent < 0:
            offsets[j] = 0.0
            continue
        above = anchor[parent]
        bone = rot.rotate_inverse(found[:, above], pos[:, source] - pos[:, sources[above]])
        mean = bone.mean(0)
        off[j] = np.quantile(np.linalg.norm(bone - mean, axis=-1), 0.99)
        chain = [j]
        while chain[-1] != above:
            chain.append(standard.parents[chain[-1]])
        for link in chain[:-1]:
            offsets[link] = mean / (len(chain) - 1)
    return Adopted(pos[:, sources[0]] if sources[0] is not None else pos[:, 0], found, offsets, off)


def axis_up(axis: str) -> tuple[np.ndarray, np.ndarray]:
    """What the axis that points up (such as `y+`) says: its unit vector (3,), and the rotation (4,) that makes the
    source's world z up.

    With y up, (x, y, z) becomes (z, x, y): who faces +z faces +x then, with left still on the left.
    """
    number, sign = "xyz".index(axis[0]), -1.0 if axis.endswith("-") else 1.0
    eye = np.eye(3)
    rows = np.stack([eye[(number + 1) % 3], sign * eye[(number + 2) % 3], sign * eye[number]])
    return rows[2], rot.from_matrix(rows)


def guess_up(feet_to_head: np.ndarray, usual: str) -> tuple[str, str]:
    """The axis that points up, and why, from vectors (T, 3) from the feet to the head.

    Who lies all the time leaves it to what is usual.
    """
    mean = (feet_to_head / np.maximum(np.linalg.norm(feet_to_head, axis=-1, keepdims=True), 1e-9)).mean(0)
    number = int(np.abs(mean).argmax())
    if abs(mean[number]) < 0.6:
        return usual, f"{usual[0]} is up, as is usual: nobody stands long enough to tell"
    axis = f"{'xyz'[number]}{'+' if mean[number] > 0 else '-'}"
    return axis, f"{axis[0] if axis[1] == '+' else axis} is up: that is where heads are above feet"


def upright_turn(up: np.ndarray, left: np.ndarray) -> np.ndarray:
    """(4,) the rotation that takes a rest pose's directions `up` and `left` (3,) to z and y."""
    up = up / np.linalg.norm(up)
    left = left - (left @ up) * up
    left = left / np.linalg.norm(left)
    nearest = np.zeros(3)
    axis = int(np.abs(left).argmax())
    nearest[axis] = np.sign(left[axis])
    if left @ nearest > np.cos(SNAP) and abs(nearest @ up) < 1e-6:
        left = nearest
    return rot.from_matrix(np.stack([np.cross(left, up), left, up]))


def hanging_turns(body: Body, offsets: np.ndarray, rest_quat: np.ndarray, up: np.ndarray) -> np.ndarray:
    """A_j (J, 4) of every joint, from a pose in which the person stands, with the arms anywhere.

    In it legs point down, the head is above the pelvis, and the hips lie across. The trunk, the shoulders' girdle and
    the feet keep their frames, turned to x forward and z up; legs and arms are swung, the shorter way, until they hang
    straight down, and hands go with the forearms.

    Args:
        body: of the skeleton, for its limbs.
        offsets: (J, 3) in the frames of the parents; NaN at ends that are missing.
        rest_quat: (J, 4) orientations of all frames in that pose, in the source's world.
        up: (3,) where up is in the source's world.

    Raises:
        BadMotion: Nobody stands in that pose.
    """
    parents, legs = body.skeleton.parents, body.legs
    step = np.array(
        [np.zeros(3) if parent < 0 else rot.rotate(rest_quat[parent], offsets[j]) for j, parent in enumerate(parents)]
    )
    across = step[legs[0].root] - step[legs[1].root]
    trunk = sum((step[j] for j in _way(parents, body.head)), np.zeros(3))
    if not trunk @ up > ERECT * np.linalg.norm(trunk) or not abs(across @ up) < ACROSS * np.linalg.norm(across):
        raise BadMotion("nobody stands in the rest pose")
    turn = upright_turn(up, across)
    for leg in legs:
        along = rot.rotate(turn, step[leg.middle] + step[leg.end])
        if not -along[2] > STRAIGHT * np.linalg.norm(along):
            raise BadMotion("nobody stands in the rest pose")
    swing = np.tile(rot.IDENTITY, (len(parents), 1))
    for limb in (*body.arms, *legs):
        upper = _shortest(rot.rotate(turn, step[limb.middle]))
        lower = _shortest(rot.rotate(upper, rot.rotate(turn, step[limb.end])))
        swing[limb.root] = upper
        swing[limb.middle] = rot.multiply(lower, upper)
    for arm in body.arms:
        swing[arm.end] = swing[arm.middle]
    return rot.conjugate(rot.multiply(swing, rot.multiply(turn, rest_quat)))


def into_our_rest(body: Body, adopted: Adopted, turns: np.ndarray) -> tuple[Skeleton, np.ndarray]:
    """The person's skeleton in our rest pose, and the local rotations (T, J, 4) on it.

    Ends that the source does not have get the standard's bones, as long as the person's legs are to the standard's.
    """
    standard = body.skeleton
    missing = np.asarray(np.isnan(adopted.offsets).any(-1))
    offsets, local = turned(standard.parents, np.where(missing[:, None], 0.0, adopted.offsets), adopted.quat, turns)
    leg = [body.legs[0].middle, body.legs[0].end]
    size = np.linalg.norm(offsets[leg], axis=-1).sum() / np.linalg.norm(standard.offsets[leg], axis=-1).sum()
    offsets[missing] = size * standard.offsets[missing]
    local[:, missing] = rot.IDENTITY
    return Skeleton(standard.name, standard.joint_names, standard.parents, offsets), local


def turned(
    parents: Sequence[int], offsets: np.ndarray, world_quat: np.ndarray, turns: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Offsets (J, 3) and local rotations (T, J, 4) when every joint's frame is turned by its constant A_j, (J, 4)."""
    ours = rot.normalize(rot.multiply(world_quat, turns))
    local, moved = ours.copy(), offsets.copy()
    for j, parent in enumerate(parents):
        if parent >= 0:
            local[:, j] = rot.multiply(rot.conjugate(ours[:, parent]), ours[:, j])
            moved[j] = rot.rotate_inverse(turns[parent], offsets[j])
    return moved, local


def _way(parents: Sequence[int], joint: int) -> list[int]:
    """A joint and those between it and the root."""
    found = []
    while joint > 0:
        found.append(joint)
        joint = parents[joint]
    return found


def _shortest(direction: np.ndarray) -> np.ndarray:
    """(4,) the shortest rotation that takes a direction (3,) to -z."""
    length = np.linalg.norm(direction)
    if not length > 1e-9:
        raise BadMotion("a limb has no length")
    x, y, z = direction / length
    if z > 0.999:  # a limb that points straight up comes down sideways
        return np.array([0.0, 1.0, 0.0, 0.0])
    # axis d x (-z) = (-y, x, 0); w = 1 + d.(-z)
    quat = np.array([1.0 - z, -y, x, 0.0])
    return quat / np.linalg.norm(quat)
