"""Where the mass of a body is."""

import numpy as np

from mimicbench.references.body.body import Body

SEGMENTS = (
    ("trunk", 0.497, 0.5),
    ("head", 0.081, 0.0),
    ("upper_arm", 0.028, 0.436),
    ("forearm", 0.022, 0.682),
    ("thigh", 0.1, 0.433),
    ("shin", 0.0465, 0.433),
    ("foot", 0.0145, 0.3),
)
"""Segment, its share of the body's mass, and where along it from its upper end its center is (Winter 2009, table
4.1)."""


def center_of_mass(body: Body, pos: np.ndarray) -> np.ndarray:
    """(T, 3) of a body with its joints at (T, J, 3) [m]."""
    shoulder = pos[:, [arm.root for arm in body.arms]].mean(1)
    ends: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {
        "trunk": [(pos[:, body.pelvis], shoulder)],
        "head": [(pos[:, body.head], pos[:, body.head])],
    }
    for limbs, names in ((body.arms, ("upper_arm", "forearm")), (body.legs, ("thigh", "shin"))):
        for start, name in enumerate(names):
            ends[name] = [(pos[:, limb[start]], pos[:, limb[start + 1]]) for limb in limbs]
    toes = body.toes or (body.legs[0].end, body.legs[1].end)
    ends["foot"] = [(pos[:, leg.end], pos[:, toe]) for leg, toe in zip(body.legs, toes, strict=True)]
    total = sum(
        share * (upper + along * (lower - upper)) for name, share, along in SEGMENTS for upper, lower in ends[name]
    )
    return np.asarray(total) / sum(share * len(ends[name]) for name, share, _ in SEGMENTS)
