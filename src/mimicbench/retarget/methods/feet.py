"""Where a robot's feet are: still while they stand, on their toes before they leave, on the person's path between."""

from collections.abc import Callable

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.references.curves import minimum_jerk
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.grounding import runs
from mimicbench.retarget.samples import Scene, balls_of

HEEL, ROLLING = 0.25, 0.6
"""[rad], [s] A foot that is about to leave the floor raises its heel as far as the person's, but for how much, in so
long before. Flat until it leaves, it would pull the pelvis down by 5 cm in every step, where people's moves by 2.
"""
FREED = 0.12
"""[s] After it has left and before it arrives, within which it comes to point as the person's."""
FOOT_CLEAR = 0.004
"""[m] Between a standing foot and the object."""

Cleared = Callable[[int, np.ndarray, np.ndarray], np.ndarray]
"""What a frame, and a foot's position (3,) and orientation (4,), make of that position where the object is."""


def footprints(
    fps: float,
    bears: np.ndarray,
    followed: np.ndarray,
    human: np.ndarray,
    sole: np.ndarray,
    near_floor: np.ndarray,
    clear: Cleared,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions (T, 3) and orientations (T, 4) of a foot that is still while it bears, and (T,) whether that is on
    the floor.

    Standing, it is flat where the human's is flattest until its heel rises; swinging, it follows the human's path,
    bent so that it leaves and arrives there.

    Args:
        fps: Frames per second.
        bears: (T,) whether the foot bears.
        followed: (T, 3) the person's path of the foot link [m].
        human: (T, 4) the person's foot, in the link's frame.
        sole: (2, 3) its heel and its toe in the link's frame [m].
        near_floor: (T,) how high the ankle of a flat foot may be, less how high the person's is [m].
        clear: Keeps a standing foot out of the object.
    """
    frames, level = len(bears), rot.from_yaw(rot.yaw_of(human))
    tilt = rot.angle_between(human, level)
    place, turn, floor = followed.copy(), human.copy(), np.zeros(frames, bool)
    standing, raised_by = runs(bears), {0: HEEL}  # who begins with a foot in the air has it as if it had left
    for start, end in standing:
        flattest = start + np.flatnonzero(tilt[start:end] <= tilt[start:end].min() + 0.02)
        # who begins with the heel up already stands on the toes
        flat = rot.rotate(human[flattest], sole[-1]) - rot.rotate(level[flattest], sole[-1])
        if (near_floor[flattest] - flat[:, 2]).max() > 0.0:
            floor[start:end] = True
            at = np.median(followed[flattest] + flat, 0)
            at[2] = -float(sole[:, 2].min())
            heading = level[flattest]
            turn[start:end] = rot.normalize((heading * np.sign((heading * heading[:1]).sum(-1, keepdims=True))).mean(0))
            at = clear(start, at, turn[start])
        else:  # toes up or on a side, as the person's
            at = np.median(followed[start:end], 0)
        place[start:end] = at
        if floor[start] and end < frames:
            raised = _heel(fps, human[start:end])
            place[start:end], turn[start:end] = on_toes(place[start:end], turn[start:end], sole[-1], raised)
            raised_by[end] = float(raised[-1])
    edges = [0, *[edge for run in standing for edge in run], frames]
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        if start < end:
            _swing(fps, place, turn, followed, human, sole[-1], (start, end), raised_by.get(start, 0.0))
    return place, turn, floor


def _swing(
    fps: float,
    place: np.ndarray,
    turn: np.ndarray,
    followed: np.ndarray,
    human: np.ndarray,
    toe: np.ndarray,
    swing: tuple[int, int],
    raised: float,
) -> None:
    """Positions (T, 3) and orientations (T, 4) of a foot while it is in the air, given where it stands before and
    after: it leaves with its heel raised by an angle [rad], and arrives flat.
    """
    (start, end), frames = swing, len(place)
    level = rot.from_yaw(rot.yaw_of(human[start:end]))
    kept = min(1.0, raised / max(float(_pitch(human[start])), 1e-6))
    first = rot.slerp(level[0], human[start], np.array(kept))
    on_toe = rot.rotate(human[start], toe) - rot.rotate(first, toe)
    moved = [place[frame] - followed[frame] for frame in (start - 1, min(end, frames - 1))]
    after = moved[1] if end < frames else moved[0] if start > 0 else np.zeros(3)
    before = moved[0] if start > 0 else after * [0.0, 0.0, 1.0] + on_toe
    u = (np.arange(start, end) - start + 1.0) / (end - start + 1.0)
    place[start:end] = followed[start:end] + before + minimum_jerk(u)[:, None] * (after - before)
    left, right = (share * (end - start + 1.0) / fps / FREED for share in (u, 1 - u))
    free = np.minimum(1.0, np.minimum(kept + left, right if end < frames else 1.0))
    turn[start:end] = rot.slerp(level, human[start:end], free)


def _pitch(turn: np.ndarray) -> np.ndarray:
    """How far feet (..., 4) point down [rad]."""
    return -np.arcsin(np.clip(rot.rotate(turn, np.array([1.0, 0.0, 0.0]))[..., 2], -1.0, 1.0))


def _heel(fps: float, human: np.ndarray) -> np.ndarray:
    """(T,) how far the heel of a foot is raised that leaves the floor next [rad], given the person's foot (T, 4)."""
    ends = (np.arange(len(human)) - len(human)) / fps
    return np.clip(_pitch(human), 0.0, HEEL) * minimum_jerk(1.0 + ends / ROLLING)


def on_toes(place: np.ndarray, turn: np.ndarray, toe: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A foot's positions (T, 3) and orientations (T, 4), pitched by angles (T,) [rad] about its toe (3,) [m]."""
    pitched = rot.multiply(turn, rot.from_rotvec(angle[:, None] * np.array([0.0, 1.0, 0.0])))
    return place + rot.rotate(turn, toe) - rot.rotate(pitched, toe), pitched


def shapes_of(clip: Clip, link: int) -> tuple[np.ndarray, np.ndarray]:
    """Centers (S, 3) and radii (S,) of the balls of one link [m]."""
    balls = balls_of(clip.robot)
    return balls.center[balls.link == link], balls.radius[balls.link == link]


def clear_of_object(
    scene: Scene, shapes: tuple[np.ndarray, np.ndarray], frame: int, place: np.ndarray, turn: np.ndarray
) -> np.ndarray:
    """A foot's place (3,) moved sideways until it is out of the object: a robot's foot is longer than a person's."""
    centers, radii = shapes
    for _ in range(12):
        points = place + rot.rotate(turn, centers)
        distance, normal = scene.object_distance(np.full(len(points), frame), points)
        distance = distance - radii - FOOT_CLEAR
        worst = int(distance.argmin())
        way = normal[worst] * [1.0, 1.0, 0.0]
        if distance[worst] >= 0 or np.linalg.norm(way) < 0.5:
            break
        place = place - way / np.linalg.norm(way) * (distance[worst] - 1e-4)
    return place
