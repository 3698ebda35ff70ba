"""Where the hands of people rest who lie on their back: beside the hips, on belly, chest or thigh, beside the head,
behind it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.skeleton import forward_kinematics
from mimicbench.references.actions.berths import Berth
from mimicbench.references.body.body import Body
from mimicbench.references.body.posing import Legs, Trunk, shoulders, thigh_orientations

BESIDE, BELLY, CHEST, THIGH, UP, HEAD = range(6)
"""Beside the hip, on the belly, on the chest, on the thigh, flat beside the head, behind the head."""
SPOTS = 6
NARROW = {BESIDE: BELLY, UP: CHEST, HEAD: CHEST}
"""What is done instead where there is no room beside the body."""

UPWARD = np.array([0.0, 0.0, 0.1])


class Rested(NamedTuple):
    """An arm at rest."""

    wrist_w: np.ndarray
    """(T, 3) [m]."""
    pole_w: np.ndarray
    """(T, 3) where the elbow points from between shoulder and wrist."""
    fingers_w: np.ndarray
    """(T, 3) where the fingers point."""


@dataclass(frozen=True)
class Bedding:
    """Who lies, on what, and how."""

    body: Body
    berth: Berth
    trunk: Trunk
    legs: Legs
    farther: tuple[float, float]
    """How much farther from the middle, or up along the body, than usual each hand rests, at body size 1 [m]."""

    @property
    def near(self) -> int:
        """The side (0 left, 1 right) at the free edge."""
        return 0 if self.berth.turn < 0 else 1

    def possible(self, spot: int, side: int) -> int:
        """The spot, or what is done instead where there is no room."""
        return spot if side == self.near or self.berth.wide else NARROW.get(spot, spot)

    def rest(self, spot: int, side: int) -> Rested:
        """An arm at one of the spots."""
        return (self._beside, self._belly, self._chest, self._thigh, self._up, self._behind_head)[
            self.possible(spot, side)
        ](side)

    def aside(self, side: int) -> np.ndarray:
        """(3,) horizontal unit vector away from who lies."""
        return (1.0 if side == self.near else -1.0) * np.array([*self.berth.out, 0.0])

    def _on_trunk(self, quat: np.ndarray, at: np.ndarray, side: int) -> np.ndarray:
        """(T, 3) of (x, to the side, z) from the pelvis, in axes (T, 4) of pelvis or chest, at body size 1."""
        return self.trunk.pelvis_pos_w + rot.rotate(quat, self.body.size * at * [1.0, 1.0 - 2.0 * side, 1.0])

    def _elbow(self, side: int, down: float) -> np.ndarray:
        """(3,) where the elbow of a hand on the trunk points: aside and to the feet; up where there is no room."""
        free, foot = side == self.near or self.berth.wide, -np.array([*self.berth.head, 0.0])
        return (self.aside(side) + down * foot + UPWARD) if free else 0.3 * self.aside(side) + 0.5 * foot + 4.0 * UPWARD

    def _flat(self, wrist: np.ndarray, pole: np.ndarray, fingers: np.ndarray) -> Rested:
        frames = len(self.trunk.pelvis_pos_w)
        return Rested(*(np.broadcast_to(value, (frames, 3)) for value in (wrist, pole, fingers)))

    def _beside(self, side: int) -> Rested:
        edge = float((self.berth.seat_xy - self.berth.pelvis_xy) @ self.berth.out)
        aside = (0.29 + 0.7 * max(self.farther[side], -0.02)) * self.body.size
        away, head = self.aside(side), np.array([*self.berth.head, 0.0])
        wrist = np.array([*self.berth.pelvis_xy, self.berth.height + 0.05])
        wrist = wrist + (min(edge, aside) if side == self.near else aside) * away
        return self._flat(wrist + 0.02 * self.body.size * head, away + [0.0, 0.0, 0.35], 0.3 * away - head)

    def _belly(self, side: int) -> Rested:
        wrist = self._on_trunk(self.trunk.pelvis_quat_w, np.array([0.118, 0.085, 0.12 + self.farther[side]]), side)
        across = rot.rotate(self.trunk.pelvis_quat_w, np.array([-0.25, -0.75 * (1 - 2 * side), -0.5]))
        return self._flat(wrist, self._elbow(side, 0.0), across)

    def _chest(self, side: int) -> Rested:
        at = np.array([0.135, 0.055, 0.29 + 0.5 * self.farther[side]])
        wrist = self._on_trunk(self.trunk.chest_quat_w, at, side)
        across = rot.rotate(self.trunk.chest_quat_w, np.array([-0.25, -0.8 * (1 - 2 * side), 0.35]))
        return self._flat(wrist, self._elbow(side, 0.6), across)

    def _thigh(self, side: int) -> Rested:
        thigh = thigh_orientations(self.body, self.trunk, self.legs)[:, side]
        root = self.body.skeleton.offsets[self.body.legs[side].root]
        hip = self.trunk.pelvis_pos_w + rot.rotate(self.trunk.pelvis_quat_w, root)
        at = np.array([0.085, 0.035 * (1 - 2 * side), -0.10 + 0.5 * self.farther[side]]) * self.body.size
        wrist = hip + rot.rotate(thigh, at)
        return self._flat(wrist, self.aside(side) + [0.0, 0.0, 0.1], rot.rotate(thigh, np.array([-0.1, 0.0, -1.0])))

    def _up(self, side: int) -> Rested:
        away, head = self.aside(side), np.array([*self.berth.head, 0.0])
        root = shoulders(self.body, self.trunk)[-1, side]
        wrist = root + self.body.size * ((0.24 + 0.4 * self.farther[side]) * away + (0.17 + self.farther[side]) * head)
        wrist[2] = self.berth.height + 0.055
        return self._flat(wrist, away - 0.5 * head + 4.0 * UPWARD, head - 0.2 * away)

    def _behind_head(self, side: int) -> Rested:
        away, head = self.aside(side), np.array([*self.berth.head, 0.0])
        skull = skull_of(self.body, self.trunk)[-1]
        wrist = skull + self.body.size * (0.165 * away + 0.02 * head)
        wrist[2] = self.berth.height + self.berth.pillow + 0.045
        return self._flat(
            wrist,
            away + (0.75 if self.berth.wide else 0.3) * head + (4.0 if self.berth.wide else 6.0) * UPWARD,
            0.35 * head - away,
        )


def skull_of(body: Body, trunk: Trunk) -> np.ndarray:
    """(T, 3) the middle of the skull [m]."""
    quat = np.tile(rot.IDENTITY, (len(trunk.pelvis_pos_w), len(body.skeleton.joint_names), 1))
    quat[:, body.pelvis] = trunk.pelvis_quat_w
    for joints, below, above in (
        (body.spine, trunk.pelvis_quat_w, trunk.chest_quat_w),
        (body.neck, trunk.chest_quat_w, trunk.head_quat_w),
    ):
        turn = rot.to_rotvec(rot.multiply(rot.conjugate(below), above))
        quat[:, list(joints)] = rot.from_rotvec(turn / len(joints))[:, None]
    pos, world = forward_kinematics(body.skeleton, trunk.pelvis_pos_w, quat)
    ball = next(part for part in body.parts if part.role == "head")
    return pos[:, ball.joint] + rot.rotate(world[:, ball.joint], np.array(ball.start))
