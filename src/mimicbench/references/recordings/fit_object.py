"""Fits furniture to a person who was recorded without it."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion, BadObject
from mimicbench.core.motion import HumanMotion
from mimicbench.core.seeds import rng
from mimicbench.objects.families.chair import KINDS, build_chair, draw_shape
from mimicbench.objects.families.sofa import draw_sofa
from mimicbench.objects.families.upholstery import build_sofa
from mimicbench.objects.shape import SceneObject
from mimicbench.objects.surface import box_distance
from mimicbench.references.body.body import body_of

FAR = 0.2
"""[m]; nothing is judged by distances beyond it."""
DEEPEST = 0.06
"""A chair in which a body part is deeper than this does not fit [m]."""


@dataclass(frozen=True)
class ChairFit:
    """A chair under a person, and how well it fits."""

    obj: SceneObject
    offset: np.ndarray
    """(2,) centre of the chair in the frame of the seated pelvis [m]: x to where the person faces, y left."""
    depth: float
    """Deepest that any body part is in the chair in any frame [m]."""
    gap: float
    """Distance from the trunk to the back of the chair at the end [m]; 0 for stools."""


@dataclass(frozen=True)
class Samples:
    """A person as spheres, in all frames."""

    points: np.ndarray
    """(T, S, 3) points along the axes of the body parts [m]."""
    radii: np.ndarray
    """(S,) of the body parts [m]."""
    trunk: np.ndarray
    """(S,) whether a point belongs to pelvis, torso or head."""
    resting: np.ndarray
    """(S,) whether a point is a hand that is held still at the end."""
    lower_legs: np.ndarray
    """(S,) whether a point belongs to a shin or foot."""
    arms: np.ndarray
    """(S,) whether a point belongs to an arm or hand."""
    side: np.ndarray
    """(S,) of a point of shin or foot 0 for left and 1 for right, else -1."""


def seated_frame(motion: HumanMotion, seated: slice) -> tuple[np.ndarray, float, float]:
    """Where a person sits: pelvis (2,) [m], heading [rad], height of the pelvis [m], over the seated frames.

    The heading is taken across the hips: it does not suffer from how far the pelvis leans back.
    """
    pos, _ = motion.forward_kinematics()
    body = body_of(motion.skeleton)
    pelvis = pos[seated, body.pelvis]
    left = (pos[seated, body.legs[0].root] - pos[seated, body.legs[1].root]).mean(0)
    return pelvis[:, :2].mean(0), float(np.arctan2(-left[0], left[1])), float(np.median(pelvis[:, 2]))


def fit_seat(object_id: str, motion: HumanMotion, seated: slice, sofa: bool = False, candidates: int = 96) -> ChairFit:
    """The chair (or sofa) of the family that suits a person best who sits at the origin facing +x in the frames
    `seated`.

    Seats of all kinds are drawn (by the object's id), given the seat height that the pelvis implies, and slid back and
    forth under the person. Judged are how deep any body part enters the chair at any time, walking included, how close
    the back is to the trunk, whether the seat carries the pelvis, and whether hands held still at the sides have
    something to rest on. Raises BadMotion if no chair suits.
    """
    pos, quat = motion.forward_kinematics()
    person = body_of(motion.skeleton)
    seat_height = float(np.median(pos[seated, person.pelvis, 2])) - person.buttock
    if not 0.25 <= seat_height <= 0.65:
        raise BadMotion(
            f"clip {motion.id}: the seat would be {seat_height:.2f} m high, no chair's height (0.25 "
            "to 0.65); is the floor at z = 0?"
        )
    body = sample_body(pos, quat, motion)
    index = np.arange(motion.frames)[seated]
    ranked = []
    for number, obj, slides in _candidates(object_id, seat_height, sofa, candidates):
        costs, _, _ = _judge(obj, slides, body, index[::8], index)
        ranked += [(cost, number, slide, obj) for cost, slide in zip(costs, slides, strict=True)]
    ranked.sort(key=lambda entry: entry[:3])
    # the few that suit the seated pose are judged over the whole clip
    whole = np.arange(0, motion.frames, 2)
    again = [
        (_judge(obj, np.array([slide]), body, whole, index)[0][0], number, slide, obj)
        for _, number, slide, obj in ranked[:24]
    ]
    if not again:
        raise BadMotion(f"clip {motion.id}: no chair fits under this person; leave the clip out")
    _, _, slide, obj = min(again, key=lambda entry: entry[:3])
    _, (depth,), (gap,) = _judge(obj, np.array([slide]), body, np.arange(motion.frames), index)
    if depth > DEEPEST:
        raise BadMotion(
            f"clip {motion.id}: in every chair some body part would be {depth:.2f} m deep; leave the clip out"
        )
    return ChairFit(obj, np.array([slide, 0.0]), float(depth), float(gap))


def _candidates(
    object_id: str, seat_height: float, sofa: bool, count: int
) -> Iterator[tuple[int, SceneObject, np.ndarray]]:
    """Seats of the family with the given height, and where (K,) each may stand in x under a pelvis at the origin
    [m].
    """
    for number in range(count):
        random = rng(0, "fitted", object_id, number)
        try:
            if sofa:
                wide = draw_sofa(random)
                obj = build_sofa(
                    object_id,
                    "sofa",
                    replace(wide, seat_height=seat_height, height=wide.height - wide.seat_height + seat_height),
                )
            else:
                shape = draw_shape(random, KINDS[number % len(KINDS)])
                obj = build_chair(
                    object_id,
                    replace(shape, seat_height=seat_height, height=shape.height - shape.seat_height + seat_height),
                )
        except BadObject:
            continue
        back, front = obj.seat_polygon[:, 0].min(), obj.seat_polygon[:, 0].max()
        # the pelvis sits at least a buttock in front of the back, and with enough seat in front of it
        yield number, obj, -np.arange(back + 0.08, min(back + 0.34, front - 0.12), 0.025)


def sample_body(pos: np.ndarray, quat: np.ndarray, motion: HumanMotion) -> Samples:
    """The body's sample points in all frames."""
    points, radii, roles, side = [], [], [], []
    body = body_of(motion.skeleton)
    for part in body.parts:
        samples = np.linspace(part.start, part.end, 1 if part.start == part.end else 5)
        points.append(pos[:, part.joint, None] + rot.rotate(quat[:, part.joint, None], samples))
        radii += [part.radius] * len(samples)
        roles += [part.role] * len(samples)
        side += [next((i for i, leg in enumerate(body.legs) if part.joint in leg[1:]), -1)] * len(samples)
    path = np.concatenate(points, 1)
    still = np.linalg.norm(path[-1] - path[-min(len(path), round(0.2 * motion.fps) + 1)], axis=-1) < 0.02
    resting = still & np.isin(roles, "hand")
    trunk, shins, arms = ("pelvis", "trunk", "head"), ("shin", "foot"), ("upper_arm", "lower_arm", "hand")
    return Samples(
        path,
        np.array(radii),
        np.isin(roles, trunk),
        resting,
        np.isin(roles, shins),
        np.isin(roles, arms),
        np.where(np.isin(roles, shins), side, -1),
    )


def _judge(
    obj: SceneObject, slides: np.ndarray, body: Samples, frames: np.ndarray, seated: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How badly a chair suits the given frames, standing at each x of slides (K,).

    Returns:
        (K,) costs, (K,) deepest penetration [m], (K,) gap behind the trunk in the last frame [m].
    """
    shifts = np.stack([slides, 0 * slides, 0 * slides], -1)[:, None]  # (K, 1, 3)
    clearance = nearby_distance(obj, body.points[frames] - shifts[:, None]) - body.radii  # (K, F, S)
    depth = np.maximum(0.0, -clearance.min((1, 2)))
    cost = 10 * np.maximum(0.0, depth - 0.01) + 30 * np.maximum(0.0, depth - 0.03)
    # a robot is wider than a person: on the way to the chair, and in front of it, there should be some room
    cost += np.maximum(0.0, 0.04 - clearance[:, frames < seated[0] - 15].min((1, 2), initial=1.0))
    cost += np.maximum(0.0, 0.04 - clearance[:, :, body.lower_legs].min((1, 2)))
    cost += np.maximum(0.0, 0.2 - (obj.seat_polygon[:, 0].max() + slides))
    end = body.points[seated[-1]] - shifts
    trunk, hands = end[:, body.trunk], end[:, body.resting]
    gap = np.zeros(len(slides))
    behind = (obj.box_pos + obj.box_half)[:, 2] > obj.require_seat() + 0.1
    behind &= obj.box_pos[:, 0] < obj.seat_polygon[:, 0].min()
    if behind.any():
        gap = np.maximum(0.0, (nearby_distance(obj, trunk, behind) - body.radii[body.trunk]).min(-1))
        cost += 2 * np.maximum(0.0, gap - 0.02)
    else:
        cost += 3 * max(0.0, float(np.ptp(trunk[0, :, 0])) - 0.12)  # who leans back has something to lean on
    floating = nearby_distance(obj, hands) - body.radii[body.resting]
    cost += np.where(np.abs(hands[..., 1]) > 0.22, np.clip(floating - 0.02, 0.0, 0.15), 0.0).sum(-1)
    return cost, depth, gap


def nearby_distance(obj: SceneObject, points: np.ndarray, boxes: np.ndarray | slice = slice(None)) -> np.ndarray:
    """Signed distance (...) of points (..., 3) to the nearest of the object's boxes [m], negative inside.

    Beyond FAR of the boxes' bounds the distance to these bounds is good enough, and much quicker.
    """
    corners = obj.corners()[boxes].reshape(-1, 3)
    outside = np.maximum(np.maximum(corners.min(0) - points, points - corners.max(0)), 0.0)
    distance = np.sqrt((outside**2).sum(-1))
    near = distance < FAR
    distance[near] = box_distance(obj, points[near], boxes)
    return distance
