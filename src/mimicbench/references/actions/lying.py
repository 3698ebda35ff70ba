"""Lying down, whatever on: sit on the free edge, turn along the bed while the legs swing up, lower the trunk,
stretch, rest.

Pelvis and chest stay nearly one piece, and the thighs go where the pelvis faces, so that a body with a stiff trunk and
narrow
hips can do the same. Three turns make the pelvis's path: about the vertical from the free side to the foot end, a lean
in its
own sagittal plane that balances the lifted legs, and a tilt of the spine towards the pillow.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.curves import minimum_jerk
from mimicbench.core.motion import HumanMotion, forward_kinematics
from mimicbench.objects.shape import SceneObject
from mimicbench.references.actions import on_side
from mimicbench.references.actions.berths import SINK, Berth, lifted_share, resting_foot
from mimicbench.references.body.body import Body
from mimicbench.references.body.hands import keep_off, lay_on_body, point_hands
from mimicbench.references.body.limbs import about_y, two_link
from mimicbench.references.body.posing import Arms, Legs, Trunk, blend, pose, reach, shoulders, thigh_orientations
from mimicbench.references.locomotion.course import Course
from mimicbench.references.locomotion.gait import Gait, Route, last_turn
from mimicbench.references.locomotion.walking import FPS, Walk, walk

CONTACT_NAMES = ("left_foot", "right_foot", "pelvis", "back", "left_hand", "right_hand")
PAUSE = 0.35
"""Between the last step and the first bend [s]."""
RECLINED = np.pi / 2 - 0.05
"""How far a lying trunk is tilted: the chest rests a little higher than the pelvis [rad]."""
BREATH = 0.016
"""How far the chest of who lies rises and falls [rad]."""
LOOK = 0.26
"""How far the head turns at rest [rad]."""
LOWER = 0.07
"""The second leg swings up so much less high [m], at body size 1."""
LYING_TIME = 5.6
"""From the seat to rest at pace 1 [s]."""


@dataclass(frozen=True)
class LieStyle:
    """What a clip chooses beyond its start and its object; stored with it."""

    body_scale: float
    """Size of the body; 1 is 1.6 m tall."""
    speed: float
    """Walking speed [m/s]."""
    sit_duration: float
    """From the first bend to the seat [s]."""
    pace: float
    """How slowly the person lies down; 1 takes LYING_TIME from the seat to rest."""
    lean: float
    """How far pelvis and trunk pitch forward on the way down [rad]."""
    stagger: float
    """The second leg follows the first one after this time, at pace 1 [s]."""
    stretch: float
    """How far the legs are stretched in the end, as a share of their length, where there is room."""
    knee: float
    """Which knee stays up in the end: 1 the left one, -1 the right one, 0 neither."""
    side: float
    """1 for who turns onto the side in the end, towards the free edge; 0 for who stays on the back."""
    hands: float
    """Where the hands rest: 0 beside the hips, 1 on the belly."""
    arm_swing: float
    """Swing of the arms while walking, as a share of the usual."""
    duration: float
    """Of the whole clip, if walking and lying down leave something of it for the rest [s]."""
    lead: float = 0.0
    """How much of the walk is left out, so that the clip begins in motion [s]."""
    hands_up: float = 0.12
    """How far above the hips hands rest that are on the belly, at body size 1 [m]."""
    hands_uneven: float = 0.0
    """How much farther up the left one is, at body size 1 [m]."""
    apart: float = 0.0
    """How much farther apart than the hips the feet rest where there is room, each, at body size 1 [m]."""


def draw_style(random: np.random.Generator, body_scale: float, duration: float, pace: tuple[float, float]) -> LieStyle:
    """The free choices of a clip, given the body's size, the clip's duration [s] and the range of its pace.

    Who is quicker walks faster, too.
    """
    quick = pace[1] < 0.9
    return LieStyle(
        body_scale=body_scale,
        speed=random.uniform(0.70, 0.82),
        sit_duration=random.uniform(2.2, 2.5) if quick else random.uniform(2.8, 3.3),
        pace=random.uniform(*pace),
        lean=random.uniform(0.52, 0.62),
        stagger=random.uniform(0.28, 0.40),
        stretch=random.uniform(0.66, 0.985),
        knee=float(random.choice([0, 0, 1, -1])),
        side=0.0,
        hands=float(random.integers(2)),
        arm_swing=random.uniform(0.7, 1.2),
        duration=duration,
        lead=random.uniform(0.3, 1.5) if quick else 0.0,
        hands_up=random.uniform(0.05, 0.18),
        hands_uneven=random.uniform(-0.12, 0.12),
        apart=random.uniform(0.0, 0.07),
    )


def needed_time(style: LieStyle) -> float:
    """From the last step to rest [s]."""
    return PAUSE + style.sit_duration + style.pace * (on_side.END if style.side > 0.5 else LYING_TIME) + 0.3


def lie_down(
    clip_id: str,
    task: str,
    obj: SceneObject,
    body: Body,
    berth: Berth,
    route: Route,
    start_yaw: float,
    gait: Gait,
    style: LieStyle,
) -> HumanMotion:
    """The whole clip: walk along the route from heading `start_yaw` [rad], sit down on the berth's edge, lie down,
    rest.
    """
    course = lie_course(task, obj, body, berth, lambda _: route, gait, style)
    way = walk(body, route, start_yaw, course.stop_xy, course.stop_yaw, gait, course.after, style.duration, style.lead)
    return course.act(clip_id, way)


def lie_course(
    task: str,
    obj: SceneObject,
    body: Body,
    berth: Berth,
    route: Callable[[np.ndarray], Route],
    gait: Gait,
    style: LieStyle,
) -> Course:
    """Where to stand before a berth, and how to lie down from there; `route` is the way there from a place (2,) [m]."""

    def act(clip_id: str, way: Walk) -> HumanMotion:
        return _lie(clip_id, task, obj, body, berth, style, way)

    return Course(
        body, gait, berth.stop_xy, float(np.arctan2(berth.out[1], berth.out[0])), route, needed_time(style), act
    )


def _lie(
    clip_id: str, task: str, obj: SceneObject, body: Body, berth: Berth, style: LieStyle, way: Walk
) -> HumanMotion:
    """The clip that follows from a walk to before the berth."""
    sitting = (way.time - way.end - PAUSE) / style.sit_duration
    clock = (way.time - way.end - PAUSE - style.sit_duration) / style.pace
    trunk = _trunk(body, berth, way, sitting, clock, style)
    legs, still = _legs(body, berth, way, trunk, clock, style)
    arms, hands = _arms(body, berth, way, trunk, legs, sitting, clock, style)
    on_back = clock >= 4.2
    if style.side > 0.5:
        below = 0 if berth.turn < 0 else 1
        trunk, legs, arms = on_side.turn_over(body, berth.height, berth.out, below, clock, trunk, legs, arms)
        on_back &= clock < on_side.BEGIN
        still[:, below] &= (clock < on_side.BEGIN - 0.3) | (clock >= on_side.END)
        still[:, 1 - below] &= clock < on_side.BEGIN - 0.3
        hands &= clock[:, None] < on_side.BEGIN
    contacts = np.concatenate([still, np.stack([sitting >= 0.9, on_back], -1), hands], -1)
    arms = keep_off(body, trunk, legs, arms)
    quat = _hands(body, berth, trunk, pose(body, trunk, legs, arms), clock, style)
    return HumanMotion(
        clip_id,
        task,
        body.skeleton,
        FPS,
        trunk.pelvis_pos_w,
        quat,
        obj.id,
        CONTACT_NAMES,
        contacts,
        {**{name: float(value) for name, value in vars(style).items()}, "turn": last_turn(way.steps)},
    )


def _hands(body: Body, berth: Berth, trunk: Trunk, quat: np.ndarray, clock: np.ndarray, style: LieStyle) -> np.ndarray:
    """Local rotations (T, J, 4) with hands that lie flat: on the thighs, on the belly, and in the end on the bed in
    front of who lies on the side.
    """
    quat = lay_on_body(body, trunk, quat)
    if style.hands > 0.5:
        # over the belly, and a little down to the sides
        across = rot.rotate(trunk.pelvis_quat_w[:, None], np.array([[-0.25, -0.75, -0.6], [-0.25, 0.75, -0.6]]))
        flat = point_hands(
            body, trunk, quat, across / np.linalg.norm(across, axis=-1, keepdims=True), np.ones((len(clock), 2))
        )
        quat = _blended(body, quat, flat, _ease(clock, 4.0, 5.2))
    if style.side > 0.5:
        front, head = np.array([*berth.out, 0.0]), np.array([*berth.head, 0.0])
        flat = point_hands(body, trunk, quat, 0.8 * front + 0.6 * head, np.ones((len(clock), 2)))
        quat = _blended(body, quat, flat, _ease(clock, on_side.BEGIN + 0.8, on_side.END))
    return quat


def _blended(body: Body, quat: np.ndarray, other: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Local rotations (T, J, 4) with hands that turn to those of other ones with share (T,)."""
    quat, ends = quat.copy(), [arm.end for arm in body.arms]
    quat[:, ends] = rot.slerp(quat[:, ends], other[:, ends], share[:, None])
    return quat


def _ease(clock: np.ndarray, start: float, end: float) -> np.ndarray:
    """From 0 at `start` to 1 at `end` of the clock (T,), at rest at both."""
    return minimum_jerk((clock - start) / (end - start))


def _scoot(clock: np.ndarray) -> np.ndarray:
    return _ease(clock, 0.5, 2.4)


def _trunk(body: Body, berth: Berth, way: Walk, sitting: np.ndarray, clock: np.ndarray, style: LieStyle) -> Trunk:
    # the hips go back a little before they go down
    back, down = minimum_jerk(sitting / 0.95), minimum_jerk((sitting - 0.06) / 0.94)
    seat = np.array([*berth.seat_xy, berth.height + body.buttock - 0.01])
    lying = np.array([*berth.pelvis_xy, berth.height + body.back - SINK])
    pelvis_pos = (
        way.pelvis_pos_w
        + np.stack([back, back, down], -1) * (seat - way.pelvis_pos_w[-1])
        + _scoot(clock)[:, None] * (lying - seat)
    )

    lean, upright = minimum_jerk(sitting / 0.7), minimum_jerk((sitting - 0.80) / 0.6)
    balance = (0.48 + 1.75 * (0.66 - lifted_share(body, berth))) * (_ease(clock, 0.0, 1.3) - _ease(clock, 2.0, 4.0))
    tilt = 0.42 * _ease(clock, 0.3, 2.3) + (RECLINED - 0.42) * _ease(clock, 1.9, 4.4)
    sideways = np.array([-berth.head[1], berth.head[0], 0.0])
    turn = rot.multiply(rot.from_rotvec(tilt[:, None] * sideways), rot.from_yaw(berth.turn * _ease(clock, 0.45, 2.3)))
    pelvis = rot.multiply(turn, way.pelvis_quat(0.03 + (style.lean - 0.03) * lean - style.lean * upright - balance))

    rest = _ease(clock, 4.6, 6.0)
    curl = 0.16 * (_ease(clock, 0.2, 1.4) - _ease(clock, 3.4, 4.8))
    breath = BREATH * rest * np.sin(2 * np.pi * 0.23 * way.time)
    chest = rot.multiply(pelvis, way.chest_turn(0.02 + 0.10 * lean - 0.11 * upright + curl + breath))
    on_pillow = _nod_on_pillow(body, berth, pelvis_pos[-1], rot.normalize(pelvis[-1]), chest[-1])
    nod = (
        0.12
        - 0.30 * lean
        + 0.20 * upright
        + 0.25 * (_ease(clock, 0.6, 2.2))
        + (on_pillow - 0.27) * _ease(clock, 3.3, 4.9)
    )
    # a look around, first to the free side
    since = style.pace * (clock - (on_side.END if style.side > 0.5 else 4.6))
    look = (
        -np.sign(berth.turn)
        * LOOK
        * (
            minimum_jerk((since - 0.3) / 1.6)
            - 1.8 * minimum_jerk((since - 3.2) / 2.2)
            + 0.8 * minimum_jerk((since - 7.0) / 1.8)
        )
    )
    head = rot.multiply(chest, rot.multiply(way.head_turn(nod), rot.from_yaw(look)))
    return Trunk(pelvis_pos, pelvis, chest, head)


def _nod_on_pillow(body: Body, berth: Berth, pelvis_pos: np.ndarray, pelvis: np.ndarray, chest: np.ndarray) -> float:
    """How far the lying head must nod so that it rests on the pillow [rad]; the chest is straight above the pelvis."""
    ball = next(part for part in body.parts if part.role == "head")
    nods = np.array([-0.4, 0.5])
    quat = np.tile(rot.IDENTITY, (2, len(body.skeleton.joint_names), 1))
    quat[:, body.pelvis] = chest
    quat[:, list(body.neck)] = about_y(nods / len(body.neck))[:, None]
    pos, orientation = forward_kinematics(body.skeleton, np.tile(pelvis_pos, (2, 1)), quat)
    height = (pos[:, ball.joint] + rot.rotate(orientation[:, ball.joint], np.array(ball.start)))[:, 2]
    wanted = berth.height + berth.pillow + ball.radius - 0.018
    return float(np.clip(np.interp(wanted, height, nods), -0.4, 0.5))


def _legs(
    body: Body, berth: Berth, way: Walk, trunk: Trunk, clock: np.ndarray, style: LieStyle
) -> tuple[Legs, np.ndarray]:
    """The legs, and (T, 2) where each foot stands or lies still."""
    walking = way.legs()
    full, left = sum(body.length(body.legs[0])), np.array([-berth.out[1], berth.out[0]])
    base = berth.seat_xy + _scoot(clock)[:, None] * (berth.pelvis_xy - berth.seat_xy)
    # from above: distance and side of the ankle as seen from a pelvis that faces it, and its height
    half = body.hip_half_width
    final, final_pitch = resting_foot(body, berth, style.stretch)
    final = final + [0.0, style.apart * body.size * berth.wide, 0.0]
    knees_up, landed_pitch = resting_foot(body, berth, min(0.62, style.stretch))
    aloft = lifted_share(body, berth)
    lifted = np.array(
        [aloft * full, half + 0.03, berth.height + body.sole + (0.10 + 0.40 * (0.66 - aloft)) * body.size]
    )
    ankle, foot, still = [], [], []
    axis = rot.rotate(trunk.pelvis_quat_w, np.array([0.0, 1.0, 0.0]))
    for side, sign in enumerate((1.0, -1.0)):
        # the foot that is nearer to the foot end goes first
        late = 0.0 if sign * berth.turn > 0 else style.stagger
        lift, land, stretch = (
            _ease(clock, 0.05 + late, 1.35 + late),
            _ease(clock, 1.75 + late, 2.8 + late),
            _ease(clock, 3.4 + late, 5.1 + late) * (style.knee != sign),
        )
        # and the second one, for which the pelvis already leans back, less high
        high = lifted - [0.0, 0.0, LOWER * body.size * (late > 0)]
        standing = walking.ankle_pos_w[-1, side]
        first = np.array(
            [(standing[:2] - berth.seat_xy) @ berth.out, sign * ((standing[:2] - berth.seat_xy) @ left), standing[2]]
        )
        r, across, z = (
            first
            + lift[:, None] * (high - first)
            + land[:, None] * (knees_up - high)
            + stretch[:, None] * (final - knees_up)
        ).T
        yaw = berth.turn * _ease(clock, 0.45 + late, 2.3 + late)
        forward = np.stack([r, sign * across, np.zeros_like(r)], -1)
        swung = np.concatenate([base, z[:, None]], -1) + rot.rotate(
            rot.from_yaw(yaw + np.arctan2(berth.out[1], berth.out[0])), forward
        )
        off = lift > 0
        place = np.where(off[:, None], swung, walking.ankle_pos_w[:, side])
        hip = trunk.pelvis_pos_w + rot.rotate(trunk.pelvis_quat_w, body.skeleton.offsets[body.legs[side].root])
        shin = two_link(hip, place, axis, *body.length(body.legs[side]), True)[1]
        hanging = rot.multiply(shin, about_y(0.15 * _ease(clock, 0.6, 1.8)))
        pitch = landed_pitch + stretch * (final_pitch - landed_pitch)
        laid = rot.multiply(rot.from_yaw(yaw + np.arctan2(berth.out[1], berth.out[0])), about_y(-pitch))
        ankle.append(place)
        foot.append(
            rot.slerp(
                rot.slerp(walking.foot_quat_w[:, side], hanging, _ease(clock, 0.1 + late, 1.2 + late)), laid, land
            )
        )
        still.append(np.where(off, (stretch >= 1) | ((land >= 1) & (stretch <= 0)), way.feet.contact[:, side]))
    share = _ease(clock, -0.6, 0.4)[:, None, None]
    knee_axis = walking.knee_axis_w * (1 - share) + share * axis[:, None]
    return Legs(np.stack(ankle, 1), np.stack(foot, 1), knee_axis, walking.toe_bend), np.stack(still, -1)


def _arms(
    body: Body,
    berth: Berth,
    way: Walk,
    trunk: Trunk,
    legs: Legs,
    sitting: np.ndarray,
    clock: np.ndarray,
    style: LieStyle,
) -> tuple[Arms, np.ndarray]:
    """Arms that come forward to sit, support the trunk while it goes down, and rest.

    And (T, 2) where the hands bear.
    """
    forward, rest = minimum_jerk(sitting / 0.65), np.stack([_ease(clock, 3.7, 5.4)] * 2, -1)
    swinging = way.arms(body, style.arm_swing)
    moving = Arms(
        rot.multiply(about_y(-1.0 * forward)[:, None], swinging.upper),
        rot.multiply(swinging.elbow, about_y(-0.25 * forward)[:, None]),
    )
    out, head = np.array([*berth.out, 0.0]), np.array([*berth.head, 0.0])
    near = 0 if berth.turn < 0 else 1  # the hand at the pillow's side of who sits, at the edge's side of who lies
    size, quat = body.size, trunk.chest_quat_w[:, None]
    lying = np.array([*berth.pelvis_xy, berth.height + 0.05])
    edge = float((berth.seat_xy - berth.pelvis_xy) @ berth.out)
    behind, beside = np.empty((2, 3)), np.empty((2, 3))
    behind[near], behind[1 - near] = (
        lying + min(edge, 0.30 * size) * out + 0.19 * size * head,
        lying - 0.27 * size * out + 0.20 * size * head,
    )
    beside[near], beside[1 - near] = (
        lying + 0.30 * size * out + 0.02 * size * head,
        lying - 0.30 * size * out + 0.02 * size * head,
    )
    # the hands slide down beside the hips while the trunk goes down
    goal = behind + _ease(clock, 2.4, 4.4)[:, None, None] * (beside - behind)
    planted = _within_reach(body, trunk, goal)
    # the elbows point backward under a raised trunk, and outward beside a lying one
    lowered = _ease(clock, 1.6, 4.0)[:, None, None]
    outward = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    support = reach(
        body,
        trunk,
        planted,
        rot.rotate(quat, (1 - lowered) * (0.35 * outward + [0.0, 1.0, 0.0]) + lowered * (outward + [0.0, 0.1, 0.0])),
    )
    # on the thighs after sitting down, until the hands go to the mattress
    thigh = thigh_orientations(body, trunk, legs)
    hips = trunk.pelvis_pos_w[:, None] + rot.rotate(
        trunk.pelvis_quat_w[:, None], body.skeleton.offsets[[leg.root for leg in body.legs]]
    )
    on_thigh = hips + rot.rotate(thigh, np.array([[0.10, 0.03, -0.25], [0.10, -0.03, -0.25]]) * size)
    seated = reach(
        body,
        trunk,
        _within_reach(body, trunk, on_thigh),
        rot.rotate(quat, np.array([[0.30, 1.0, 0.0], [-0.30, 1.0, 0.0]])),
    )
    if style.hands > 0.5:
        left, right = style.hands_up + 0.5 * style.hands_uneven, style.hands_up - 0.5 * style.hands_uneven
        spot = np.array([[0.135, 0.09, left], [0.135, -0.09, right]]) * size
        place = trunk.pelvis_pos_w[:, None] + rot.rotate(trunk.pelvis_quat_w[:, None], spot)
        resting = reach(body, trunk, place, rot.rotate(quat, np.array([[0.8, 0.7, 0.5], [-0.8, 0.7, -0.5]])))
    else:
        resting = support
    start, bearing = np.zeros((len(clock), 2)), np.zeros((len(clock), 2), bool)
    for side in range(2):
        begin = 0.0 if side == near else 1.0
        if side == near or berth.wide:
            start[:, side] = _ease(clock, begin - 0.3, begin + 1.0)
            bearing[:, side] = ((clock >= begin + 1.0) & (clock < 2.4)) | ((clock >= 4.4) & (style.hands <= 0.5))
        else:
            rest[:, side] = _ease(clock, 1.8, 4.0)
    arms = blend(moving, seated, minimum_jerk((sitting - 0.65) / 0.55))
    bearing &= np.linalg.norm(planted - goal, axis=-1) < 0.01
    return blend(blend(arms, support, start), resting, rest), bearing


def _within_reach(body: Body, trunk: Trunk, wrist_pos_w: np.ndarray) -> np.ndarray:
    """Wrists (T, 2, 3) [m] pulled smoothly towards the shoulders where the arms would have to be straight: elbows do
    not snap.
    """
    roots, most, soft = shoulders(body, trunk), 0.95 * sum(body.length(body.arms[0])), 0.02 * body.size
    delta = wrist_pos_w - roots
    length = np.linalg.norm(delta, axis=-1, keepdims=True)
    return roots + delta / length * (most - soft * np.logaddexp(0.0, (most - length) / soft))
