"""People at rest never freeze: they breathe, look around, shift their weight and let their hands settle.

All of it is a function of the time since they came to rest and of one number that names the person's habits. What bears
stays: feet are exactly where they were, and so are hands as far as they are held.
"""

from dataclasses import dataclass

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.seeds import rng
from mimicbench.core.skeleton import forward_kinematics
from mimicbench.references.body.body import Body
from mimicbench.references.body.limbs import two_link
from mimicbench.references.curves import minimum_jerk

BEGINS = 1.2
"""Within so many seconds of rest all of it has begun."""
EVENTS = 24
"""So often somebody looks elsewhere, or shifts, before they come to an end of it."""
GAZE = np.array([0.05, 0.16, 0.55])
"""How far the head tilts, nods and turns to look somewhere, at most [rad]."""
FOLLOWS = 0.16
"""Of a turn of the head the chest makes so much as well."""
PELVIS_SHIFT, CHEST_SHIFT = np.array([0.03, 0.05, 0.05]), np.array([0.06, 0.085, 0.10])
"""How far a shift of weight tilts, bends and turns the pelvis, and the chest over it, at most [rad]."""
STEP_ASIDE = np.array([0.004, 0.008])
"""How far it moves the pelvis forward and sideways, at most, at body size 1 [m]."""
BREATH = 0.012
"""How far the chest rises with each breath [rad]."""
SWAY = np.array([0.004, 0.007, 0.005])
"""How far the trunk sways all the time [rad]."""
SWIVEL = 0.05
"""How far elbows drift about the line from shoulder to wrist [rad]."""
LIFT = 0.010
"""A hand that settles elsewhere is lifted so high [m]."""
BENT = 0.97
"""No hand settles where the arm would be stretched to more than this share of its length."""
STRAIGHTEST = 0.9985
"""Share of its length to which a leg may be stretched: a pelvis that is too high for it sinks."""


@dataclass(frozen=True)
class Rest:
    """When somebody is at rest, and what must not move then."""

    clock: np.ndarray
    """(T,) since they came to rest [s]; before 0 nothing is added."""
    held: tuple[float, float] = (0.0, 0.0)
    """How far the left and the right wrist stay where they are in the world: 1 on a support or on the own thighs; 0 for
    one that goes with the chest."""
    trunk: float = 1.0
    """How freely pelvis and chest shift: 1 for who sits or stands upright, 0 for who lies; breathing goes on."""
    gaze: float | np.ndarray = 1.0
    """How far they look around, as a share of the usual; or shares (3,) of tilts, nods and turns."""
    settle_w: np.ndarray | None = None
    """(2, 3) how far each hand may settle elsewhere [m], such as along a thigh."""


def enliven(
    body: Body, root_pos_w: np.ndarray, local_quat: np.ndarray, rest: Rest, habits: float
) -> tuple[np.ndarray, np.ndarray]:
    """Root positions (T, 3) [m] and local rotations (T, J, 4) of somebody who keeps moving while at rest.

    `habits` is a whole number from which all is drawn; the negative one is the same in a mirror. Ankles and feet are
    where they were; so are wrists and hands, as far as they are held.
    """
    now = np.flatnonzero(rest.clock > 0)
    if not len(now):
        return root_pos_w, local_quat
    own = _Habits(rng(abs(int(habits)), "at rest"), rest.clock[now], -1.0 if habits < 0 else 1.0)
    root, quat = root_pos_w[now].copy(), local_quat[now].copy()
    before = forward_kinematics(body.skeleton, root, quat)
    if rest.trunk > 0:
        _shift_weight(own, body, root, quat, rest.trunk)
    _breathe_and_look(own, body, quat, rest)
    if rest.trunk > 0:
        root[:, 2] -= _too_high(body, root, quat[:, body.pelvis], before[0])
    after = forward_kinematics(body.skeleton, root, quat)
    if rest.trunk > 0:
        _keep_feet(body, quat, before, after)
    _keep_hands(own, body, quat, before, after, rest)
    root_pos_w, local_quat = root_pos_w.copy(), local_quat.copy()
    root_pos_w[now], local_quat[now] = root, rot.normalize(quat)
    return root_pos_w, local_quat


def unrest(habits: float, clock: np.ndarray, size: np.ndarray) -> np.ndarray:
    """(T, 3) small tilts, nods and turns of some size (3,) [rad] that go on in whatever somebody does."""
    random, side = rng(abs(int(habits)), "unrest"), -1.0 if habits < 0 else 1.0
    pace, phase = random.uniform(0.4, 1.3, (3, 3)), random.uniform(0.0, 2 * np.pi, (3, 3))
    return np.array([side, 1.0, side]) * size * np.sin(2 * np.pi * clock[:, None, None] * pace + phase).sum(1)


Poses = tuple[np.ndarray, np.ndarray]
"""World positions (T, J, 3) [m] and orientations (T, J, 4) of all joints."""
Span = tuple[float, float]
"""Least and most [s]."""


@dataclass(frozen=True)
class _Habits:
    """What is drawn for one person, in order."""

    random: np.random.Generator
    clock: np.ndarray
    """(T,) since they came to rest [s], above 0."""
    side: float
    """1 or, in a mirror, -1."""

    @property
    def begun(self) -> np.ndarray:
        """(T, 1) from 0 to 1 while all of it begins."""
        return minimum_jerk(self.clock / BEGINS)[:, None]

    @property
    def turns(self) -> np.ndarray:
        """(3,) signs of tilts, bends and turns."""
        return np.array([self.side, 1.0, self.side])

    def wander(self, every: Span, lasts: Span, most: np.ndarray) -> np.ndarray:
        """(T, n) values that begin at 0, stay, and now and then go smoothly to others within `most` (n,) of it."""
        begins = np.cumsum(self.random.uniform(*every, EVENTS)) - 0.8 * every[0]
        share = minimum_jerk((self.clock[:, None] - begins) / self.random.uniform(*lasts, EVENTS))
        places = self.random.uniform(-1.0, 1.0, (EVENTS, len(most))) * most
        return share @ np.diff(places, axis=0, prepend=0.0)

    def sway(self, size: np.ndarray) -> np.ndarray:
        """(T, n) slow swaying of some size (n,), never twice the same."""
        pace = self.random.uniform(0.09, 0.42, (3, len(size)))
        phase = self.random.uniform(0.0, 2 * np.pi, (3, len(size)))
        return size * np.sin(2 * np.pi * self.clock[:, None, None] * pace + phase).sum(1)


def _shift_weight(own: _Habits, body: Body, root: np.ndarray, quat: np.ndarray, amount: float) -> None:
    """Tilt and move the pelvis, and bend the chest over it."""
    most = np.concatenate([own.turns * PELVIS_SHIFT, own.turns * CHEST_SHIFT, np.array([1.0, own.side]) * STEP_ASIDE])
    shift = amount * own.begun * own.wander((1.4, 5.0), (0.7, 1.7), most)
    sway = amount * own.begun * own.sway(own.turns * SWAY)
    along = rot.from_yaw(rot.yaw_of(quat[:, body.pelvis]))
    root += rot.rotate(along, body.size * np.pad(shift[:, 6:], ((0, 0), (0, 1))))
    quat[:, body.pelvis] = rot.multiply(quat[:, body.pelvis], rot.from_rotvec(shift[:, :3] + 0.3 * sway))
    _bend(quat, body.spine, shift[:, 3:6] + sway)


def _breathe_and_look(own: _Habits, body: Body, quat: np.ndarray, rest: Rest) -> None:
    """Let the chest rise and fall, and the head turn to one thing after the other, the chest a little with it."""
    rate, phase = own.random.uniform(0.20, 0.30), own.random.uniform(0.0, 2 * np.pi)
    breath = BREATH * own.begun[:, 0] * np.sin(2 * np.pi * rate * own.clock + phase)
    gaze = rest.gaze * own.begun * own.wander((0.8, 3.2), (0.4, 0.9), own.turns * GAZE)
    follows = rest.trunk * FOLLOWS * gaze[:, 2]
    none = np.zeros_like(breath)
    _bend(quat, body.spine, np.stack([none, -breath, follows], -1))
    _bend(quat, body.neck, gaze + np.stack([none, 0.7 * breath, -follows], -1))


def _bend(quat: np.ndarray, joints: tuple[int, ...], turn: np.ndarray) -> None:
    """Let some joints of (T, J, 4) turn on by rotation vectors (T, 3) together."""
    quat[:, list(joints)] = rot.multiply(quat[:, list(joints)], rot.from_rotvec(turn / len(joints))[:, None])


def _too_high(body: Body, root: np.ndarray, pelvis: np.ndarray, before: np.ndarray) -> np.ndarray:
    """How much too high a pelvis (T, 3) [m] is for legs to reach where their ankles were before (T, J, 3) [m], (T,)."""
    leg, above = STRAIGHTEST * sum(body.length(body.legs[0])), np.zeros(len(root))
    for limb in body.legs:
        away = root + rot.rotate(pelvis, body.skeleton.offsets[limb.root]) - before[:, limb.end]
        flat = (away[:, :2] ** 2).sum(-1)
        above = np.maximum(above, away[:, 2] - np.sqrt(np.maximum(leg**2 - flat, 0.0)))
    return above


def _keep_feet(body: Body, quat: np.ndarray, before: Poses, after: Poses) -> None:
    """Solve the legs for ankles and feet where they were before."""
    for leg in body.legs:
        axis = rot.rotate(before[1][:, leg.root], np.array([0.0, 1.0, 0.0]))
        thigh, shin, _ = two_link(after[0][:, leg.root], before[0][:, leg.end], axis, *body.length(leg), True)
        quat[:, leg.root] = rot.multiply(rot.conjugate(after[1][:, body.pelvis]), thigh)
        quat[:, leg.middle] = rot.multiply(rot.conjugate(thigh), shin)
        quat[:, leg.end] = rot.multiply(rot.conjugate(shin), before[1][:, leg.end])


def _in_reach(away: np.ndarray, settle: np.ndarray, arm: float) -> float:
    """Share of a way (3,) that hands may settle which are `away` (T, 3) from their shoulders, with arms so long [m]."""
    shares = np.array([1.0, 0.7, 0.4, 0.0])[:, None, None]
    ends = np.linalg.norm(np.concatenate([away + shares * settle, away - shares * settle], 1), axis=-1)
    return float(shares[np.argmax(np.append(ends[:-1].max(-1) < BENT * arm, True)), 0, 0])


def _keep_hands(own: _Habits, body: Body, quat: np.ndarray, before: Poses, after: Poses, rest: Rest) -> None:
    """Solve the arms for wrists that stay as far as they are held or settle elsewhere, and elbows that drift."""
    one = np.ones(1)
    for side in (0, 1) if own.side > 0 else (1, 0):
        arm, held = body.arms[side], rest.held[side]
        shoulder, wrist = after[0][:, arm.root], after[0][:, arm.end]
        wrist = wrist + held * (before[0][:, arm.end] - wrist)
        settled = own.begun * own.wander((2.0, 6.0), (0.5, 0.9), one)
        swivel = SWIVEL * own.side * own.begun * own.wander((1.2, 4.0), (0.6, 1.4), one)
        if rest.settle_w is not None and rest.settle_w[side].any():
            most = rest.settle_w[side] * _in_reach(wrist - shoulder, rest.settle_w[side], sum(body.length(arm)))
            wrist = wrist + settled * most
            speed = np.gradient(settled[:, 0], own.clock) if len(settled) > 2 else np.zeros(len(settled))
            wrist[:, 2] += LIFT * np.tanh(2.0 * speed**2)
        away = wrist - shoulder
        line = away / np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-9)
        axis = rot.rotate(after[1][:, arm.root], np.array([0.0, 1.0, 0.0]))
        axis = rot.rotate(rot.from_rotvec(swivel * line), axis)
        over, under, _ = two_link(shoulder, wrist, axis, *body.length(arm), False)
        chest = after[1][:, body.skeleton.parents[arm.root]]
        hand = rot.multiply(rot.conjugate(under), before[1][:, arm.end])
        quat[:, arm.root] = rot.multiply(rot.conjugate(chest), over)
        quat[:, arm.middle] = rot.multiply(rot.conjugate(over), under)
        quat[:, arm.end] = rot.slerp(quat[:, arm.end], hand, np.array(held))
