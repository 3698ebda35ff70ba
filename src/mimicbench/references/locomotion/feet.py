"""Feet that never skate: flat and still in stance, or rolling from the heel over the flat sole to the toes, about a
point that stays.
"""

from dataclasses import dataclass

import numpy as np

from mimicbench.core.curves import minimum_jerk, smooth
from mimicbench.references.body.body import Body
from mimicbench.references.body.limbs import ease, glide
from mimicbench.references.locomotion.gait import Footsteps, Gait, left_of

LONG = 0.95
"""A stride for which the feet roll by `Gait.heel_strike` and `Gait.heel_off` [m at size 1]; in proportion for others,
up to 1.15 times."""
LOADING = 0.12
"""The foot is flat after this share of the gait cycle (loading response, Perry & Burnfield 2010)."""
RISING = 0.05
"""The heel leaves the floor this share of the cycle before the other foot lands, at 40 % of the cycle when walking
slowly (ibid.)."""

GATHERS, BRAKES = 0.26, 0.22
"""Shares of a swing in which a rolling foot gathers speed and loses it, up to 0.8 m/s; more of the shorter swings of
who walks faster."""

EARLY = 0.8
"""A rolling foot is highest before the middle of its swing, as the knee bends most at 72 % of the cycle (ibid.): at 0.5
to the power of 1 / EARLY."""


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
    toe_bend: np.ndarray | None = None
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


def swing_feet(steps: Footsteps, time: np.ndarray, gait: Gait, body: Body, start: FeetStart | None = None) -> Feet:
    """Both feet at times (T,): what bears is exactly still.

    In swing minimum jerk over the floor, on an arc, heel off first and down first.

    With `start` they go on from that, exactly, and join the plan until they land or, if they stand, within a moment.
    """
    scale, fps = body.size, 1.0 / float(time[1] - time[0])
    base = np.empty((len(time), 2, 3))
    base[..., :2], base[..., 2] = steps.first_xy, body.sole
    yaw = np.tile(steps.first_foot_yaw, (len(time), 1))
    pitch, pivot, bend = np.zeros((len(time), 2)), np.zeros((len(time), 2)), np.zeros((len(time), 2))
    contact = np.ones((len(time), 2), bool)
    foot_xy, foot_yaw = steps.first_xy.copy(), steps.first_foot_yaw.copy()
    loose = np.zeros((len(time), 2))
    for side, xy, heading, lift, land in zip(
        steps.side, steps.xy, steps.yaw, steps.lift_off, steps.touch_down, strict=True
    ):
        u = (time - lift) / (land - lift)
        swinging, after = (u > 0) & (u < 1), u >= 1
        share = swing_share(u[swinging], gait)
        sign = 1.0 - 2.0 * side
        sideways = left_of(float(foot_yaw[1 - side]))
        path = foot_xy[side] + share[:, None] * (xy - foot_xy[side])
        # swing around the stance foot, not through it
        middle = sign * (0.5 * (foot_xy[side] + xy) - foot_xy[1 - side]) @ sideways
        path = (
            path
            + sign * max(0.0, min(0.20, 0.9 * gait.width) * scale - middle) * _bump(u[swinging])[:, None] * sideways
        )
        base[swinging, side, :2], base[after, side, :2] = path, xy
        base[swinging, side, 2] = body.sole + gait.clearance * scale * _bump(
            u[swinging] ** EARLY if gait.rolls else u[swinging]
        )
        yaw[swinging, side] = foot_yaw[side] + share * (heading - foot_yaw[side])
        yaw[after, side] = heading
        if gait.rolls:
            forward = float((xy - foot_xy[side]) @ np.array([np.cos(heading), np.sin(heading)]))
            amount = float(np.clip(forward / (LONG * scale), 0.0, 1.15))
            if amount > 0:
                pitch[:, side] += amount * _roll(time, lift, land, gait)
            pivot[swinging, side], pivot[after, side] = minimum_jerk((u[swinging] - 0.25) / 0.55), 1.0
            loose[swinging, side] = minimum_jerk((u[swinging] - 0.10) / 0.45)
        else:
            stride = min(1.0, float(np.linalg.norm(xy - foot_xy[side])) / (0.6 * scale))
            tilt = stride * (0.20 * _bump(u[swinging] / 0.6) - 0.13 * _bump((u[swinging] - 0.5) / 0.5))
            # the tilted foot's lowest end keeps the clearance
            lifted = np.where(tilt > 0, body.toe, -body.heel) * np.abs(np.sin(tilt))
            base[swinging, side, 2] = body.sole + gait.clearance * scale * _bump(u[swinging]) + lifted
            pitch[swinging, side] = tilt
        contact[swinging, side] = False
        foot_xy[side], foot_yaw[side] = xy, heading
    if start is not None:
        _go_on(start, steps, time, fps, body, base, yaw, pitch, pivot, contact)
    if not gait.rolls and start is None:
        return Feet(base, yaw, pitch, contact, np.zeros_like(pitch))
    pivot = np.where(contact, pitch < 0, pivot)
    bend = np.maximum(pitch, 0.0) * (1.0 - np.where(contact, 0.0, loose))
    return Feet(base + rolled(body, pitch, yaw, pivot), yaw, pitch, contact, bend)


def swing_share(u: np.ndarray | float, gait: Gait) -> np.ndarray:
    """How much of its way a foot has gone after a share u of its swing.

    Feet that roll gather speed as they leave the floor and lose it as they land, so they are no faster than they must
    be, and strike
    while they are in front of the body as far as they come.
    """
    if not gait.rolls:
        return minimum_jerk(np.asarray(u))
    more = 0.3 * min(max(gait.speed - 0.8, 0.0), 0.5)
    return glide(np.asarray(u), GATHERS + more, BRAKES + more)


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


def body_yaw(feet: Feet, fps: float) -> np.ndarray:
    """Heading of the pelvis (T,) [rad]: between the feet, without their haste."""
    return smooth(feet.yaw.mean(-1), round(0.2 * fps))


def stride_difference(feet: Feet, yaw: np.ndarray, fps: float) -> np.ndarray:
    """How far the left foot is in front of the right one (T,) [m], along the heading, smoothed."""
    between = feet.pos_w[:, 0, :2] - feet.pos_w[:, 1, :2]
    return smooth(between[:, 0] * np.cos(yaw) + between[:, 1] * np.sin(yaw), round(0.13 * fps))


def _roll(time: np.ndarray, lift: float, land: float, gait: Gait) -> np.ndarray:
    """Pitch (T,) [rad] of a foot around one of its swings: the heel rises before, lands first, and the sole lies
    down after it.
    """
    swing, cycle = land - lift, 2.0 * gait.period
    peak = lift + 0.12 * swing
    rises = lift - gait.overlap * gait.period - RISING * cycle
    off = minimum_jerk((time - rises) / (peak - rises)) * (1.0 - minimum_jerk((time - peak) / (0.64 * swing)))
    turns = land - 0.05 * swing
    strike = minimum_jerk((time - turns) / (0.50 * swing) + 1.0) * (
        1.0 - minimum_jerk((time - turns) / (land + LOADING * cycle - turns))
    )
    return gait.heel_off * off - gait.heel_strike * strike


def _go_on(
    start: FeetStart,
    steps: Footsteps,
    time: np.ndarray,
    fps: float,
    body: Body,
    base: np.ndarray,
    yaw: np.ndarray,
    pitch: np.ndarray,
    pivot: np.ndarray,
    contact: np.ndarray,
) -> None:
    """Make the planned feet begin as they are: in place, what does not bear until it lands, the pitch of what bears
    within a moment.
    """
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
        contact[:, side] = contact[:, side] & (np.arange(len(time)) > 0)


def _bump(u: np.ndarray) -> np.ndarray:
    """From 0 to 1 at u = 0.5 and back, at rest and without a kink at both ends."""
    u = np.clip(u, 0.0, 1.0)
    return (4 * u * (1 - u)) ** 3
