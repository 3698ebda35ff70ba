"""Where an object can be touched with both hands, and from where.

A touch point lies on the object's surface, 0.2 to 1.1 m above the floor, and the space before it is free. A *pair* of
points is what one episode of touching needs: a place for the left hand and one for the right that somebody who stands
in front of the object, on its +x side and facing it, reaches at once. So the left point has the smaller y. Pairs are
chosen by `touch_pair`, evenly among all pairs of an object's stored points that are

- 0.2 to 0.6 m apart, at most 0.25 m of it in height and 0.3 m in depth, and at least 0.12 m sideways, so that the
  arms do not cross;
- within the reach of both arms from one place and one posture, upright or bending with the knees bent or straight
  (`POSTURES`). The body that reaches is the smaller of the human and the H1 in each of its lengths;
- free: head and chest stay clear of the object, and so do the straight lines from the shoulders to the wrists.

The wrists' targets are not the points themselves but `WRIST_OFF` before them along the normals, for a wrist is thicker
than a line.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadObject
from mimicbench.objects.shape import SceneObject
from mimicbench.objects.surface import box_distance

WRIST_OFF = 0.045
"""[m] between the surface and a wrist that touches it: an H1's forearm ends in a ball of 3.3 cm."""
LOWEST, HIGHEST = 0.2, 1.1
"""[m] heights of touch points."""
UPPER_PART, HIGH_ENOUGH = 0.55, 0.5
"""Touch points are above this part of the highest one's height, or above so many metres: nobody bends down to the foot
of what can be touched further up."""
APART = (0.2, 0.6)
"""[m] least and largest distance between the points of a pair."""
MOST_POINTS, MOST_CANDIDATES = 14, 26
"""Touch points kept of one object, and how many are tried in pairs for that."""
SIDES = {
    "front": (1.0, 0.0, 0.0),
    "left": (0.0, -1.0, 0.0),
    "right": (0.0, 1.0, 0.0),
    "top": (0.0, 0.0, 1.0),
    "front left": (0.7071, -0.7071, 0.0),
    "front right": (0.7071, 0.7071, 0.0),
}
"""Faces that somebody in front of the object can touch, by where they look; left and right are theirs who face it."""
UPRIGHT = ("front", "left", "right", "top")

STAND_OFF = 0.26
"""[m] from the object's foremost point to the ankles: a foot reaches 0.2 m before its ankle."""
SHOULDER = 0.19
"""[m] from the middle of the body to a shoulder: 0.183 of the human, 0.21 of the H1."""
ARM = 0.52
"""[m] from shoulder to wrist, a little bent: 0.534 of the human, 0.61 of the H1."""
TRUNK, NECK = 0.48, 0.2
"""[m] from hips to shoulders, 0.48 of the human and 0.60 of the H1; and from there to the middle of the head."""
HIPS = (0.80, 0.68, 0.56)
"""[m] heights of the hips, standing and with bent knees; 0.80 is an H1 upright, and it can do the others within the
limits of its ankles."""
PITCH = (0.0, 0.35, 0.7, 1.05, 1.4)
"""[rad] how far the trunk leans forward. The hips go back meanwhile by 0.25 m x sin(pitch), which keeps the balance."""
HAND_CLEAR, ARM_CLEAR, BODY_CLEAR = 0.03, 0.03, 0.12
"""[m] that hand, arm and the middles of chest and head keep from every box."""


def _postures() -> np.ndarray:
    """(K, 3, 2) places of chest, shoulders and head: forward of the ankles, and above the floor [m].

    The easiest posture first.
    """
    effort = {(hip, pitch): pitch / 1.4 + (HIPS[0] - hip) / 0.25 for hip in HIPS for pitch in PITCH}
    rows = []
    for hip, pitch in sorted(effort, key=lambda key: effort[key]):
        along = np.array([np.sin(pitch), np.cos(pitch)])
        hips = np.array([-0.25 * np.sin(pitch), hip])
        rows.append([hips + 0.5 * TRUNK * along, hips + TRUNK * along, hips + (TRUNK + NECK) * along])
    return np.array(rows)


POSTURES = _postures()


@dataclass(frozen=True)
class Pairs:
    """Pairs of touch points for one person in front of the object. N pairs."""

    points: np.ndarray
    """(N, 2) indices of the object's touch points: the left hand's, the right hand's."""
    stance: np.ndarray
    """(N, 2) where the ankles' middle is on the floor [m]; whoever stands there faces -x."""
    shoulders: np.ndarray
    """(N, 2, 3) where the left and the right shoulder are while touching [m]."""


def with_touch_points(obj: SceneObject, faces: Sequence[tuple[int, str]] | None = None) -> SceneObject:
    """The object with the touch points that its faces offer, at most MOST_POINTS, spread out.

    Args:
        obj: the object; touch points that it has are replaced.
        faces: which boxes to touch, and on which of SIDES; without it, all faces of all boxes that look one of
            these ways.

    Raises:
        BadObject: there is no pair of points that two hands could reach.
    """
    if faces is None:
        faces = [(box, side) for box in range(len(obj.box_pos)) for side in UPRIGHT]
    points, normals = _face_points(obj, faces)
    keep = (points[:, 2] >= LOWEST) & (points[:, 2] <= HIGHEST)
    points, normals = points[keep], normals[keep]
    keep = _free(obj, points, normals)
    points, normals = points[keep], normals[keep]
    keep = points[:, 2] >= min(HIGH_ENOUGH, UPPER_PART * points[:, 2].max(initial=0.0))
    points, normals = points[keep], normals[keep]
    order = _spread(points, MOST_CANDIDATES)
    candidate = replace(obj, touch_points=points[order], touch_normals=normals[order])
    pairs = find_pairs(candidate).points
    if not len(pairs):
        raise BadObject(
            f"object {obj.id} has no place for two hands that somebody in front of it can reach; "
            "choose an object with edges 0.2 to 1.1 m high"
        )
    used = np.unique(pairs)
    # the most level pair first, then whatever is farthest from what is there
    level = np.abs(np.diff(candidate.touch_points[pairs], axis=1)[:, 0])
    first = pairs[np.argmin(level[:, 2] + level[:, 0])]
    order = used[_spread(candidate.touch_points[used], MOST_POINTS, [int(np.searchsorted(used, i)) for i in first])]
    return replace(obj, touch_points=candidate.touch_points[order], touch_normals=candidate.touch_normals[order])


def find_pairs(obj: SceneObject) -> Pairs:
    """All pairs of the object's touch points that can be touched at once, as this module's docstring defines them."""
    points, wrists = obj.touch_points, obj.touch_points + WRIST_OFF * obj.touch_normals
    left, right = (
        index.ravel() for index in np.meshgrid(np.arange(len(points)), np.arange(len(points)), indexing="ij")
    )
    gap = points[right] - points[left]
    apart = np.sqrt((gap**2).sum(-1))
    good = (
        (apart >= APART[0])
        & (apart <= APART[1])
        & (gap[:, 1] >= 0.12)
        & (np.abs(gap[:, 2]) <= 0.25)
        & (np.abs(gap[:, 0]) <= 0.3)
    )
    chosen = np.stack([left, right], -1)[good]
    middle = points[chosen][..., 1].mean(1)
    stance = np.stack([np.full(len(chosen), obj.bounds()[1][0] + STAND_OFF), middle], -1)
    shoulders = np.zeros((len(chosen), len(POSTURES), 2, 3))
    shoulders[..., 0] = (stance[:, :1] - POSTURES[:, 1, 0])[..., None]
    shoulders[..., 1] = middle[:, None, None] + SHOULDER * np.array([-1.0, 1.0])
    shoulders[..., 2] = POSTURES[:, 1, 1][:, None]
    reach = np.sqrt(((wrists[chosen][:, None] - shoulders) ** 2).sum(-1)).max(-1)
    found = np.full(len(chosen), -1)
    allowed = reach <= ARM
    # the easiest posture within reach whose body and arms are free; the next easiest, should they not be
    for _ in range(6):
        todo = np.flatnonzero((found < 0) & allowed.any(1))
        posture = allowed[todo].argmax(1)
        allowed[todo, posture] = False
        free = _posture_free(obj, wrists[chosen[todo]], shoulders[todo, posture], stance[todo], POSTURES[posture])
        found[todo[free]] = posture[free]
    ok = np.flatnonzero(found >= 0)
    return Pairs(chosen[ok], stance[ok], shoulders[ok, found[ok]])


def touch_pair(obj: SceneObject, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw the two wrists' targets of one episode: left (3,), right (3,) [m], WRIST_OFF before the surface.

    Raises BadObject.
    """
    pairs = _pairs_of(_Shape(obj))
    if not len(pairs):
        raise BadObject(f"object {obj.id} has no two touch points for two hands; give it some by with_touch_points")
    chosen = pairs[random.integers(len(pairs))]
    left, right = obj.touch_points[chosen] + WRIST_OFF * obj.touch_normals[chosen]
    return left, right


class _Shape:
    """An object that equals all others whose boxes and touch points are the same, whatever they are called."""

    def __init__(self, obj: SceneObject) -> None:
        self.obj = obj
        self._bytes = tuple(
            array.tobytes() for array in (obj.box_pos, obj.box_quat, obj.box_half, obj.touch_points, obj.touch_normals)
        )
        self._hash = hash(self._bytes)

    def __hash__(self) -> int:
        return self._hash

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Shape) and self._bytes == other._bytes


@lru_cache(maxsize=4096)
def _pairs_of(shape: _Shape) -> np.ndarray:
    """(N, 2) the points of an object's pairs, searched once: every episode beside it draws one of them."""
    return find_pairs(shape.obj).points


def stance_before(obj: SceneObject, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Where to stand to touch both: x, y of the ankles' middle [m] and the heading [rad], (3,).

    The object is in front.
    """
    return np.array([obj.bounds()[1][0] + STAND_OFF, (left[1] + right[1]) / 2, np.pi])


def _face_points(obj: SceneObject, faces: Sequence[tuple[int, str]]) -> tuple[np.ndarray, np.ndarray]:
    """Points along the rims of fronts and tops, all over sides, and in the middle of what is narrow.

    And their normals, both (N, 3).
    """
    points, normals = [], []
    turns = rot.to_matrix(obj.box_quat)
    for box, side in faces:
        # the box's own axis that looks most in this direction
        along = np.array(SIDES[side]) @ turns[box]
        own = int(np.argmax(np.abs(along)))
        half = obj.box_half[box]
        first, second = (i for i in range(3) if i != own)
        u, v = (marks.ravel() for marks in np.meshgrid(_marks(half[first]), _marks(half[second])))
        if side in ("front", "top"):
            rim = (np.abs(u) >= u.max() - 1e-9) | (np.abs(v) >= v.max() - 1e-9)
            u, v = u[rim], v[rim]
        local = np.zeros((len(u), 3))
        local[:, own], local[:, first], local[:, second] = half[own] * np.sign(along[own]), u, v
        points.append(obj.box_pos[box] + local @ turns[box].T)
        normals.append(np.repeat(turns[box][None, :, own] * np.sign(along[own]), len(u), 0))
    return np.concatenate([np.zeros((0, 3)), *points]), np.concatenate([np.zeros((0, 3)), *normals]) + 0.0


def _marks(half: float) -> np.ndarray:
    """Places along one direction of a face of that half size: 3 cm inside its ends, and at most 16 cm apart between
    them.
    """
    if half < 0.04:
        return np.zeros(1)
    end = half - 0.03
    return np.linspace(-end, end, max(2, int(np.ceil(2 * end / 0.16)) + 1))


_DIRECTIONS = np.array([[0, 0, 1], *[[0.85 * np.cos(a), 0.85 * np.sin(a), 0.5] for a in np.arange(6) * np.pi / 3]])
"""Directions (7, 3) over a hemisphere about z."""


def _free(obj: SceneObject, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Which points (N, 3) lie on the outer surface with room for a hand before them: a ball at the wrist, and a
    hemisphere of 6 cm.
    """
    turn = np.concatenate([1 + normals[:, 2:], -normals[:, 1:2], normals[:, :1], np.zeros((len(points), 1))], -1)
    turn = np.where(normals[:, 2:] < -0.99, [[0.0, 1.0, 0.0, 0.0]], turn)
    rays = rot.rotate(rot.normalize(turn)[:, None], _DIRECTIONS[None])
    places = (points + 0.01 * normals)[:, None] + 0.06 * rays
    around = box_distance(obj, np.concatenate([places, (points + WRIST_OFF * normals)[:, None], points[:, None]], 1))
    return (around[:, :-2] > 0).all(1) & (around[:, -2] >= HAND_CLEAR) & (around[:, -1] > -1e-4)


def _posture_free(
    obj: SceneObject, wrists: np.ndarray, shoulders: np.ndarray, stance: np.ndarray, postures: np.ndarray
) -> np.ndarray:
    """Whether N people's arms, wrists (N, 2, 3) to shoulders (N, 2, 3), chests and heads are clear of the object,
    (N,).
    """
    along = np.linspace(0, 1, 7)[:, None, None]
    arms = wrists[:, None] * (1 - along) + shoulders[:, None] * along
    body = np.stack(
        [stance[:, :1] - postures[:, ::2, 0], np.repeat(stance[:, 1:], 2, 1), postures[:, ::2, 1]],
        -1,
    )
    return np.logical_and(
        (box_distance(obj, arms) >= ARM_CLEAR).all((1, 2)), (box_distance(obj, body) >= BODY_CLEAR).all(1)
    )


def _spread(points: np.ndarray, count: int, first: Sequence[int] = ()) -> np.ndarray:
    """Indices of at most `count` points (N, 3) far from each other: `first`, then always the farthest from those
    chosen.
    """
    if len(points) <= count:
        return np.arange(len(points))
    chosen = list(first) or [int(np.argmax(points @ np.array([1.0, 0.3, 0.1])))]
    nearest = np.min([((points - points[i]) ** 2).sum(-1) for i in chosen], 0)
    while len(chosen) < count:
        chosen.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, ((points - points[chosen[-1]]) ** 2).sum(-1))
    return np.array(chosen)
