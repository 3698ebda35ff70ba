"""`sit-chair`: start anywhere around a chair, walk to its front, turn the back to it, sit down, stay."""

from dataclasses import dataclass

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion, Skeleton
from mimicbench.core.seeds import rng
from mimicbench.objects.shape import SceneObject
from mimicbench.references import skeletons as human
from mimicbench.references.gait import Feet, Gait, around_box, balance, body_yaw, last_turn, plan_footsteps, stride_difference, swing_feet
from mimicbench.references.limbs import about_x, about_y, minimum_jerk, smooth, smooth_below, two_link

FPS = 30.0
REACH = 0.985
"""Share of its full length to which a leg may be stretched."""


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


def draw_start(random: np.random.Generator, obj: SceneObject) -> tuple[np.ndarray, float]:
    """A place (2,) [m] 1 to 2 m from the origin, within 100 degrees of the front and 0.45 m clear of the chair, and any heading [rad]."""
    low, high = obj.bounds()
    azimuth = np.deg2rad(random.uniform(-100, 100))
    ray = np.array([np.cos(azimuth), np.sin(azimuth)])
    edge = np.where(ray > 0, high[:2], low[:2]) + 0.45 * np.sign(ray)
    nearest = max(1.0, float(np.min(edge / np.where(np.abs(ray) < 1e-9, 1e-9, ray))))
    distance = random.uniform(nearest, max(2.0, nearest + 0.5))
    return distance * ray, float(random.uniform(-np.pi, np.pi))


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
    scale, skeleton = style.body_scale, human.UNIHSI.scaled(style.body_scale)
    gait = Gait(speed=style.speed)
    stop, seat = stopping_place(obj, style)
    low, high = obj.bounds()
    margin = 0.40
    before = np.array([max(stop[0] + 0.25, high[0] + margin), stop[1]])
    steps = plan_footsteps(start_yaw, around_box(start_xy, before, low[:2], high[:2], margin), stop, 0.0, gait, scale)

    sit_start = steps.end + 0.35
    time = np.arange(int((sit_start + style.sit_duration + 1.5) * FPS) + 1) / FPS
    feet = swing_feet(steps, time, gait, scale, human.SOLE * scale, human.TOE * scale, human.HEEL * scale)
    yaw = body_yaw(feet, FPS)
    ahead = stride_difference(feet, yaw, FPS)
    progress = (time - sit_start) / style.sit_duration

    root = np.empty((len(time), 3))
    root[:, :2] = balance(steps, time, gait, scale, 0.9 * scale)
    root[:, 2] = _standing_height(skeleton, root[:, :2], yaw, feet)
    # the hips go back a little before they go down
    back, down = minimum_jerk(progress / 0.95), minimum_jerk((progress - 0.06) / 0.94)
    goal = np.array([*seat, obj.require_seat() + human.BUTTOCK * scale - 0.01])
    root += np.stack([back, back, down], -1) * (goal - root[-1])

    rise, fall = minimum_jerk(progress / 0.7), minimum_jerk((progress - 0.86) / 0.75)
    pitch = 0.03 + (style.lean - 0.03) * rise - (style.lean + style.recline) * fall
    sway = _sideways(root, feet, yaw)
    twist = -0.15 * ahead / scale
    pelvis = rot.multiply(rot.from_yaw(yaw + twist), rot.multiply(about_y(pitch), about_x(0.25 * sway / scale)))
    quat = _pose(skeleton, root, pelvis, yaw, feet, ahead, twist, sway, progress, style)
    contacts = np.concatenate([feet.contact, (progress >= 0.9)[:, None]], -1)
    return HumanMotion(
        clip_id, "sit-chair", skeleton, FPS, root, quat, obj.id, ("left_foot", "right_foot", "pelvis"), contacts,
        {**{name: float(value) for name, value in vars(style).items()}, "turn": last_turn(steps)},
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


def _standing_height(skeleton: Skeleton, root_xy: np.ndarray, yaw: np.ndarray, feet: Feet) -> np.ndarray:
    """The highest smooth pelvis path (T,) [m] from which both legs reach their feet: lower in double support, as people walk."""
    leg = REACH * float(np.abs(skeleton.offsets[[13, 14], 2]).sum())
    limits = np.full(len(yaw), leg + feet.pos_w[0, 0, 2])
    for side, sign in ((0, 1.0), (1, -1.0)):
        hip = root_xy + sign * skeleton.offsets[12, 1] * np.stack([-np.sin(yaw), np.cos(yaw)], -1)
        away = ((hip - feet.pos_w[:, side, :2]) ** 2).sum(-1)
        limits = np.minimum(limits, feet.pos_w[:, side, 2] + np.sqrt(np.maximum(leg**2 - away, 0.25 * leg**2)))
    return smooth_below(limits, round(0.2 * FPS)) - 0.006


def _sideways(root: np.ndarray, feet: Feet, yaw: np.ndarray) -> np.ndarray:
    """How far the pelvis is to the left of the middle of the feet (T,) [m]."""
    offset = root[:, :2] - feet.pos_w[..., :2].mean(1)
    return smooth(offset[:, 1] * np.cos(yaw) - offset[:, 0] * np.sin(yaw), round(0.2 * FPS))


def _pose(
    skeleton: Skeleton, root: np.ndarray, pelvis: np.ndarray, yaw: np.ndarray, feet: Feet, ahead: np.ndarray, twist: np.ndarray,
    sway: np.ndarray, progress: np.ndarray, style: SitStyle,
) -> np.ndarray:  # fmt: skip
    """Local rotations (T, 15, 4) of all joints."""
    scale, offsets = style.body_scale, skeleton.offsets
    quat = np.tile(rot.IDENTITY, (len(root), 15, 1))
    quat[:, 0] = pelvis
    lean, upright = minimum_jerk(progress / 0.7), minimum_jerk((progress - 0.86) / 0.75)
    # the chest counters the pelvis: it neither twists nor lists with the steps
    spine = 0.02 + 0.10 * lean - 0.07 * upright
    quat[:, 1] = rot.multiply(rot.from_yaw(-1.6 * twist), rot.multiply(about_y(spine), about_x(-0.25 * sway / scale)))
    coming = np.concatenate([yaw[int(0.5 * FPS) :], np.repeat(yaw[-1:], int(0.5 * FPS))])
    look = smooth(np.clip(coming - yaw, -0.6, 0.6), round(0.2 * FPS))
    quat[:, 2] = rot.multiply(rot.from_yaw(look), about_y(0.12 - 0.30 * lean + 0.22 * upright))

    for side, thigh in ((0, 12), (1, 9)):
        heading = rot.from_yaw(feet.yaw[:, side])
        foot = rot.multiply(heading, about_y(feet.pitch[:, side]))
        hip = root + rot.rotate(pelvis, offsets[thigh])
        upper, lower, _ = two_link(
            hip, feet.pos_w[:, side], rot.rotate(heading, np.array([0.0, 1.0, 0.0])), -offsets[thigh + 1, 2], -offsets[thigh + 2, 2], True
        )
        for joint, (child, parent) in enumerate(((upper, pelvis), (lower, upper), (foot, lower))):
            quat[:, thigh + joint] = rot.multiply(rot.conjugate(parent), child)

    forward, rest = minimum_jerk(progress / 0.65), minimum_jerk((progress - 0.70) / 0.85)
    for sign, arm, thigh in ((1.0, 6, 12), (-1.0, 3, 9)):
        # arms swing against the legs, come forward on the way down, and end with the hands on the thighs
        swing = style.arm_swing * sign * ahead / scale
        shoulder = rot.multiply(about_y(0.04 + 0.75 * swing - 1.15 * forward), about_x(np.full_like(swing, sign * 0.13)))
        elbow = about_y(-0.30 - 0.25 * np.maximum(0.0, 0.2 - swing) - 0.25 * forward)
        seated = _hand_on_thigh(skeleton, quat[-1], sign, arm, thigh, scale)
        quat[:, arm] = rot.slerp(shoulder, seated[0], rest)
        quat[:, arm + 1] = rot.slerp(elbow, seated[1], rest)
    return quat


def _hand_on_thigh(skeleton: Skeleton, seated: np.ndarray, sign: float, arm: int, thigh: int, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Local rotations (4,) of upper and lower arm that lay the wrist on the thigh, given all local rotations (15, 4) of the seated body."""
    offsets = skeleton.offsets
    on_thigh = offsets[thigh] + rot.rotate(seated[thigh], np.array([0.09, sign * 0.03, -0.29]) * scale)
    chest = seated[1]
    out = rot.rotate(chest, np.array([sign * 0.30, 1.0, 0.0]))
    shoulder = offsets[1] + rot.rotate(chest, offsets[arm])
    upper, lower, _ = two_link(shoulder, on_thigh, out, -offsets[arm + 1, 2], -offsets[arm + 2, 2], False)
    return rot.multiply(rot.conjugate(chest), upper), rot.multiply(rot.conjugate(upper), lower)
