"""`sit-chair`: start anywhere around a chair, walk to its front, turn the back to it, sit down, stay."""

from dataclasses import dataclass

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.core.seeds import rng
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body import Body, unihsi_body
from mimicbench.references.gait import Gait, around_box, last_turn
from mimicbench.references.limbs import about_y, minimum_jerk
from mimicbench.references.posing import Arms, Legs, Trunk, blend, pose, reach, thigh_orientations
from mimicbench.references.walking import FPS, Walk, draw_start, walk


@dataclass(frozen=True)
class SitStyle:
    """What a clip chooses beyond its start and its chair; stored with it."""

    body_scale: float
    """Size of the body; 1 is 1.62 m tall."""
    speed: float
    """Walking speed [m/s]."""
    sit_duration: float
    """From the first bend to the seat [s]."""
    lean: float
    """How far pelvis and trunk pitch forward on the way down [rad]."""
    recline: float
    """How far they lean back in the end [rad]."""
    seat_x: float
    """Offset of the seated pelvis [m], forward."""
    seat_y: float
    """Offset of the seated pelvis and of the feet [m], to the left."""
    arm_swing: float
    """Swing of the arms, as a share of the usual."""


def draw_style(random: np.random.Generator, seat_height: float) -> SitStyle:
    """The few free choices of a clip. The shortest people stay away from the highest seats [m], where their feet would hang."""
    shortest = max(1.03, min(1.10, 2.1 * seat_height))
    return SitStyle(
        body_scale=random.uniform(shortest, 1.13), speed=random.uniform(0.57, 0.63), sit_duration=random.uniform(1.6, 1.9), lean=random.uniform(0.56, 0.66),
        recline=random.uniform(0.0, 0.12), seat_x=random.uniform(-0.02, 0.02), seat_y=random.uniform(-0.02, 0.02), arm_swing=random.uniform(0.7, 1.2),
    )  # fmt: skip


def synthesize_sit_chair(clip_id: str, obj: SceneObject, seed: int) -> HumanMotion:
    """One clip. Raises BadObject if there is no seat."""
    seat_height = obj.require_seat()
    random = rng(seed, clip_id, obj.id)
    start_xy, start_yaw = draw_start(random, obj)
    return make_sit_chair(clip_id, obj, start_xy, start_yaw, draw_style(random, seat_height))


def make_sit_chair(clip_id: str, obj: SceneObject, start_xy: np.ndarray, start_yaw: float, style: SitStyle) -> HumanMotion:
    """The clip that follows from a start, a chair and a style, in closed form.

    The point between the ankles starts at `start_xy` (2,) [m] with heading `start_yaw` [rad].
    """
    body = unihsi_body(style.body_scale)
    stop, seat = stopping_place(obj, style)
    low, high = obj.bounds()
    margin = 0.40
    before = np.array([max(stop[0] + 0.25, high[0] + margin), stop[1]])
    route = around_box(start_xy, before, low[:2], high[:2], margin)
    way = walk(body, route, start_yaw, stop, 0.0, Gait(speed=style.speed), 0.35 + style.sit_duration + 1.5)
    progress = (way.time - way.end - 0.35) / style.sit_duration

    # the hips go back a little before they go down
    back, down = minimum_jerk(progress / 0.95), minimum_jerk((progress - 0.06) / 0.94)
    goal = np.array([*seat, obj.require_seat() + body.buttock - 0.01])
    pelvis_pos = way.pelvis_pos_w + np.stack([back, back, down], -1) * (goal - way.pelvis_pos_w[-1])
    lean, upright = minimum_jerk(progress / 0.7), minimum_jerk((progress - 0.86) / 0.75)
    pelvis = way.pelvis_quat(0.03 + (style.lean - 0.03) * lean - (style.lean + style.recline) * upright)
    chest = rot.multiply(pelvis, way.chest_turn(0.02 + 0.10 * lean - 0.07 * upright))
    head = rot.multiply(chest, way.head_turn(0.12 - 0.30 * lean + 0.22 * upright))
    trunk, legs = Trunk(pelvis_pos, pelvis, chest, head), way.legs()
    quat = pose(body, trunk, legs, _arms(body, way, trunk, legs, progress, style))
    contacts = np.concatenate([way.feet.contact, (progress >= 0.9)[:, None]], -1)
    return HumanMotion(
        clip_id, "sit-chair", body.skeleton, FPS, pelvis_pos, quat, obj.id, ("left_foot", "right_foot", "pelvis"), contacts,
        {**{name: float(value) for name, value in vars(style).items()}, "turn": last_turn(way.steps)},
    )  # fmt: skip


def stopping_place(obj: SceneObject, style: SitStyle) -> tuple[np.ndarray, np.ndarray]:
    """Where the ankles end up and where the pelvis sits, both (2,) [m].

    The feet are drawn in until the heels are near the seat's front edge, or just in front of what stands below it.
    """
    front = float(obj.seat_polygon[:, 0].max())
    low, high = obj.corners().min(1), obj.corners().max(1)
    in_the_way = (low[:, 2] < 0.30) & (low[:, 1] < 0.20) & (high[:, 1] > -0.20)
    below = float(high[in_the_way, 0].max()) if in_the_way.any() else -np.inf
    ankle = max(front + 0.06, below + 0.125)
    depth = np.clip(0.155 - 0.5 * (ankle - front - 0.06), 0.12, 0.5 * np.ptp(obj.seat_polygon[:, 0]))
    y = float(obj.seat_polygon[:, 1].min() + obj.seat_polygon[:, 1].max()) / 2 + style.seat_y
    return np.array([ankle, y]), np.array([front - depth + style.seat_x, y])


def _arms(body: Body, way: Walk, trunk: Trunk, legs: Legs, progress: np.ndarray, style: SitStyle) -> Arms:
    """Arms that swing while walking, come forward on the way down, and end with the hands on the thighs."""
    forward, rest = minimum_jerk(progress / 0.65), minimum_jerk((progress - 0.70) / 0.85)
    swinging = way.arms(body, style.arm_swing)
    moving = Arms(rot.multiply(about_y(-1.15 * forward)[:, None], swinging.upper), rot.multiply(swinging.elbow, about_y(-0.25 * forward)[:, None]))
    # the pose at the end is where the hands go to
    last = slice(-1, None)
    end = Trunk(*(values[last] for values in vars(trunk).values()))
    thigh = thigh_orientations(body, end, Legs(legs.ankle_pos_w[last], legs.foot_quat_w[last], legs.knee_axis_w[last]))
    out = rot.rotate(end.chest_quat_w[:, None], np.array([[0.30, 1.0, 0.0], [-0.30, 1.0, 0.0]]))
    hips = end.pelvis_pos_w[:, None] + rot.rotate(end.pelvis_quat_w[:, None], body.skeleton.offsets[[leg.root for leg in body.legs]])
    on_thigh = hips + rot.rotate(thigh, np.array([[0.09, 0.03, -0.29], [0.09, -0.03, -0.29]]) * body.size)
    return blend(moving, reach(body, end, on_thigh, out), rest)
