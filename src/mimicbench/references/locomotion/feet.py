"""Feet that never skate: flat and still in stance, or rolling from the heel over the flat sole to the toes, about a
point that stays.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from mimicbench.references.body.body import Body
from mimicbench.references.body.limbs import ease, glide
from mimicbench.references.curves import minimum_jerk, smooth
from mimicbench.references.locomotion.gait import Footsteps, Gait
from mimicbench.references.locomotion.route import left_of

LONG = 1.06
"""A stride for which the feet roll as below [leg lengths]; in proportion for others, up to 1.15 times."""
LEAVING = CubicSpline(
    [-0.33, -0.27, -0.21, -0.16, -0.12, -0.08, -0.04, 0.0, 0.03, 0.06, 0.09, 0.13, 0.17, 0.21, 0.25, 0.29, 0.33],
    np.deg2rad([0.0, 1.8, 3.2, 3.8, 6.3, 12.5, 24.0, 40.0, 49.0, 52.0, 49.0, 38.5, 26.0, 14.5, 6.0, 1.0, 0.0]),
    bc_type="clamped",
)
"""Times from when the foot leaves the floor, in gait cycles, and its pitch then [rad]: the heel rises first."""
LANDING = CubicSpline(
    [-0.22, -0.16, -0.10, -0.065, -0.035, 0.0, 0.04, 0.08, 0.12, 0.16, 0.20, 0.24],
    -np.deg2rad([0.0, 0.0, 3.0, 8.0, 12.0, 12.5, 9.5, 6.5, 4.2, 2.4, 1.0, 0.0]),
    bc_type="clamped",
)
"""Times from when the heel lands, in gait cycles, and the pitch that is added then [rad]: the toes come down late."""
FLAT = 0.285, 0.045
"""The heel does not rise earlier after the foot has landed, and not at once [gait cycles]."""
PEELS = 0.35
"""Also who steps on the spot, aside or back lifts the heel first, at least as for such a share of that stride."""
BACK = 0.4
"""Who steps back lands on the toes: the foot pitches by this share of that, the other way."""
GATHERS, BRAKES = 0.28, 0.24
"""Shares of a swing in which a foot gathers speed and loses it."""
RISES, HOVERS, FALLS = 0.23, 0.60, 0.77
"""Shares of a swing at which the sole is highest, from which it hovers, and from which it comes down."""
SLOWER = 0.15
"""It takes so much more of a swing on the spot to rise, and to come down."""
HOVER = 0.49
"""How high it hovers in a long stride, as a share of the highest."""
TIPS = 0.25
"""Within so much pitch to either side of flat the lowest point of a swinging foot goes over from toes to heel [rad]."""
ASIDE = 0.14
"""A foot swings past the standing one at least so far beside it [m], between the ankles."""


@dataclass(frozen=True)
class Feet:
    """Both ankles over time; axis 1 is left, right."""

    pos_w: np.ndarray
    """(T, 2, 3) ankles [m]."""
    yaw: np.ndarray
    """(T, 2) [rad]"""
    pitch: np.ndarray
    """(T, 2) toe down positive [rad]."""
    contact: np.ndarray
    """(T, 2) bool, some part of the sole bears and is still."""
    toe_bend: np.ndarray
    """(T, 2) how far the toes bend up [rad]: so far that they lie on the floor until the foot leaves it."""


@dataclass(frozen=True)
class FeetStart:
    """Feet in motion that a plan goes on from; axis 0 is left, right."""

    pos_w: np.ndarray
    """(2, 3) ankles [m]."""
    vel_w: np.ndarray
    """(2, 3) [m/s]"""
    yaw: np.ndarray
    """(2,) [rad]"""
    yaw_rate: np.ndarray
    """(2,) [rad/s]"""
    pitch: np.ndarray
    """(2,) toe down positive [rad]."""
    pitch_rate: np.ndarray
    """(2,) [rad/s]"""
    bears: np.ndarray
    """(2,) bool."""


@dataclass(frozen=True)
class _Flat:
    """Flat feet as they are planned, before they are rolled."""

    base: np.ndarray
    """(T, 2, 3) their ankles [m]."""
    yaw: np.ndarray
    """(T, 2) [rad]"""
    pitch: np.ndarray
    """(T, 2) by which they are to be rolled [rad]."""
    pivot: np.ndarray
    """(T, 2) and about what: 0 the front of the sole, 1 the heel's end."""
    contact: np.ndarray
    """(T, 2) bool, whether they bear."""


def swing_feet(steps: Footsteps, time: np.ndarray, gait: Gait, body: Body, start: FeetStart | None = None) -> Feet:
    """Both feet at times (T,): what bears is exactly still, or rolls; what swings goes on an arc, heel off first.

    With `start` they go on from that, exactly, and join the plan until they land or, if they stand, within a moment.
    """
    scale, fps = body.size, 1.0 / float(time[1] - time[0])
    base = np.empty((len(time), 2, 3))
    base[..., :2], base[..., 2] = steps.first_xy, body.sole
    yaw = np.tile(steps.first_foot_yaw, (len(time), 1))
    pitch, pivot, loose = np.zeros((len(time), 2)), np.zeros((len(time), 2)), np.zeros((len(time), 2))
    contact = np.ones((len(time), 2), bool)
    foot_xy, foot_yaw, landed = steps.first_xy.copy(), steps.first_foot_yaw.copy(), [-np.inf, -np.inf]
    cycles = [1.0, 1.0]
    for side, xy, heading, lift, land in zip(
        steps.side, steps.xy, steps.yaw, steps.lift_off, steps.touch_down, strict=True
    ):
        u, cycle = (time - lift) / (land - lift), 2.0 * (land - lift) / (1.0 - gait.overlap)
        swinging, after = (u > 0) & (u < 1), u >= 1
        u = u[swinging]
        share = swing_share(u)
        sign = 1.0 - 2.0 * side
        sideways = left_of(float(foot_yaw[1 - side]))
        path = foot_xy[side] + share[:, None] * (xy - foot_xy[side])
        # swing around the stance foot, not through it
        middle = sign * (0.5 * (foot_xy[side] + xy) - foot_xy[1 - side]) @ sideways
        path = path + sign * max(0.0, ASIDE * scale - middle) * _bump(u)[:, None] * sideways
        other = foot_xy[1 - side]
        leaves = roll_of(other - foot_xy[side], float(foot_yaw[side]), body.leg_length)
        roll = roll_of(xy - other, float(heading), body.leg_length)
        base[swinging, side, :2], base[after, side, :2] = path, xy
        base[swinging, side, 2] = body.sole + gait.clearance * scale * swing_height(u, roll)
        yaw[swinging, side] = foot_yaw[side] + share * (heading - foot_yaw[side])
        yaw[after, side] = heading
        stood = minimum_jerk(((time - landed[side]) / cycles[side] - FLAT[0]) / FLAT[1])
        pitch[:, side] += _pitch((time - lift) / cycle, (time - land) / cycle, max(leaves, PEELS) * stood, roll)
        pivot[swinging, side] = _pivot(u, pitch[swinging, side], roll)
        loose[swinging, side] = minimum_jerk((u - 0.10) / 0.45)
        contact[swinging, side] = False
        foot_xy[side], foot_yaw[side], landed[side] = xy, heading, land
        cycles[side] = cycle
    if start is not None:
        _go_on(start, steps, fps, body, _Flat(base, yaw, pitch, pivot, contact))
    pivot = np.where(contact, pitch < 0, pivot)
    bend = np.maximum(pitch, 0.0) * (1.0 - np.where(contact, 0.0, loose))
    return Feet(base + rolled(body, pitch, yaw, pivot), yaw, pitch, contact, bend)


def roll_of(way: np.ndarray, yaw: float, leg: float) -> float:
    """How much a foot with some heading [rad] rolls that is some way (2,) [m] from the other one, at the end of a leg
    of some length [m]; negative where that is behind.
    """
    return float(np.clip(way @ np.array([np.cos(yaw), np.sin(yaw)]) / (0.5 * LONG * leg), -1.15, 1.15))


def swing_share(u: np.ndarray | float) -> np.ndarray:
    """How much of its way a foot has gone after a share u of its swing.

    It gathers speed until it is past the standing foot.
    """
    return glide(np.asarray(u), GATHERS, BRAKES)


def swing_height(u: np.ndarray, roll: float) -> np.ndarray:
    """Height of the sole (T,) after shares u (T,) of a swing, as a share of the highest."""
    short = 1.0 - min(max(roll, 0.0), 1.0)
    low = HOVER + (1.0 - HOVER) * short
    rises, falls = RISES + SLOWER * short, FALLS - SLOWER * short
    down = (1.0 - low) * minimum_jerk((u - rises) / (HOVERS - rises)) + low * minimum_jerk((u - falls) / (1.0 - falls))
    return minimum_jerk(u / rises) * (1.0 - down)


def swing_share_at(height: float, rising: bool) -> float:
    """The share of a swing after which a sole is at a height, as a share of the highest, while it rises or later."""
    u = np.linspace(0.0, 1.0, 101)
    heights = swing_height(u, 0.5)
    top = int(np.argmax(heights))
    some = slice(0, top + 1) if rising else slice(top, None)
    return float(u[some][np.argmin(np.abs(heights[some] - height))])


def rolled(body: Body, pitch: np.ndarray, yaw: np.ndarray, pivot: np.ndarray) -> np.ndarray:
    """How far the ankle (..., 3) moves [m] when a flat foot with some heading (...) pitches (...) [rad] about a
    point that stays.

    The point is the front of the sole (or the joint in which the toes bend) where `pivot` (...) is 0, and the heel's
    end where it is 1.
    """
    front = np.array([body.toe, -body.sole]) if body.toes is None else body.skeleton.offsets[body.toes[0], [0, 2]]
    x = front[0] + pivot * (body.heel - front[0])
    z = front[1] + pivot * (-body.sole - front[1])
    along = x - x * np.cos(pitch) - z * np.sin(pitch)
    return np.stack([along * np.cos(yaw), along * np.sin(yaw), z + x * np.sin(pitch) - z * np.cos(pitch)], -1)


def sole_depth(body: Body, pitch: np.ndarray, toe_bend: np.ndarray) -> np.ndarray:
    """How far the lowest point of a sole is below the ankle (...) [m]: of its heel, its front, or the toes' end."""
    front = np.array([body.toe, -body.sole]) if body.toes is None else body.skeleton.offsets[body.toes[0], [0, 2]]
    ball = front[0] * np.sin(pitch) - front[1] * np.cos(pitch)
    toes = np.array([body.toe, -body.sole]) - front
    tip = ball + toes[0] * np.sin(pitch - toe_bend) - toes[1] * np.cos(pitch - toe_bend)
    return np.maximum(np.maximum(ball, tip), body.heel * np.sin(pitch) + body.sole * np.cos(pitch))


def body_yaw(feet: Feet, fps: float) -> np.ndarray:
    """Heading of the pelvis (T,) [rad]: between the feet, without their haste."""
    return smooth(feet.yaw.mean(-1), round(0.2 * fps))


def stride_difference(feet: Feet, yaw: np.ndarray, fps: float) -> np.ndarray:
    """How far the left foot is in front of the right one (T,) [m], along the heading, smoothed."""
    between = feet.pos_w[:, 0, :2] - feet.pos_w[:, 1, :2]
    return smooth(between[:, 0] * np.cos(yaw) + between[:, 1] * np.sin(yaw), round(0.13 * fps))


def _pitch(left: np.ndarray, landed: np.ndarray, leaves: np.ndarray, lands: float) -> np.ndarray:
    """Pitch (T,) [rad] of a foot at times (T,) from when it leaves the floor and from when it lands [gait cycles].

    It rolls as much as the other foot is ahead and behind then. With a negative `lands`, the toes land first.
    """
    strike, leave = LANDING(np.clip(landed, *LANDING.x[[0, -1]])), LEAVING(np.clip(left, *LEAVING.x[[0, -1]]))
    return leaves * leave + (lands if lands > 0 else BACK * lands) * strike


def _pivot(u: np.ndarray, pitch: np.ndarray, roll: float) -> np.ndarray:
    """What a swinging foot pitches about after shares u (T,) of its swing: the toes (0) while they point down, the
    heel (1) while they point up, and what it rolls about on the floor as it leaves that and lands.
    """
    lower = minimum_jerk(0.5 - pitch / (2 * TIPS)) * minimum_jerk(u / 0.3)
    return lower + ((roll >= 0) - lower) * minimum_jerk((u - 0.7) / 0.3)


def _go_on(
    start: FeetStart,
    steps: Footsteps,
    fps: float,
    body: Body,
    plan: _Flat,
) -> None:
    """Make the planned feet begin as they are: in place, what does not bear until it lands, the pitch of what bears
    within a moment.
    """
    base, yaw, pitch, pivot, contact = plan.base, plan.yaw, plan.pitch, plan.pivot, plan.contact
    for side in (0, 1):
        landing = steps.touch_down[(steps.side == side) & (steps.touch_down > 0)]
        lasts = float(landing[0]) if len(landing) and not start.bears[side] else 0.15
        pitch[:, side] = ease(pitch[:, side], start.pitch[side], start.pitch_rate[side], fps, lasts)
        if start.bears[side]:
            continue
        yaw[:, side] = ease(yaw[:, side], start.yaw[side], start.yaw_rate[side], fps, lasts)
        # the flat foot that this pitched one stands for, now and one frame later
        now = start.pos_w[side] - rolled(body, start.pitch[side], start.yaw[side], pivot[0, side])
        later = start.pos_w[side] + start.vel_w[side] / fps - rolled(body, pitch[1, side], yaw[1, side], pivot[1, side])
        base[:, side] = ease(base[:, side], now, (later - now) * fps, fps, lasts, forward=True)
        contact[:, side] = contact[:, side] & (np.arange(len(contact)) > 0)


def _bump(u: np.ndarray) -> np.ndarray:
    """From 0 to 1 at u = 0.5 and back, at rest and without a kink at both ends."""
    u = np.clip(u, 0.0, 1.0)
    return (4 * u * (1 - u)) ** 3
