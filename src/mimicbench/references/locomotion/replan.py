"""Planning a walk from the midst of any motion.

The swinging foot lands first, from where it is and as fast as it is; the pelvis goes on from its place and velocity.
"""

from dataclasses import replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.references.body.body import Body
from mimicbench.references.body.limbs import ease
from mimicbench.references.curves import minimum_jerk, smooth_below
from mimicbench.references.locomotion.feet import rolled, swing_share, swing_share_at
from mimicbench.references.locomotion.gait import Footsteps, Gait, body_places, first_side, place_feet, step_times
from mimicbench.references.locomotion.height import carried_height
from mimicbench.references.locomotion.landing import land_softly
from mimicbench.references.locomotion.route import Route, ahead_of
from mimicbench.references.locomotion.states import LONG_AGO, BodyState
from mimicbench.references.locomotion.walking import FPS, UPRIGHT, Walk, follow, hips_of

MOVES = 0.12
"""A pelvis that is faster walks [m/s]."""
JOINS = 0.6
"""Within so many seconds the pelvis joins the plan."""


def walk_from(
    body: Body,
    state: BodyState,
    route: Route,
    stop_xy: np.ndarray,
    stop_yaw: float,
    gait: Gait,
    after: float,
    duration: float = 0.0,
) -> Walk:
    """As `walking.walk`, but from the midst of a motion: the first frame is the state, and goes on with its velocity.

    The route begins at the state's `place`. Who moves fast goes on for a step before a sharp turn.
    """
    steps = continue_footsteps(body, state, route, stop_xy, stop_yaw, gait)
    way = follow(body, steps, gait, after, duration, state.feet, state.pelvis_pos_w[:2])
    yaw = ease(way.yaw + way.twist, way.yaw[0] + _near(state.yaw - way.yaw[0]), state.yaw_rate, FPS, JOINS) - way.twist
    pelvis = way.pelvis_pos_w.copy()
    pelvis[:, :2] = ease(pelvis[:, :2], state.pelvis_pos_w[:2], state.pelvis_vel_w[:2], FPS, JOINS)
    way = replace(
        way,
        yaw=yaw,
        pelvis_pos_w=pelvis,
        list=ease(way.list, state.roll, state.roll_rate, FPS, JOINS),
        look=ease(way.look, state.look, state.look_rate, FPS, JOINS),
        bend=ease(way.bend, state.lean - UPRIGHT, state.lean_rate, FPS, JOINS),
    )
    hips = hips_of(body, way)
    height = carried_height(body, hips, steps, way.time, gait)
    height = ease(height, state.pelvis_pos_w[2], state.pelvis_vel_w[2], FPS, JOINS)
    # where the pelvis is carried farther than was planned, it sinks as much as the legs need
    spare = np.minimum(hips.highest(body) - height, 0.0)
    pelvis[:, 2] = height + minimum_jerk(way.time * FPS / 4) * smooth_below(spare, 3)
    return replace(way, feet=land_softly(body, hips, pelvis[:, 2], way.feet, steps, way.time))


def continue_footsteps(
    body: Body, state: BodyState, route: Route, stop_xy: np.ndarray, stop_yaw: float, gait: Gait
) -> Footsteps:
    """Footsteps from a state on: first those that brought the feet here, at negative times, then those that are to
    come.
    """
    state = _since_when(body, state, gait)
    feet, swing, scale = state.feet, gait.swing_time, body.size
    forward = ahead_of(state.yaw)
    speed = float(state.pelvis_vel_w[:2] @ forward)
    route = Route(np.concatenate([state.place[None], route.points[1:]]))
    walking, side, lift = _next_swing(state, gait, speed)
    if walking:
        centers, yaws = _catch(state, route, lift + swing, speed, stop_xy, stop_yaw, gait)
    else:
        centers, yaws = body_places(state.yaw, route, stop_xy, stop_yaw, gait)
        side = first_side(state.yaw, yaws)
    centers, yaws = [*centers, stop_xy], [*yaws, yaws[-1]]
    # flat feet that what bears has rolled from
    flat = feet.pos_w - rolled(body, feet.pitch, feet.yaw, (feet.pitch < 0).astype(float))
    heading = state.yaw + rot.wrap_angle(feet.yaw - state.yaw)
    sides, xy = place_feet(flat[:, :2], list(heading), centers, yaws, side, gait, scale)
    for _ in range(2):  # feet that had to keep to their side end beside the goal: one step more each
        if len(xy) < 2 or np.linalg.norm(xy[-2:].mean(0) - stop_xy) < 0.02:
            break
        centers, yaws = [*centers, stop_xy], [*yaws, yaws[-1]]
        sides, xy = place_feet(flat[:, :2], list(heading), centers, yaws, side, gait, scale)
    count = _needed(flat[:, :2], heading, sides, xy, yaws, 0 if feet.bears.all() else 1)
    times = np.concatenate([[gait.period], step_times(centers, gait)])[:count]
    touch_down = lift + swing + np.cumsum(times) - gait.period
    # where the feet came from, so that they roll now as they would have
    first, stride = flat[:, :2].copy(), 2 * gait.period * max(speed, 0.0) * forward
    past = sorted(
        (float(state.since[foot]), foot) for foot in (0, 1) if feet.bears[foot] and state.since[foot] < 2 * gait.period
    )[::-1]
    for _, foot in past:
        first[foot] -= stride
    if not feet.bears[side] and count:
        gone = min(float(swing_share(-lift / swing)), 0.75)
        first[side] += (first[side] - xy[0]) * gone / (1 - gone)
    came = np.array([foot for _, foot in past], int)
    landed = -np.array([since for since, _ in past])
    return Footsteps(
        first,
        state.yaw,
        np.concatenate([came, sides[:count]]),
        np.concatenate([flat[came, :2], xy[:count]]),
        np.concatenate([heading[came], yaws[:count]]),
        np.concatenate([landed - swing, touch_down - (1.0 - gait.overlap) * times]),
        np.concatenate([landed, touch_down]),
        heading,
    )


def _since_when(body: Body, state: BodyState, gait: Gait) -> BodyState:
    """The state with what a single moment tells of feet that nobody saw lift off or land: of those that swing their
    height, else which is in front.
    """
    feet, since = state.feet, state.since.copy()
    flat = feet.pos_w - rolled(body, feet.pitch, feet.yaw, (feet.pitch < 0).astype(float))
    for side in np.flatnonzero(~feet.bears & (since >= LONG_AGO)):
        share = swing_share_at((flat[side, 2] - body.sole) / (gait.clearance * body.size), feet.vel_w[side, 2] > 0)
        since[side] = gait.swing_time * share
    forward = ahead_of(state.yaw)
    if feet.bears.all() and (since >= LONG_AGO).all() and abs(state.pelvis_vel_w[:2] @ forward) > MOVES:
        since[int(np.argmax(feet.pos_w[:, :2] @ forward * np.sign(state.pelvis_vel_w[:2] @ forward)))] = (
            0.5 * gait.overlap * gait.period
        )
    return replace(state, since=since)


def _next_swing(state: BodyState, gait: Gait, speed: float) -> tuple[bool, int, float]:
    """Whether the body is walking, which foot swings or will next, and when it lifts off [s], negative if it has."""
    bears, shift = state.feet.bears, gait.overlap * gait.period
    if not bears.all():
        side = int(np.argmin(bears)) if bears.any() else int(np.argmax(state.feet.pos_w[:, 2]))
        left = max(gait.swing_time - float(state.since[side]), 4 / FPS)
        return True, side, left - gait.swing_time
    last = int(np.argmin(state.since))
    if abs(speed) > MOVES or state.since[last] < shift:
        return True, 1 - last, max(shift - float(state.since[last]), 1 / FPS)
    return False, 0, max(0.5 * gait.stand, shift)


def _catch(
    state: BodyState, route: Route, lands: float, speed: float, stop_xy: np.ndarray, stop_yaw: float, gait: Gait
) -> tuple[list[np.ndarray], list[float]]:
    """Places and headings of the body at the touch-downs.

    The first, in `lands` seconds, is where its speed carries it.
    """
    total, most = route.length, gait.max_turn * min(1.0, lands / gait.period)
    if total <= 0.05:  # what is left is a turn on the spot
        return body_places(state.yaw, route, stop_xy, stop_yaw, gait)
    gone = min(total, max(0.0, speed) * lands + 0.5 * min(max(speed, 0.3 * gait.speed), gait.speed) * gait.period)
    error = float(rot.wrap_angle(route.at(min(0.15, total))[1] - state.yaw))
    yaw = state.yaw + float(np.clip(error, -most, most))
    sharp = float(minimum_jerk(np.array((abs(error) - 0.4) / 0.8)))
    slow = min(speed, gait.speed) * (lands + 0.3 * gait.period)
    straight = state.place + max(0.0, slow) * ahead_of(state.yaw)
    center = route.at(gone * (1 - sharp))[0] * (1 - sharp) + straight * sharp
    rest = Route(np.concatenate([center[None], route.after(gone * (1 - sharp))[1:]]))
    centers, yaws = body_places(yaw, rest, stop_xy, stop_yaw, gait, float(np.clip(speed / gait.speed, 0.6, 1.0)))
    return [center, *centers], [yaw, *yaws]


def _needed(
    foot_xy: np.ndarray, foot_yaw: np.ndarray, sides: np.ndarray, xy: np.ndarray, yaws: list[float], least: int
) -> int:
    """How many of the steps are needed: the last ones may leave the feet where they already are."""
    places, turns = [foot_xy[0], foot_xy[1]], [float(foot_yaw[0]), float(foot_yaw[1])]
    needed = least
    for i, side in enumerate(sides):
        if np.linalg.norm(xy[i] - places[side]) > 0.02 or abs(yaws[i] - turns[side]) > 0.03:
            needed = max(needed, i + 1)
        places[side], turns[side] = xy[i], yaws[i]
    return needed


def _near(angle: float) -> float:
    return float(rot.wrap_angle(angle))
