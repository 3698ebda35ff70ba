"""A person who walks somewhere and stops: from footsteps to pelvis, trunk, head and arms."""

from dataclasses import dataclass, replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body.body import Body
from mimicbench.references.body.limbs import about_x, about_y
from mimicbench.references.body.posing import Arms, Legs
from mimicbench.references.curves import minimum_jerk, smooth
from mimicbench.references.locomotion.balance import balance
from mimicbench.references.locomotion.feet import Feet, FeetStart, body_yaw, stride_difference, swing_feet
from mimicbench.references.locomotion.gait import Footsteps, Gait, plan_footsteps
from mimicbench.references.locomotion.gaze import gaze
from mimicbench.references.locomotion.height import Hips, carried_height
from mimicbench.references.locomotion.landing import land_softly
from mimicbench.references.locomotion.route import Route

FPS = 30.0
"""Frame rate of synthetic clips."""
UPRIGHT = 0.03
"""Forward lean of the pelvis of who stands upright [rad]."""
REACH = 0.985
"""Share of its full length to which the leg of who stands and reaches is stretched."""
TILT = 0.12
"""The pelvis of who walks is tilted back by so much [rad], with the chest bent forward over it, in all recordings."""
STOOP = 0.05
"""The chest's own forward lean [rad]."""
SETTLES = 0.9
"""Within so many seconds after the last step both are over, and what the person then does begins upright."""
DELAY = 0.13
"""Arms swing so much later than the legs [s]."""


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
    chest: np.ndarray
    """(T,) and of the chest with the arms, against the steps [rad]."""
    list: np.ndarray
    """(T,) roll of the pelvis, down on the side of the swinging leg [rad]."""
    look: np.ndarray
    """(T,) turn of the head towards where the way leads, or to what the person will sit down on [rad]."""
    nod: np.ndarray
    """(T,) how far down it looks there [rad]."""
    bend: np.ndarray
    """(T,) how far the pelvis leans forward because of the walk [rad], beyond what a task asks for."""
    stoop: np.ndarray
    """(T,) and the chest [rad]."""

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
        """(T, 4) the chest relative to the pelvis: it counters twist, lean and list, and bends forward by spine (T,)
        [rad].
        """
        forward = about_y(spine + self.stoop - self.bend)
        return rot.multiply(rot.from_yaw(self.chest - self.twist), rot.multiply(forward, about_x(-self.list)))

    def head_turn(self, nod: np.ndarray) -> np.ndarray:
        """(T, 4) the head relative to the chest: it looks where the way leads, steadily, and nods by (T,) [rad]."""
        return rot.multiply(rot.from_yaw(self.look - self.chest), about_y(nod + self.nod - self.stoop))

    def arms(self, body: Body, amount: float) -> Arms:
        """Arms that swing against the legs, `amount` times as much as usual.

        That is 15 degrees from back to front at 0.65 m/s and 25 at 1.2 m/s, in recordings; elbows bend as they come
        forward.
        """
        late = round(DELAY * FPS)
        ahead = np.concatenate([np.repeat(self.ahead[:1], late), self.ahead])[: len(self.ahead)] / body.size
        upper, elbow = [], []
        for sign in (1.0, -1.0):
            swing = 0.24 * amount * sign * ahead
            upper.append(rot.multiply(about_y(0.02 + swing), about_x(np.full_like(swing, sign * 0.28))))
            elbow.append(about_y(-0.40 + 0.7 * swing))
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


@dataclass(frozen=True)
class Excerpt:
    """What is kept of a walk, so that it begins in the midst of the motion."""

    duration: float = 0.0
    """It has at least so many seconds, those that are left out not counted."""
    lead: float = 0.0
    """So many seconds at its beginning are left out."""


WHOLE = Excerpt()


def walk(
    body: Body,
    route: Route,
    start_yaw: float,
    stop_xy: np.ndarray,
    stop_yaw: float,
    gait: Gait,
    after: float,
    excerpt: Excerpt = WHOLE,
) -> Walk:
    """Walk along a route, turn and back up to the stop, and stand there at least `after` seconds after the last foot
    has landed.

    The beginning that `excerpt` leaves out is not there; a person stands for `gait.stand` seconds before the first
    foot lifts.

    The point between the ankles starts at the route's first point with heading `start_yaw` [rad] and ends at `stop_xy`
    (2,) [m] with heading `stop_yaw` [rad].
    """
    steps = plan_footsteps(start_yaw, route, stop_xy, stop_yaw, gait, body.size)
    skip = round(min(max(excerpt.lead, 0.0), max(0.0, steps.end - 0.1)) * FPS)
    way = follow(body, steps, gait, after, excerpt.duration + skip / FPS if skip else excerpt.duration)
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
    pelvis[:, :2] = balance(steps, time, gait, body, pelvis_start)
    walks = 1.0 - minimum_jerk((time - steps.end) / SETTLES)
    lean = _lean(pelvis, yaw, ahead / body.size)
    look, nod = gaze(steps, time, pelvis[:, :2], yaw, body.size)
    way = Walk(
        steps=steps,
        time=time,
        feet=feet,
        yaw=yaw,
        pelvis_pos_w=pelvis,
        ahead=ahead,
        twist=-0.08 * ahead / body.size,
        chest=0.18 * ahead / body.size,
        list=0.8 * _sideways(pelvis, feet, yaw) / body.size,
        look=look,
        nod=nod,
        bend=walks * (0.3 * lean - TILT),
        stoop=walks * (lean + STOOP),
    )
    hips = hips_of(body, way)
    pelvis[:, 2] = carried_height(body, hips, steps, time, gait)
    if feet_start is not None:  # whoever goes on from a state still moves the pelvis
        return way
    return replace(way, feet=land_softly(body, hips, pelvis[:, 2], feet, steps, time))


def hips_of(body: Body, way: Walk) -> Hips:
    """The hips of a walk, whatever the height of its pelvis."""
    upright = np.full(len(way.time), UPRIGHT)
    return Hips.of(body, way.pelvis_pos_w[:, :2], way.pelvis_quat(upright), way.feet, FPS)


def _sideways(pelvis: np.ndarray, feet: Feet, yaw: np.ndarray) -> np.ndarray:
    """How far the pelvis is to the left of the middle of the feet (T,) [m]."""
    offset = pelvis[:, :2] - feet.pos_w[..., :2].mean(1)
    return smooth(offset[:, 1] * np.cos(yaw) - offset[:, 0] * np.sin(yaw), round(0.2 * FPS))


def _lean(pelvis: np.ndarray, yaw: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    """Forward lean of the chest (T,) [rad]: with the speed, and most while both feet bear, twice a cycle."""
    velocity = np.gradient(pelvis[:, :2], 1 / FPS, axis=0)
    forward = smooth(velocity[:, 0] * np.cos(yaw) + velocity[:, 1] * np.sin(yaw), round(0.4 * FPS))
    return 0.06 * np.clip(forward, 0.0, 2.0) + 0.05 * ahead**2


def _begin_at(way: Walk, frame: int) -> Walk:
    """The same walk from a frame on; times count from there."""
    moment, feet, steps = frame / FPS, way.feet, way.steps
    cut = Feet(*(value[frame:] for value in vars(feet).values()))
    shifted = replace(steps, lift_off=steps.lift_off - moment, touch_down=steps.touch_down - moment)
    tracks = {name: value[frame:] for name, value in vars(way).items() if name not in ("steps", "time", "feet")}
    return replace(way, steps=shifted, time=way.time[: len(way.time) - frame], feet=cut, **tracks)
