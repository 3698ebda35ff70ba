"""Fits a bed, or a sofa, under a person who was recorded lying down without one."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from mimicbench.core.errors import BadMotion, BadObject
from mimicbench.core.motion import HumanMotion
from mimicbench.core.seeds import rng
from mimicbench.objects.families.bed import build_bed, draw_bed
from mimicbench.objects.families.couch import COUCHES
from mimicbench.objects.families.sofa import draw_sofa
from mimicbench.objects.families.upholstery import build_sofa
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body.body import body_of
from mimicbench.references.checks.contacts import detect_feet
from mimicbench.references.recordings.fit_object import Samples, nearby_distance, sample_body

HEIGHTS = (0.12, 0.75)
"""Of what people lie on [m]."""
FLAT = 0.36
"""[m]; below it only beds without frame and headboard can be built."""
WALKED = 0.03
"""And so is one that people walk through [m]."""
UPRIGHT = 0.85
"""Who has the pelvis higher than this share of its height over a standing person's feet walks or stands."""
DEEPEST = 0.16
"""A bed in which a body part is deeper than this does not fit [m]. Mattresses, which these beds are not, give by a
third of it."""


@dataclass(frozen=True)
class BedFit:
    """A bed under a person, and how well it fits."""

    obj: SceneObject
    offset: np.ndarray
    """(2,) its centre in the frame of who lies on it, see `lying_frame` [m]."""
    depth: float
    """Deepest that any body part is in the bed in any frame [m]."""


@dataclass(frozen=True)
class _Sleeper:
    """Who is to lie on a bed."""

    body: Samples
    head: np.ndarray
    """(2,) where the head lies [m]."""
    lies: np.ndarray
    """(F,) some frames in which the person lies."""
    outside: np.ndarray
    """(T, S) whether a point must not be in the bed: all of who walks or stands, legs whose foot is on the floor."""


def lying_frame(motion: HumanMotion, lying: slice, couch: bool) -> tuple[np.ndarray, float]:
    """Where a person lies, pelvis (2,) [m], and the heading [rad] of what the person lies on.

    A bed's heading is from head to feet. A couch's is across, to the side on which the person sat down.
    """
    pos, _ = motion.forward_kinematics()
    body = body_of(motion.skeleton)
    pelvis = pos[lying, body.pelvis].mean(0)
    feet = pelvis - pos[lying, body.head].mean(0)
    yaw = float(np.arctan2(feet[1], feet[0]))
    if couch:
        came = pos[: lying.start, body.pelvis] - pelvis
        side = np.sin(yaw) * -came[:, 0] + np.cos(yaw) * came[:, 1]
        yaw += np.pi / 2 if side[-min(len(side), round(3 * motion.fps)) :].mean() > 0 else -np.pi / 2
    return pelvis[:2], yaw


def fit_bed(object_id: str, motion: HumanMotion, lying: slice, couch: bool = False, candidates: int = 40) -> BedFit:
    """The bed (or couch) that suits a person best who lies at the origin, as `lying_frame` says, in the frames `lying`.

    Beds of all kinds are drawn (by the object's id), given the height that the pelvis implies, and slid under the
    person: the whole body must be on the mattress, the head near the pillow, and nobody may walk through the bed, or
    stand in it, on the way. Raises BadMotion if none suits.
    """
    pos, quat = motion.forward_kinematics()
    person = body_of(motion.skeleton)
    height = float(np.median(pos[lying, person.pelvis, 2])) - person.back
    if not HEIGHTS[0] <= height <= HEIGHTS[1]:
        raise BadMotion(
            f"clip {motion.id}: the bed would be {height:.2f} m high, no bed's height ({HEIGHTS[0]} "
            f"to {HEIGHTS[1]}); is the floor at z = 0?"
        )
    sleeper = _sleeper(motion, lying, pos, quat)
    ranked: list[tuple[float, int, float, float, SceneObject]] = []
    side = 1.0 if sleeper.head[1] > 0 else -1.0
    for number, obj in _candidates(object_id, height, couch, side, candidates):
        for x, y in _slides(obj, sleeper.head):
            ranked.append((_cost(obj, x, y, sleeper), number, x, y, obj))
    if not ranked:
        raise BadMotion(f"clip {motion.id}: no bed fits under this person; leave the clip out")
    _, _, x, y, obj = min(ranked, key=lambda entry: entry[:4])
    depth, walked = _depth(obj, x, y, sleeper.body, np.arange(0, motion.frames, 2)), _walked(obj, x, y, sleeper)
    for deep, most, who in ((depth, DEEPEST, "some body part"), (walked, WALKED, "who walks up, or a standing leg,")):
        if deep > most:
            raise BadMotion(f"clip {motion.id}: in every bed {who} would be {deep:.2f} m deep; leave the clip out")
    return BedFit(obj, np.array([x, y]), depth)


def _sleeper(motion: HumanMotion, lying: slice, pos: np.ndarray, quat: np.ndarray) -> _Sleeper:
    body, person = sample_body(pos, quat, motion), body_of(motion.skeleton)
    feet = detect_feet(motion)
    outside = np.zeros(body.points.shape[:2], bool)
    for side in (0, 1):
        outside[np.ix_(feet[:, side], body.side == side)] = True
    outside |= (pos[:, person.pelvis, 2] > UPRIGHT * person.standing_height)[:, None]
    lies = np.arange(motion.frames)[lying]
    outside[lies] = False
    return _Sleeper(body, pos[lying, person.head, :2].mean(0), lies[::10], outside)


def _candidates(
    object_id: str, height: float, couch: bool, head_side: float, count: int
) -> Iterator[tuple[int, SceneObject]]:
    """Beds or couches of the family with the given height."""
    for number in range(count):
        random = rng(0, "fitted", object_id, number)
        try:
            if couch:
                sofa = draw_sofa(random, COUCHES, lying=True)
                rise = max(0.0, sofa.height - sofa.seat_height)
                arms = (True, True) if all(sofa.arms) else (head_side < 0, head_side > 0)
                turned = replace(sofa, head=int(head_side), seat_height=height, height=height + rise, arms=arms)
                yield number, build_sofa(object_id, "couch", turned)
            else:
                kind = "platform" if height < FLAT else ("platform", "headboard", "panel")[number % 3]
                bed = draw_bed(random, kind)
                mattress = min(bed.mattress, max(0.06, height - 0.12))
                over = 0.0 if kind == "platform" else bed.height - bed.seat_height
                yield (
                    number,
                    build_bed(object_id, replace(bed, seat_height=height, height=height + over, mattress=mattress)),
                )
        except BadObject:
            continue


def _slides(obj: SceneObject, head: np.ndarray) -> Iterator[tuple[float, float]]:
    """Where a bed may stand so that the head is over its pillow, or some way from it towards the middle."""
    x, y = head - obj.head_xy
    along = np.array([-1.0, 0.0]) if obj.family == "bed" else np.array([0.0, np.sign(obj.head_xy[1]) or 1.0])
    across = np.array([along[1], along[0]])
    for back in (-0.1, 0.0, 0.1, 0.2, 0.3):
        for aside in np.linspace(-0.75, 0.75, 13):
            yield float(x + back * along[0] + aside * across[0]), float(y + back * along[1] + aside * across[1])


def _depth(obj: SceneObject, x: float, y: float, body: Samples, frames: np.ndarray) -> float:
    clearance = nearby_distance(obj, body.points[frames] - np.array([x, y, 0.0])) - body.radii
    return max(0.0, -float(clearance.min()))


def _walked(obj: SceneObject, x: float, y: float, sleeper: _Sleeper) -> float:
    """Deepest in a bed at (x, y) of what must not be in it [m]."""
    frame, point = np.nonzero(sleeper.outside[::2])
    if not len(frame):
        return 0.0
    clearance = nearby_distance(obj, sleeper.body.points[::2][frame, point] - np.array([x, y, 0.0]))
    return max(0.0, -float((clearance - sleeper.body.radii[point]).min()))


def _cost(obj: SceneObject, x: float, y: float, sleeper: _Sleeper) -> float:
    """How badly a bed at (x, y) suits who walks up and lies on it."""
    low, high = obj.seat_polygon.min(0) + (x, y), obj.seat_polygon.max(0) + (x, y)
    body, frames = sleeper.body, sleeper.lies
    lies = body.points[frames[-1]]
    beyond = np.maximum(np.maximum(low - lies[:, :2], lies[:, :2] - high), 0.0).max(-1)
    depth = _depth(obj, x, y, body, frames)
    away = np.linalg.norm(sleeper.head - obj.head_xy - (x, y))
    return float(
        3 * np.where(lies[:, 2] > obj.require_seat() - 0.1, beyond, 0.0).mean()
        + 2 * beyond.max()
        + 10 * max(0.0, depth - 0.05)
        + 10 * max(0.0, _walked(obj, x, y, sleeper) - 0.01)
        + 0.3 * away
    )
