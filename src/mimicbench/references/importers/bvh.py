"""Imports BVH files of any skeleton of a person onto ROAM's 27 joints.

ROAM's own files (millimeters, 67 joints) are one case of it.

Units and axes are guessed from how long the legs are and where heads are above feet; limbs are found by their names
(joint_names.py), spine and neck as what lies between them.
"""

from pathlib import Path

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.skeleton import Skeleton
from mimicbench.references.body.body import Body, roam_body
from mimicbench.references.body.skeletons import ROAM
from mimicbench.references.importers.bvh_file import Bvh, read_bvh, world
from mimicbench.references.importers.format import Format
from mimicbench.references.importers.hip_joints import reach_ankles
from mimicbench.references.importers.joint_names import Limbs, find_limbs, onto_roam
from mimicbench.references.importers.recording import LEG, UNITS, Recording, Wishes, check_rate, finish
from mimicbench.references.importers.rest_pose import Adopted, adopt, axis_up, guess_up, into_our_rest
from mimicbench.references.importers.standing import body_turns, flat_feet
from mimicbench.references.importers.stride import check_stride

LEG_LENGTH = 0.83
"""Thigh and shin of a usual person [m]."""
SLACK = 0.05
"""[m] by which a joint may be off because joints between it and its parent, which our skeleton does not have, turn."""
HIP_SLACK = 0.25
"""[m] by which a hip may move against the pelvis."""


def import_bvh(path: Path, wishes: Wishes) -> Recording:
    """Read one take. Raises BadFile or BadMotion."""
    bvh = read_bvh(path)
    limbs = find_limbs(path, bvh.names, bvh.parents)
    body, (sources, skipped) = roam_body(), onto_roam(bvh.names, bvh.parents, limbs)
    fps = check_rate(path, None if bvh.frame_time <= 0 else 1 / bvh.frame_time, wishes)
    meters, said = _unit(path, bvh, limbs, wishes)
    pos, quat = world(bvh)
    pos *= meters
    up, why = _up(pos, limbs, wishes)
    assumed = [said, why, f"{fps:.4g} frames per second, as {'told' if wishes.fps else 'the file says'}"]
    if bvh.surplus:
        assumed.append(f"{bvh.surplus} rows after its {len(bvh.values)} frames were left out")
    assumed += [
        f"{ROAM.joint_names[j]} is missing and lies on the bone between its neighbors" for j in _between(sources)
    ]
    _, turn = axis_up(up)
    pos, quat = rot.rotate(turn, pos), rot.multiply(turn, quat)
    adopted = adopt(ROAM, sources, pos, quat)
    hips = [leg.root for leg in body.legs]
    off = float(max(adopted.off[[j for j in range(len(adopted.off)) if j not in hips]]))
    if skipped:
        assumed.append(
            f"{', '.join(skipped)}: our skeleton has no such joints; what is above them is up to {off:.3f} m off"
        )
    if off > SLACK or adopted.off[hips].max() > HIP_SLACK:
        raise BadMotion(
            f"{path}: {', '.join(skipped) or 'its joints'} move the joints below by "
            f"{adopted.residual:.2g} m, which our skeleton cannot do"
        )
    turns, how = body_turns(path, body, adopted)
    turns, feet = flat_feet(body, adopted, turns, fps, not how)
    skeleton, local = into_our_rest(body, adopted, turns)
    if adopted.off[hips].max() > SLACK:
        local, legs = _still_hips(path, body, skeleton, adopted, local, pos[:, [leg[2] for leg in limbs.legs]])
        how += legs
    recording = Recording(path.stem, skeleton, fps, adopted.pos, local, (*assumed, *how, *feet), wishes=wishes)
    recording = finish(path, recording)
    check_stride(path, skeleton, recording.forward_kinematics()[0], fps)
    return recording


def _still_hips(
    path: Path, body: Body, skeleton: Skeleton, adopted: Adopted, local: np.ndarray, ankles: np.ndarray
) -> tuple[np.ndarray, list[str]]:
    """Local rotations (T, 27, 4) whose ankles (T, 2, 3) [m] are the file's though its hips move, and what to say."""
    moved = float(adopted.off[[leg.root for leg in body.legs]].max())
    local, left = reach_ankles(body, skeleton, adopted.pos, local, ankles)
    if left > SLACK:
        raise BadMotion(
            f"{path}: its hips move against the pelvis by {moved:.2g} m, and legs that hang on still hips miss "
            f"the ankles by {left:.2g} m; leave it out"
        )
    return local, [
        f"the hips move against the pelvis by up to {moved:.3f} m, which ours cannot; ankles are within {left:.3f} m "
        "of where they were"
    ]


def _unit(path: Path, bvh: Bvh, limbs: Limbs, wishes: Wishes) -> tuple[float, str]:
    """Meters in the file's unit of length, and why: of the units that give a person's legs, the likeliest."""
    legs = [np.linalg.norm(bvh.offsets[leg[1]]) + np.linalg.norm(bvh.offsets[leg[2]]) for leg in limbs.legs]
    length = float(np.mean(legs))
    if wishes.scale is not None:
        return wishes.scale, f"1 of its unit is {wishes.scale:.4g} m, as told: so the legs are " + (
            f"{length * wishes.scale:.2f} m long"
        )
    if wishes.unit is not None:
        return UNITS[wishes.unit], f"the unit is {wishes.unit}, as told"
    fit = [unit for unit, meters in UNITS.items() if LEG[0] <= length * meters <= LEG[1]]
    if not fit:
        raise BadMotion(
            f"{path}: its legs are {length:.3g} long, no person's in any of {', '.join(UNITS)}; say how many "
            "meters 1 is (--scale)"
        )
    unit = min(fit, key=lambda name: abs(np.log(length * UNITS[name] / LEG_LENGTH)))
    others = "".join(f", or {length * UNITS[name]:.2f} m in {name}" for name in fit if name != unit)
    return UNITS[unit], f"the unit is {unit}: so the legs are {length * UNITS[unit]:.2f} m long{others}"


def _up(pos: np.ndarray, limbs: Limbs, wishes: Wishes) -> tuple[str, str]:
    """The file's axis that points up, and why."""
    if wishes.up is not None:
        return wishes.up, f"{wishes.up} is up, as told"
    return guess_up(pos[:, limbs.head] - pos[:, [leg[2] for leg in limbs.legs]].mean(1), "y+")


def _between(sources: list[int | None]) -> list[int]:
    """Joints of ours that are missing between others."""
    below = {ROAM.parents[j] for j, source in enumerate(sources) if source is not None}
    missing = [j for j, source in enumerate(sources) if source is None]
    for j in reversed(missing):
        if j in below:
            below.add(ROAM.parents[j])
    return [j for j in missing if j in below]


FORMAT = Format(
    "bvh",
    import_bvh,
    lambda file: file.content == "bvh" or (not file.content and file.suffix == ".bvh"),
    heeds=("unit", "scale"),
)
