"""What a recording's standing frames say of joints' frames where its rest pose does not: bodies by the frames in which
somebody stands most upright, feet by those in which they are flat on the floor.
"""

from pathlib import Path

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.references.body.body import Body, Limb
from mimicbench.references.importers.rest_pose import Adopted, hanging_turns

UPRIGHT_FRAMES = 31
"""Most frames that an upright pose is averaged over."""
UPRIGHT_SLACK = 0.03
"""How much less upright than the best frame these may be, in cosines."""
FLAT_SPEED, FLAT_TURN = 0.12, 0.6
"""A flat foot's ankle is slower than this [m/s], and the foot turns slower than this [rad/s]."""
FLAT_LOW, FLAT_SECONDS = 0.03, 0.4
"""Its ankle is within this of the lowest [m], and it is flat for so long in all [s]."""
STANDS = 0.6
"""And the hip is at least so high over the ankle, in lengths of the leg."""
AGREES = np.radians(6.0)
"""A rest pose's feet are kept if they are flat within this in standing frames [rad]."""
SPREAD = np.radians(8.0)
"""Flat frames must agree within this, three quarters of them [rad]."""
Z = np.array([0.0, 0.0, 1.0])


def body_turns(path: Path, body: Body, adopted: Adopted) -> tuple[np.ndarray, list[str]]:
    """The constant rotations into our rest pose (J, 4), and what to say about them.

    Most files rest standing, with all rotations zero. In some the zero pose is of no use, as all bones lie along one
    axis; then the frames in which the person is most upright take its place. Raises BadMotion if there are none.
    """
    offsets = np.nan_to_num(adopted.offsets)
    # the rest pose may have another axis up than the motion
    rise = -offsets[[joint for leg in body.legs for joint in leg[1:]]].sum(0)
    axis = np.sign(rise) * (np.abs(rise) == np.abs(rise).max())
    try:
        return hanging_turns(body, offsets, np.tile(rot.IDENTITY, (len(offsets), 1)), axis), []
    except BadMotion:
        pass
    upright = _uprightness(body, adopted, offsets)
    best = int(upright.argmax())
    near = np.argsort(-upright, kind="stable")[:UPRIGHT_FRAMES]
    found = []
    for frame in near[upright[near] >= upright[best] - UPRIGHT_SLACK]:
        try:
            found.append(hanging_turns(body, offsets, adopted.quat[frame], Z))
        except BadMotion:
            continue
    if not found:
        raise BadMotion(
            f"{path}: nobody stands in its rest pose, and nobody stands with straight legs in any "
            "frame; convert it to a T-pose first"
        )
    return _mean(np.stack(found)), [
        f"nobody stands in the rest pose; twists of the joints count from where the person stands most upright "
        f"({len(found)} frames, the best is {best})"
    ]


def _uprightness(body: Body, adopted: Adopted, offsets: np.ndarray) -> np.ndarray:
    """(T,) how upright the trunk, how straight the legs, and, less so, how much the arms hang, in cosines."""

    def along(joints: tuple[int, ...], children: tuple[int, ...], sign: float) -> np.ndarray:
        return np.min(
            [
                sign
                * rot.rotate(adopted.quat[:, joint], offsets[child])[:, 2]
                / max(float(np.linalg.norm(offsets[child])), 1e-9)
                for joint, child in zip(joints, children, strict=True)
            ],
            0,
        )

    legs, arms = (np.min([along(limb[:2], limb[1:], -1.0) for limb in limbs], 0) for limbs in (body.legs, body.arms))
    trunk = np.zeros((len(adopted.pos), 3))
    joint = body.head
    while joint != body.pelvis:
        parent = body.skeleton.parents[joint]
        trunk += rot.rotate(adopted.quat[:, parent], offsets[joint])
        joint = parent
    upright = trunk[:, 2] / np.maximum(np.linalg.norm(trunk, axis=-1), 1e-9)
    return np.minimum(legs, upright) + 0.2 * arms


def _mean(turns: np.ndarray) -> np.ndarray:
    """(J, 4) the mean of rotations (N, J, 4) that are near each other."""
    same = (turns * turns[:1]).sum(-1, keepdims=True) >= 0  # q and -q are one rotation
    return rot.normalize(np.where(same, turns, -turns).mean(0))


def flat_feet(body: Body, adopted: Adopted, turns: np.ndarray, fps: float, rests: bool) -> tuple[np.ndarray, list[str]]:
    """The same turns (J, 4) with feet whose soles are level in the frames in which they stand still on the floor.

    A rest pose's feet may be rolled or on tiptoe; where it agrees with the standing frames, it stays. Who neither rests
    standing (`rests`) nor ever stands still gets feet that point down to the toes as the standard's do. Returns what to
    say, too.
    """
    turns, said = turns.copy(), []
    for side, leg in zip(("left", "right"), body.legs, strict=True):
        flat = _flat_frames(body, adopted, leg, fps)
        up = _up_in(adopted, leg.end, flat) if flat.sum() >= max(3, FLAT_SECONDS * fps) else None
        if up is None:
            if not rests:
                said += _standard_slope(body, adopted, leg, turns, side)
            continue
        off = float(np.arccos(np.clip(rot.rotate(turns[leg.end], Z) @ up, -1, 1)))
        if off < AGREES:
            continue
        for joint in range(leg.end, len(turns)):
            if _hangs_on(body, joint, leg.end):
                level = up if joint == leg.end else _up_in(adopted, joint, flat)
                if level is not None:
                    turns[joint] = _tilted(turns[joint], rot.rotate(turns[joint], Z), level)
        said.append(
            f"the {side} foot is {np.degrees(off):.0f} degrees off level in the rest pose; it was taken from the "
            f"{flat.sum() / fps:.1f} s in which it is flat"
        )
    return turns, said


def _up_in(adopted: Adopted, joint: int, flat: np.ndarray) -> np.ndarray | None:
    """Where up is (3,) in a joint's frame in the flat frames; None if they do not agree."""
    ups = rot.rotate_inverse(adopted.quat[flat, joint], Z)
    middle = np.median(ups, 0)
    middle /= max(float(np.linalg.norm(middle)), 1e-9)
    apart = np.arccos(np.clip(ups @ middle, -1, 1))
    return middle if np.quantile(apart, 0.75) < SPREAD else None


def _standard_slope(body: Body, adopted: Adopted, leg: Limb, turns: np.ndarray, side: str) -> list[str]:
    """Turn a foot and what hangs on it so that it slopes from ankle to toes as the standard's does. Says so."""
    toe = next((j for j in range(len(turns)) if body.skeleton.parents[j] == leg.end), None)
    if toe is None or np.isnan(adopted.offsets[toe]).any():
        return []
    now = rot.rotate_inverse(turns[leg.end], adopted.offsets[toe])
    usual = body.skeleton.offsets[toe]
    if not np.linalg.norm(now[:2]) > 1e-6:
        return []
    ahead = np.concatenate([now[:2] / np.linalg.norm(now[:2]) * np.linalg.norm(usual[:2]), usual[2:]])
    back = _between(ahead / np.linalg.norm(ahead), now / np.linalg.norm(now))
    for joint in range(leg.end, len(turns)):
        if _hangs_on(body, joint, leg.end):
            turns[joint] = rot.normalize(rot.multiply(turns[joint], back))
    return [f"the {side} foot never stands still; it was taken to slope to the toes as usual"]


def _tilted(turn: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    return rot.normalize(rot.multiply(_between(start, end), turn))


def _hangs_on(body: Body, joint: int, above: int) -> bool:
    while joint > above:
        joint = body.skeleton.parents[joint]
    return joint == above


def _flat_frames(body: Body, adopted: Adopted, leg: Limb, fps: float) -> np.ndarray:
    """(T,) whether a foot stands still and low under a straight leg."""
    offsets, quat, pos = np.nan_to_num(adopted.offsets), adopted.quat, {body.pelvis: adopted.pos}
    chain = [leg.root, leg.middle, leg.end]
    for joint in chain:
        parent = body.skeleton.parents[joint]
        pos[joint] = pos[parent] + rot.rotate(quat[:, parent], offsets[joint])
    hip, ankle = pos[leg.root], pos[leg.end]
    length = np.linalg.norm(offsets[[leg.middle, leg.end]], axis=-1).sum()
    slow = np.linalg.norm(np.gradient(ankle, 1 / fps, axis=0), axis=-1) < FLAT_SPEED
    slow &= np.linalg.norm(rot.angular_velocity(quat[:, [leg.end]], fps)[:, 0], axis=-1) < FLAT_TURN
    stands = hip[:, 2] - ankle[:, 2] > STANDS * length
    flat = slow & stands
    if flat.any():
        flat &= ankle[:, 2] < np.quantile(ankle[flat, 2], 0.1) + FLAT_LOW
    return flat


def _between(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(4,) the shortest rotation that takes one unit vector (3,) to another."""
    quat = np.concatenate([[1.0 + start @ end], np.cross(start, end)])
    length = np.linalg.norm(quat)
    return quat / length if length > 1e-6 else np.array([0.0, 1.0, 0.0, 0.0])
