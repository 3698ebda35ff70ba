"""A person who walks somewhere and stops: from footsteps to pelvis, trunk, head and arms."""

from dataclasses import dataclass, replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.curves import smooth, smooth_above, smooth_below
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body.body import Body
from mimicbench.references.body.limbs import about_x, about_y
from mimicbench.references.body.posing import Arms, Legs
from mimicbench.references.locomotion.balance import balance
from mimicbench.references.locomotion.feet import Feet, FeetStart, body_yaw, stride_difference, swing_feet
from mimicbench.references.locomotion.gait import Footsteps, Gait, Route, plan_footsteps

FPS = 30.0
"""Frame rate of synthetic clips."""
REACH = 0.985
"""Share of its full length to which the leg of a person with flat feet may be stretched."""
ROLLING_REACH = 0.994
"""The same with feet that roll, which is reached as the heel strikes: the knee stays bent by some 12 degrees."""
USUAL_PITCH = 0.03
"""[rad] Who walks upright adds so much to the pelvis' own forward lean."""
STRAIGHTEST = 0.9972
"""The same where the pelvis lists and leans in a quick turn: the knee stays bent by 8 degrees."""
SOFT = 0.15
"""The pelvis follows the arcs of the legs smoothed over so many seconds to either side: 2 to 5 cm up and down (Perry &
Burnfield 2010)."""


@dataclass(frozen=True)
class Walk:
    """A walk and what follows it on standing feet, in T frames at FPS."""

    steps: Footsteps
    time: np.ndarray
    """(T,) [s]."""
    feet: Feet
    yaw: np.ndarray
    """(T,) heading of the pelvis, without jumps of 2 pi [rad]."""
    pelvis_pos_w: np.ndarray
    """(T, 3) in balance over the feet [m]."""
    ahead: np.ndarray
    """(T,) how far the left foot is in front of the right one [m]."""
    twist: np.ndarray
    """(T,) turn of the pelvis with the steps, to be added to `yaw` [rad]."""
    list: np.ndarray
    """(T,) roll of the pelvis, down on the side of the swinging leg [rad]."""
    look: np.ndarray
    """(T,) turn of the head towards where the way leads [rad]."""
    bend: np.ndarray
    """(T,) how far pelvis and trunk lean forward because of the walk [rad], beyond what a task asks for."""
    calm: float
    """Share of the trunk's motion from which the head is kept."""

    @property
    def end(self) -> float:
        """When the last foot stands [s]."""
        return self.steps.end

    def legs(self) -> Legs:
        """The legs that go with the feet."""
        heading = rot.from_yaw(self.feet.yaw)
        foot = rot.multiply(heading, about_y(self.feet.pitch))
        return Legs(self.feet.pos_w, foot, rot.rotate(heading, np.array([0.0, 1.0, 0.0])), self.feet.toe_bend)

    def pelvis_quat(self, pitch: np.ndarray) -> np.ndarray:
        """(T, 4) the pelvis with the walk's heading, twist and list, bent forward by pitch (T,) [rad]."""
        return rot.multiply(
            rot.from_yaw(self.yaw + self.twist), rot.multiply(about_y(pitch + self.bend), about_x(self.list))
        )

    def chest_turn(self, spine: np.ndarray) -> np.ndarray:
        """(T, 4) the chest relative to the pelvis: it counters twist and list, and bends forward by spine (T,)
        [rad].
        """
        return rot.multiply(rot.from_yaw(-1.6 * self.twist), rot.multiply(about_y(spine), about_x(-self.list)))

    def head_turn(self, nod: np.ndarray) -> np.ndarray:
        """(T, 4) the head relative to the chest: it looks where the way leads, steadily, and nods by (T,) [rad]."""
        return rot.multiply(
            rot.from_yaw(self.look + self.calm * 0.6 * self.twist), about_y(nod - self.calm * self.bend)
        )

    def arms(self, body: Body, amount: float) -> Arms:
        """Arms that swing against the legs, `amount` times as much as usual.

        That is 29 degrees from back to front at 0.65 m/s and 39 at 1.3 m/s (Perry & Burnfield 2010: 32 at the usual
        speed, 8 of them forward).
        """
        upper, elbow = [], []
        for sign in (1.0, -1.0):
            swing = amount * sign * self.ahead / body.size
            if self.calm > 0:
                swing = 0.55 * amount * np.tanh(sign * self.ahead / body.size / 0.55)
            upper.append(rot.multiply(about_y(0.04 + 0.75 * swing), about_x(np.full_like(swing, sign * 0.13))))
            elbow.append(about_y(-0.30 - 0.25 * np.maximum(0.0, 0.2 - swing)))
        return Arms(np.stack(upper, 1), np.stack(elbow, 1))


def draw_start(random: np.random.Generator, obj: SceneObject) -> tuple[np.ndarray, float]:
    """A place (2,) [m] 1 to 2 m from the origin, within 100 degrees of the front and 0.45 m clear of the object, and
    any heading [rad].
    """
    low, high = obj.bounds()
    azimuth = np.deg2rad(random.uniform(-100, 100))
    ray = np.array([np.cos(azimuth), np.sin(azimuth)])
    edge = np.where(ray > 0, high[:2], low[:2]) + 0.45 * np.sign(ray)
    nearest = max(1.0, float(np.min(edge / np.where(np.abs(ray) < 1e-9, 1e-9, ray))))
    distance = random.uniform(nearest, max(2.0, nearest + 0.5))
    return distance * ray, float(random.uniform(-np.pi, np.pi))


def walk(
    body: Body,
    route: Route,
    start_yaw: float,
    stop_xy: np.ndarray,
    stop_yaw: float,
    gait: Gait,
    after: float,
    duration: float = 0.0,
    lead: float = 0.0,
) -> Walk:
    """Walk along a route, turn and back up to the stop, and stand there at least `after` seconds after the last foot
    has landed.

    The whole has at least `duration` seconds. The first `lead` seconds are left out, so that it begins in the midst of
    the motion;
    a person stands for `gait.stand` seconds before the first foot lifts.

    The point between the ankles starts at the route's first point with heading `start_yaw` [rad] and ends at `stop_xy`
    (2,) [m]
    with heading `stop_yaw` [rad].
    """
    steps = plan_footsteps(start_yaw, route, stop_xy, stop_yaw, gait, body.size)
    skip = round(min(max(lead, 0.0), max(0.0, steps.end - 0.1)) * FPS)
    way = follow(body, steps, gait, after, duration + skip / FPS if skip else duration)
    return way if skip == 0 else _begin_at(way, skip)


def follow(
    body: Body,
    steps: Footsteps,
    gait: Gait,
    after: float,
    duration: float = 0.0,
    feet_start: FeetStart | None = None,
    pelvis_start: np.ndarray | None = None,
) -> Walk:
    """The walk over given footsteps, and at least `after` seconds of standing on the last ones.

    At least `duration` seconds in all.

    It may go on from feet in motion and from where the pelvis is first (2,) [m].
    """
    time = np.arange(int(max(steps.end + after, duration) * FPS) + 1) / FPS
    feet = swing_feet(steps, time, gait, body, feet_start)
    yaw = body_yaw(feet, FPS)
    ahead = stride_difference(feet, yaw, FPS)
    pelvis = np.empty((len(time), 3))
    pelvis[:, :2] = balance(steps, time, gait, body.size, 0.9 * body.size, pelvis_start)
    twist = -0.15 * ahead / body.size
    pelvis[:, 2] = standing_height(body, pelvis[:, :2], yaw + gait.sway * twist, feet, gait.rolls)
    sideways = _sideways(pelvis, feet, yaw)
    soon = int(0.5 * FPS)
    coming = np.concatenate([yaw[soon:], np.repeat(yaw[-1:], min(soon, len(yaw)))])
    look = smooth(np.clip(coming - yaw, -0.6, 0.6), round(0.2 * FPS))
    tilt, leans = (0.25 + 0.20 * gait.sway) * sideways / body.size, gait.sway * _lean(pelvis, yaw, ahead / body.size)
    turn = rot.multiply(rot.from_yaw(yaw + twist), rot.multiply(about_y(leans + USUAL_PITCH), about_x(tilt)))
    pelvis[:, 2] -= smooth_above(_too_straight(body, pelvis, turn, feet), round(0.15 * FPS))
    return Walk(steps, time, feet, yaw, pelvis, ahead, twist, tilt, look, leans, gait.sway)


def standing_height(body: Body, pelvis_xy: np.ndarray, yaw: np.ndarray, feet: Feet, rolls: bool = False) -> np.ndarray:
    """A high and smooth pelvis path (T,) [m] from which both legs reach their feet: lower in double support, as
    people walk.
    """
    limits = highest_pelvis(body, pelvis_xy, yaw, feet, ROLLING_REACH if rolls else REACH)
    if not rolls:
        return smooth_below(limits, round(0.2 * FPS)) - 0.006 + body.hip_drop
    # the legs' arcs have a cusp at each heel strike: their mean motion, lowered by what it is too high there
    height = smooth(limits, round(SOFT * FPS))
    return height + smooth_below(np.minimum(limits - height, 0.0), round(0.3 * FPS)) - 0.004 + body.hip_drop


def _too_straight(body: Body, pelvis: np.ndarray, turn: np.ndarray, feet: Feet) -> np.ndarray:
    """How much too high a pelvis (T, 3) [m] turned by `turn` (T, 4) is for one leg or the other to keep a bent knee
    (T,) [m]; 0 nearly always.
    """
    leg, above = STRAIGHTEST * sum(body.length(body.legs[0])), np.zeros(len(pelvis))
    for side, limb in enumerate(body.legs):
        hip = pelvis + rot.rotate(turn, body.skeleton.offsets[limb.root])
        away = ((hip - feet.pos_w[:, side])[:, :2] ** 2).sum(-1)
        above = np.maximum(
            above, hip[:, 2] - feet.pos_w[:, side, 2] - np.sqrt(np.maximum(leg**2 - away, 0.25 * leg**2))
        )
    return above


def highest_pelvis(body: Body, pelvis_xy: np.ndarray, yaw: np.ndarray, feet: Feet, reach: float) -> np.ndarray:
    """Height of the hips (T,) [m] at which the first of both legs is stretched to some share of its length."""
    leg = reach * sum(body.length(body.legs[0]))
    limits = np.full(len(yaw), leg + body.sole)
    for side, limb in enumerate(body.legs):
        forward, left, _ = body.skeleton.offsets[limb.root]
        hip = (
            pelvis_xy
            + forward * np.stack([np.cos(yaw), np.sin(yaw)], -1)
            + left * np.stack([-np.sin(yaw), np.cos(yaw)], -1)
        )
        away = ((hip - feet.pos_w[:, side, :2]) ** 2).sum(-1)
        limits = np.minimum(limits, feet.pos_w[:, side, 2] + np.sqrt(np.maximum(leg**2 - away, 0.25 * leg**2)))
    return limits


def _sideways(pelvis: np.ndarray, feet: Feet, yaw: np.ndarray) -> np.ndarray:
    """How far the pelvis is to the left of the middle of the feet (T,) [m]."""
    offset = pelvis[:, :2] - feet.pos_w[..., :2].mean(1)
    return smooth(offset[:, 1] * np.cos(yaw) - offset[:, 0] * np.sin(yaw), round(0.2 * FPS))


def _lean(pelvis: np.ndarray, yaw: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    """Forward lean of the trunk (T,) [rad]: with the speed, 3 degrees at 1.3 m/s, and most while both feet bear,
    twice a cycle.

    Perry & Burnfield 2010: 5 +- 2 degrees, the task's own upright lean of 2 degrees included; pelvic tilt +- 2 degrees.
    """
    velocity = np.gradient(pelvis[:, :2], 1 / FPS, axis=0)
    forward = smooth(velocity[:, 0] * np.cos(yaw) + velocity[:, 1] * np.sin(yaw), round(0.4 * FPS))
    return 0.04 * np.clip(forward, 0.0, 2.0) + 0.05 * ahead**2


def _begin_at(way: Walk, frame: int) -> Walk:
    """The same walk from a frame on; times count from there."""
    moment, feet, steps = frame / FPS, way.feet, way.steps
    bend = None if feet.toe_bend is None else feet.toe_bend[frame:]
    cut = Feet(feet.pos_w[frame:], feet.yaw[frame:], feet.pitch[frame:], feet.contact[frame:], bend)
    shifted = replace(steps, lift_off=steps.lift_off - moment, touch_down=steps.touch_down - moment)
    tracks = {
        name: getattr(way, name)[frame:] for name in ("yaw", "pelvis_pos_w", "ahead", "twist", "list", "look", "bend")
    }
    return replace(way, steps=shifted, time=way.time[: len(way.time) - frame], feet=cut, **tracks)
