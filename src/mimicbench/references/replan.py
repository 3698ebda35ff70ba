"""Planning a walk from the midst of any motion: what the body does at one moment, and the walk that goes on from there.

The swinging foot lands first, from where it is and as fast as it is; the pelvis goes on from its place and velocity.
"""

from dataclasses import dataclass, replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.motion import HumanMotion, forward_kinematics
from mimicbench.references.body import Body, body_of
from mimicbench.references.feet import FeetStart, rolled
from mimicbench.references.gait import Footsteps, Gait, Route, ahead_of, body_places, first_side, place_feet
from mimicbench.references.limbs import ease, minimum_jerk, smooth_below
from mimicbench.references.walking import FPS, Walk, follow, highest_pelvis, standing_height, walk

LONG_AGO = 10.0
"""Since when a foot stands that has not moved yet [s]."""
MOVES = 0.12
"""A pelvis that is faster walks [m/s]."""
JOINS = 0.6
"""Within so many seconds the pelvis joins the plan."""
FARTHEST = 0.998
"""Share of its length to which a leg may be stretched meanwhile."""


@dataclass(frozen=True)
class BodyState:
    """A body in motion at one moment; axis 0 of what concerns the feet is left, right."""

    feet: FeetStart
    since: np.ndarray
    """(2,) for how long each foot has borne, or swung [s]."""
    pelvis_pos_w: np.ndarray
    """(3,) [m]."""
    pelvis_vel_w: np.ndarray
    """(3,) [m/s]"""
    yaw: float
    """Heading of the pelvis [rad]."""
    yaw_rate: float
    """[rad/s]"""
    roll: float
    """List of the pelvis, left side up positive [rad]."""
    roll_rate: float
    """[rad/s]"""
    look: float
    """Turn of the head relative to the pelvis [rad]."""
    look_rate: float
    """[rad/s]"""

    @property
    def place(self) -> np.ndarray:
        """(2,) where a route from here begins [m]: as far as the pelvis is, in the middle between the feet."""
        middle, forward = self.feet.pos_w[:, :2].mean(0), ahead_of(self.yaw)
        return middle + ((self.pelvis_pos_w[:2] - middle) @ forward) * forward

    def moved(self, xy: np.ndarray, yaw: float) -> "BodyState":
        """The same state with its `place` at (2,) [m] and its heading `yaw` [rad]."""
        turn = rot.from_yaw(np.array(yaw - self.yaw))
        here = np.append(self.place, 0.0)

        def put(points: np.ndarray) -> np.ndarray:
            return rot.rotate(turn, points - here) + np.append(xy, 0.0)

        feet = replace(self.feet, pos_w=put(self.feet.pos_w), vel_w=rot.rotate(turn, self.feet.vel_w), yaw=self.feet.yaw + yaw - self.yaw)
        return replace(self, feet=feet, pelvis_pos_w=put(self.pelvis_pos_w), pelvis_vel_w=rot.rotate(turn, self.pelvis_vel_w), yaw=yaw)


def state_of_walk(way: Walk, frame: int) -> BodyState:
    """What the body does at a frame of a walk."""
    now, steps = way.time[frame], way.steps
    since = np.full(2, LONG_AGO)
    for side in (0, 1):
        events = np.concatenate([steps.lift_off[steps.side == side], steps.touch_down[steps.side == side]])
        past = now - events[events <= now + 1e-9]
        since[side] = past.min(initial=LONG_AGO)
    feet = way.feet
    tracks = _rates((feet.pos_w, feet.yaw, feet.pitch, way.pelvis_pos_w, way.yaw + way.twist, way.list, way.look), frame, FPS)
    return _state(tracks, feet.contact[frame], since)


def state_of_motion(motion: HumanMotion, frame: int) -> BodyState:
    """What the body does at a frame of any clip whose feet have contact labels. Raises BadMotion without labels or with a single frame."""
    names = [name for name in ("left_foot", "right_foot") if name in motion.contact_names]
    if len(names) < 2 or motion.frames < 2:
        raise BadMotion(f"{motion.id}: planning from a frame needs two frames or more and contact labels of both feet; detect contacts first")
    body = body_of(motion.skeleton)
    first = max(0, frame - 1)
    near = slice(first, frame + 2)
    pos, quat = forward_kinematics(motion.skeleton, motion.root_pos_w[near], motion.local_quat[near])
    ankles = [leg.end for leg in body.legs]
    pelvis, foot = quat[:, body.pelvis], quat[:, ankles]
    pitch = np.arcsin(np.clip(-rot.rotate(foot, np.array([1.0, 0.0, 0.0]))[..., 2], -1, 1))
    yaw = np.unwrap(rot.yaw_of(pelvis))
    w, x, y, z = np.moveaxis(pelvis, -1, 0)
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x**2 + y**2))
    look = rot.wrap_angle(rot.yaw_of(quat[:, body.head]) - yaw)
    # headings of the feet are given near that of the pelvis, so that none is a turn away
    heading = yaw[:, None] + rot.wrap_angle(rot.yaw_of(foot) - yaw[:, None])
    tracks = _rates((pos[:, ankles], heading, pitch, pos[:, body.pelvis], yaw, roll, look), frame - first, motion.fps)
    bears = motion.contacts[:, [motion.contact_names.index(name) for name in names]].astype(bool)
    since = np.full(2, LONG_AGO)
    for side in (0, 1):
        changes = np.flatnonzero(np.diff(bears[: frame + 1, side]))
        if len(changes):
            since[side] = (frame - changes[-1] - 0.5) / motion.fps
    return _state(tracks, bears[frame], since)


def in_stride(body: Body, xy: np.ndarray, yaw: float, gait: Gait, phase: float) -> BodyState:
    """Somebody who walks steadily and passes (2,) [m] in direction `yaw` [rad] at a phase of the gait cycle in [0, 1).

    At phase 0 the left heel strikes.
    """
    far = 10 * gait.speed * gait.period
    way = walk(body, Route(np.array([[0.0, 0.0], [far, 0.0]])), 0.0, np.array([far, 0.0]), 0.0, gait, 0.5)
    strikes = way.steps.touch_down[way.steps.side == 0]
    strike = strikes[np.searchsorted(strikes, 4.5 * gait.period + gait.stand)]
    return state_of_walk(way, round(float(strike + (phase % 1.0) * 2 * gait.period) * FPS)).moved(xy, yaw)


def walk_from(body: Body, state: BodyState, route: Route, stop_xy: np.ndarray, stop_yaw: float, gait: Gait, after: float, duration: float = 0.0) -> Walk:
    """As `walking.walk`, but from the midst of a motion: the first frame is the state, and goes on with its velocity.

    The route begins at the state's `place`. Who moves fast goes on for a step before a sharp turn.
    """
    steps = continue_footsteps(body, state, route, stop_xy, stop_yaw, gait)
    way = follow(body, steps, gait, after, duration, state.feet, state.pelvis_pos_w[:2])
    yaw = ease(way.yaw + way.twist, way.yaw[0] + _near(state.yaw - way.yaw[0]), state.yaw_rate, FPS, JOINS) - way.twist
    pelvis = way.pelvis_pos_w.copy()
    pelvis[:, :2] = ease(pelvis[:, :2], state.pelvis_pos_w[:2], state.pelvis_vel_w[:2], FPS, JOINS)
    turned = yaw + way.twist
    height = ease(standing_height(body, pelvis[:, :2], turned, way.feet, gait.rolls), state.pelvis_pos_w[2], state.pelvis_vel_w[2], FPS, JOINS)
    # where the pelvis is carried farther than was planned, it sinks as much as the legs need
    spare = highest_pelvis(body, pelvis[:, :2], turned, way.feet, FARTHEST) + body.hip_drop - height
    pelvis[:, 2] = height + minimum_jerk(way.time * FPS / 4) * smooth_below(np.minimum(spare, 0.0), 3)
    return replace(
        way, yaw=yaw, pelvis_pos_w=pelvis,
        list=ease(way.list, state.roll, state.roll_rate, FPS, JOINS), look=ease(way.look, state.look, state.look_rate, FPS, JOINS),
    )  # fmt: skip


def continue_footsteps(body: Body, state: BodyState, route: Route, stop_xy: np.ndarray, stop_yaw: float, gait: Gait) -> Footsteps:
    """Footsteps from a state on: first those that brought the feet here, at negative times, then those that are to come."""
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
    touch_down = lift + swing + gait.period * np.arange(count)
    # where the feet came from, so that they roll now as they would have
    first, stride = flat[:, :2].copy(), 2 * gait.period * max(speed, 0.0) * forward
    past = sorted((float(state.since[foot]), foot) for foot in (0, 1) if feet.bears[foot] and state.since[foot] < 2 * gait.period)[::-1]
    for _, foot in past:
        first[foot] -= stride
    if not feet.bears[side] and count:
        gone = min(float(minimum_jerk(np.array(-lift / swing))), 0.75)
        first[side] += (first[side] - xy[0]) * gone / (1 - gone)
    came = np.array([foot for _, foot in past], int)
    landed = -np.array([since for since, _ in past])
    return Footsteps(
        first, state.yaw, np.concatenate([came, sides[:count]]), np.concatenate([flat[came, :2], xy[:count]]),
        np.concatenate([heading[came], yaws[:count]]), np.concatenate([landed - swing, touch_down - swing]), np.concatenate([landed, touch_down]), heading,
    )  # fmt: skip


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
    """Places and headings of the body at the touch-downs; the first, in `lands` seconds, is where its speed carries it."""
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


def _needed(foot_xy: np.ndarray, foot_yaw: np.ndarray, sides: np.ndarray, xy: np.ndarray, yaws: list[float], least: int) -> int:
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


def _rates(tracks: tuple[np.ndarray, ...], frame: int, fps: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Values of tracks (T, ...) at a frame, and how fast they change there."""
    before, behind = max(0, frame - 1), min(len(tracks[0]) - 1, frame + 1)
    return [(track[frame], (track[behind] - track[before]) * fps / max(1, behind - before)) for track in tracks]


def _state(tracks: list[tuple[np.ndarray, np.ndarray]], bears: np.ndarray, since: np.ndarray) -> BodyState:
    ankles, foot_yaw, foot_pitch, pelvis, yaw, roll, look = tracks
    # what bears is still, whatever the differences across its landing say
    feet = FeetStart(*ankles, *foot_yaw, *foot_pitch, bears)
    return BodyState(feet, since, *pelvis, float(yaw[0]), float(yaw[1]), float(roll[0]), float(roll[1]), float(look[0]), float(look[1]))
