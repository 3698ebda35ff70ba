"""Lying down, whatever on: sit on the free edge, turn along the bed while the legs swing up, lower the trunk, stretch, rest.

Pelvis and chest stay nearly one piece, and the thighs go where the pelvis faces, so that a body with a stiff trunk and narrow
hips can do the same. Three turns make the pelvis's path: about the vertical from the free side to the foot end, a lean in its
own sagittal plane that balances the lifted legs, and a tilt of the spine towards the pillow.
"""

from dataclasses import dataclass

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion, forward_kinematics
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body import Body
from mimicbench.references.gait import Gait, Route, last_turn
from mimicbench.references.limbs import about_y, minimum_jerk, two_link
from mimicbench.references.posing import Arms, Legs, Trunk, blend, pose, reach, shoulders, thigh_orientations
from mimicbench.references.walking import FPS, Walk, walk

CONTACT_NAMES = ("left_foot", "right_foot", "pelvis", "back", "left_hand", "right_hand")
PAUSE = 0.35
"""Between the last step and the first bend [s]."""
RECLINED = np.pi / 2 - 0.05
"""How far a lying trunk is tilted: the chest rests a little higher than the pelvis [rad]."""
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
    hands: float
    """Where the hands rest: 0 beside the hips, 1 on the belly."""
    arm_swing: float
    """Swing of the arms while walking, as a share of the usual."""
    duration: float
    """Of the whole clip, if walking and lying down leave something of it for the rest [s]."""


@dataclass(frozen=True)
class Berth:
    """Where on an object a body lies, and where it sits down before; directions and places seen from above [m]."""

    height: float
    """H, of the surface."""
    pillow: float
    """Height of the pillow above it; 0 without one."""
    head: np.ndarray
    """(2,) unit vector from pelvis to pillow."""
    out: np.ndarray
    """(2,) unit vector across it, off the free edge."""
    pelvis_xy: np.ndarray
    """(2,) of who lies."""
    seat_xy: np.ndarray
    """(2,) of who sits on the edge."""
    stop_xy: np.ndarray
    """(2,) between the ankles of who is about to sit down."""
    room: float
    """From the lying pelvis to where the foot end stops the feet."""
    board: bool
    """Whether something stands up there, over which the legs cannot swing."""
    wide: bool
    """Whether there is room for an elbow on the side that is not free."""

    @property
    def turn(self) -> float:
        """From facing outwards to facing the foot end [rad]."""
        return -float(np.sign(self.out[0] * self.head[1] - self.out[1] * self.head[0])) * np.pi / 2


def perch(body: Body, height: float, gap: float) -> tuple[float, float]:
    """How deep behind a seat's edge the pelvis sits, and how far in front of it the ankles stand [m].

    As deep as thighs that slope down to feet on the floor do not press into the edge; on high beds with the feet farther out.

    Args:
        body: Who sits.
        height: Of the seat [m].
        gap: The ankles must be at least this far in front of the edge [m].
    """
    upper, lower = body.length(body.legs[0])
    hip = height + body.buttock - 0.01 - body.hip_drop
    depth, ahead = (grid.ravel() for grid in np.meshgrid(np.linspace(0.17, 0.05, 9), gap + np.array([0.0, 0.05, 0.10, 0.16]), indexing="ij"))
    across, down = depth + ahead, hip - body.sole
    length = np.hypot(across, down)
    bend = np.arccos(np.clip((upper**2 + length**2 - lower**2) / (2 * upper * length), -1, 1))
    thigh = np.arctan2(across, down) + bend  # from straight down, forwards
    along = np.linspace(0.15, 0.85, 8)[:, None] * upper
    x, z = along * np.sin(thigh) - depth, hip - along * np.cos(thigh) - height
    clear = np.where((x < 0) & (z < 0), np.maximum(x, z), np.hypot(np.maximum(x, 0), np.maximum(z, 0))).min(0)
    pressed = np.maximum(0.055 * body.size - clear, 0.02) + 10 * np.maximum(length - 0.97 * (upper + lower), 0.0)
    best = int(np.argmin(pressed.round(4)))  # the first of equals: the deepest seat, the nearest feet
    return float(depth[best]), float(ahead[best])


def draw_style(random: np.random.Generator, body_scale: float, duration: float, pace: tuple[float, float]) -> LieStyle:
    """The free choices of a clip, given the body's size, the clip's duration [s] and the range of its pace; who is quicker walks faster, too."""
    quick = pace[1] < 0.9
    return LieStyle(
        body_scale=body_scale, speed=random.uniform(0.62, 0.70) if quick else random.uniform(0.57, 0.63),
        sit_duration=random.uniform(1.15, 1.3) if quick else random.uniform(1.6, 1.9), pace=random.uniform(*pace),
        lean=random.uniform(0.52, 0.62), stagger=random.uniform(0.06, 0.18), stretch=random.uniform(0.89, 0.985),
        knee=float(random.choice([0, 0, 0, 1, -1])), hands=float(random.integers(2)), arm_swing=random.uniform(0.7, 1.2), duration=duration,
    )  # fmt: skip


def needed_time(style: LieStyle) -> float:
    """From the last step to rest [s]."""
    return PAUSE + style.sit_duration + style.pace * LYING_TIME + 0.3


def lie_down(
    clip_id: str, task: str, obj: SceneObject, body: Body, berth: Berth, route: Route, start_yaw: float, gait: Gait, style: LieStyle
) -> HumanMotion:  # fmt: skip
    """The whole clip: walk along the route from heading `start_yaw` [rad], sit down on the berth's edge, lie down, rest."""
    way = walk(body, route, start_yaw, berth.stop_xy, float(np.arctan2(berth.out[1], berth.out[0])), gait, needed_time(style), style.duration)
    sitting = (way.time - way.end - PAUSE) / style.sit_duration
    clock = (way.time - way.end - PAUSE - style.sit_duration) / style.pace
    trunk = _trunk(body, berth, way, sitting, clock, style)
    legs, still = _legs(body, berth, way, trunk, clock, style)
    arms, hands = _arms(body, berth, way, trunk, legs, sitting, clock, style)
    contacts = np.concatenate([still, np.stack([sitting >= 0.9, clock >= 4.2], -1), hands], -1)
    return HumanMotion(
        clip_id, task, body.skeleton, FPS, trunk.pelvis_pos_w, pose(body, trunk, legs, arms), obj.id, CONTACT_NAMES, contacts,
        {**{name: float(value) for name, value in vars(style).items()}, "turn": last_turn(way.steps)},
    )  # fmt: skip


def _ease(clock: np.ndarray, start: float, end: float) -> np.ndarray:
    """From 0 at `start` to 1 at `end` of the clock (T,), at rest at both."""
    return minimum_jerk((clock - start) / (end - start))


def _scoot(clock: np.ndarray) -> np.ndarray:
    return _ease(clock, 0.5, 2.4)


def _trunk(body: Body, berth: Berth, way: Walk, sitting: np.ndarray, clock: np.ndarray, style: LieStyle) -> Trunk:
    # the hips go back a little before they go down
    back, down = minimum_jerk(sitting / 0.95), minimum_jerk((sitting - 0.06) / 0.94)
    seat = np.array([*berth.seat_xy, berth.height + body.buttock - 0.01])
    lying = np.array([*berth.pelvis_xy, berth.height + body.back - 0.004])
    pelvis_pos = way.pelvis_pos_w + np.stack([back, back, down], -1) * (seat - way.pelvis_pos_w[-1]) + _scoot(clock)[:, None] * (lying - seat)

    lean, upright = minimum_jerk(sitting / 0.7), minimum_jerk((sitting - 0.80) / 0.6)
    balance = (0.48 + 1.75 * (0.66 - _aloft(body, berth))) * (_ease(clock, 0.0, 1.3) - _ease(clock, 2.0, 4.0))
    tilt = 0.42 * _ease(clock, 0.3, 2.3) + (RECLINED - 0.42) * _ease(clock, 1.9, 4.4)
    sideways = np.array([-berth.head[1], berth.head[0], 0.0])
    turn = rot.multiply(rot.from_rotvec(tilt[:, None] * sideways), rot.from_yaw(berth.turn * _ease(clock, 0.45, 2.3)))
    pelvis = rot.multiply(turn, way.pelvis_quat(0.03 + (style.lean - 0.03) * lean - style.lean * upright - balance))

    rest = _ease(clock, 4.6, 6.0)
    curl = 0.16 * (_ease(clock, 0.2, 1.4) - _ease(clock, 3.4, 4.8))
    breath = 0.010 * rest * np.sin(2 * np.pi * 0.23 * way.time)
    chest = rot.multiply(pelvis, way.chest_turn(0.02 + 0.10 * lean - 0.11 * upright + curl + breath))
    on_pillow = _nod_on_pillow(body, berth, pelvis_pos[-1], rot.normalize(pelvis[-1]), chest[-1])
    nod = 0.12 - 0.30 * lean + 0.20 * upright + 0.25 * (_ease(clock, 0.6, 2.2)) + (on_pillow - 0.27) * _ease(clock, 3.3, 4.9)
    look = 0.10 * rest * (np.sin(2 * np.pi * 0.061 * way.time) + 0.5 * np.sin(2 * np.pi * 0.113 * way.time))
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


def _legs(body: Body, berth: Berth, way: Walk, trunk: Trunk, clock: np.ndarray, style: LieStyle) -> tuple[Legs, np.ndarray]:
    """The legs, and (T, 2) where each foot stands or lies still."""
    walking = way.legs()
    full, left = sum(body.length(body.legs[0])), np.array([-berth.out[1], berth.out[0]])
    base = berth.seat_xy + _scoot(clock)[:, None] * (berth.pelvis_xy - berth.seat_xy)
    # from above: distance and side of the ankle as seen from a pelvis that faces it, and its height
    half = body.hip_half_width
    final, final_pitch = _resting_foot(body, berth, style.stretch)
    knees_up, landed_pitch = _resting_foot(body, berth, min(0.62, style.stretch))
    aloft = _aloft(body, berth)
    lifted = np.array([aloft * full, half + 0.03, berth.height + body.sole + (0.10 + 0.40 * (0.66 - aloft)) * body.size])
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
        standing = walking.ankle_pos_w[-1, side]
        first = np.array([(standing[:2] - berth.seat_xy) @ berth.out, sign * ((standing[:2] - berth.seat_xy) @ left), standing[2]])
        r, across, z = (first + lift[:, None] * (lifted - first) + land[:, None] * (knees_up - lifted) + stretch[:, None] * (final - knees_up)).T
        yaw = berth.turn * _ease(clock, 0.45 + late, 2.3 + late)
        forward = np.stack([r, sign * across, np.zeros_like(r)], -1)
        swung = np.concatenate([base, z[:, None]], -1) + rot.rotate(rot.from_yaw(yaw + np.arctan2(berth.out[1], berth.out[0])), forward)
        off = lift > 0
        place = np.where(off[:, None], swung, walking.ankle_pos_w[:, side])
        hip = trunk.pelvis_pos_w + rot.rotate(trunk.pelvis_quat_w, body.skeleton.offsets[body.legs[side].root])
        shin = two_link(hip, place, axis, *body.length(body.legs[side]), True)[1]
        hanging = rot.multiply(shin, about_y(0.15 * _ease(clock, 0.6, 1.8)))
        pitch = landed_pitch + stretch * (final_pitch - landed_pitch)
        laid = rot.multiply(rot.from_yaw(yaw + np.arctan2(berth.out[1], berth.out[0])), about_y(-pitch))
        ankle.append(place)
        foot.append(rot.slerp(rot.slerp(walking.foot_quat_w[:, side], hanging, _ease(clock, 0.1 + late, 1.2 + late)), laid, land))
        still.append(np.where(off, (stretch >= 1) | ((land >= 1) & (stretch <= 0)), way.feet.contact[:, side]))
    share = _ease(clock, -0.6, 0.4)[:, None, None]
    knee_axis = walking.knee_axis_w * (1 - share) + share * axis[:, None]
    return Legs(np.stack(ankle, 1), np.stack(foot, 1), knee_axis, walking.toe_bend), np.stack(still, -1)


def _aloft(body: Body, berth: Berth) -> float:
    """Distance of the lifted ankles from the pelvis, as a share of the legs' length: less where the feet would sweep over an end that stands up."""
    return min(0.66, max((berth.room - 0.95 * body.toe - 0.04) / sum(body.length(body.legs[0])), 0.49)) if berth.board else 0.66


def _resting_foot(body: Body, berth: Berth, stretch: float) -> tuple[np.ndarray, float]:
    """Distance from the pelvis, side and height of the resting ankle [m], and how far the toes point up [rad].

    From hip to ankle it is `stretch` of the leg's length, as far as there is room; otherwise the knees stay up.
    """
    upper, lower = body.length(body.legs[0])
    hip = berth.height + body.back - 0.004 + float(body.skeleton.offsets[body.legs[0].root, 0])
    room = berth.room - body.hip_drop - 0.03
    distance, pitch = min(stretch * (upper + lower), room - body.sole), 0.9
    sole, corner = np.hypot(body.toe, body.sole), np.arctan2(body.sole, body.toe)
    for _ in range(12):
        # the ankle's height depends on the foot's pitch, and this on the leg's bend
        ankle = berth.height + _ankle_height(body, pitch)
        length = min(np.hypot(distance, hip - ankle), 0.985 * (upper + lower))
        shin = np.pi / 2 - np.arctan2(hip - ankle, distance) - np.arccos((lower**2 + length**2 - upper**2) / (2 * lower * length))
        fits = corner + np.arccos(np.clip((room - distance) / sole, -1.0, 1.0))
        pitch = float(np.clip(max(shin - 0.30, fits), 0.0, max(shin, 0.0) + 0.40))
        if fits > pitch + 0.01:  # the toes cannot be drawn in so far: the knees are
            distance = max(distance - 0.025, 0.68 * upper)
    return np.array([distance + body.hip_drop, body.hip_half_width + 0.025, berth.height + _ankle_height(body, pitch)]), pitch


def _ankle_height(body: Body, pitch: float) -> float:
    """Of the ankle over what the heel lies on, toes up by `pitch` [rad]: of the rounded foot, which sinks in a little."""
    radius = 0.6 * body.sole
    return float(-(body.heel + radius) * np.sin(pitch) + (body.sole - radius) * np.cos(pitch)) + radius + 0.010 * np.sin(pitch) - 0.004


def _arms(body: Body, berth: Berth, way: Walk, trunk: Trunk, legs: Legs, sitting: np.ndarray, clock: np.ndarray, style: LieStyle) -> tuple[Arms, np.ndarray]:
    """Arms that come forward to sit, support the trunk while it goes down, and rest; and (T, 2) where the hands bear."""
    forward, rest = minimum_jerk(sitting / 0.65), np.stack([_ease(clock, 3.7, 5.4)] * 2, -1)
    swinging = way.arms(body, style.arm_swing)
    moving = Arms(rot.multiply(about_y(-1.0 * forward)[:, None], swinging.upper), rot.multiply(swinging.elbow, about_y(-0.25 * forward)[:, None]))
    out, head = np.array([*berth.out, 0.0]), np.array([*berth.head, 0.0])
    near = 0 if berth.turn < 0 else 1  # the hand at the pillow's side of who sits, at the edge's side of who lies
    size, quat = body.size, trunk.chest_quat_w[:, None]
    lying = np.array([*berth.pelvis_xy, berth.height + 0.05])
    edge = float((berth.seat_xy - berth.pelvis_xy) @ berth.out)
    behind, beside = np.empty((2, 3)), np.empty((2, 3))
    behind[near], behind[1 - near] = lying + min(edge, 0.30 * size) * out + 0.19 * size * head, lying - 0.27 * size * out + 0.20 * size * head
    beside[near], beside[1 - near] = lying + 0.30 * size * out + 0.02 * size * head, lying - 0.30 * size * out + 0.02 * size * head
    # the hands slide down beside the hips while the trunk goes down
    planted = _within_reach(body, trunk, behind + _ease(clock, 2.4, 4.4)[:, None, None] * (beside - behind))
    # the elbows point backward under a raised trunk, and outward beside a lying one
    lowered = _ease(clock, 1.6, 4.0)[:, None, None]
    outward = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    support = reach(body, trunk, planted, rot.rotate(quat, (1 - lowered) * (0.35 * outward + [0.0, 1.0, 0.0]) + lowered * (outward + [0.0, 0.1, 0.0])))
    # on the thighs after sitting down, until the hands go to the mattress
    thigh = thigh_orientations(body, trunk, legs)
    hips = trunk.pelvis_pos_w[:, None] + rot.rotate(trunk.pelvis_quat_w[:, None], body.skeleton.offsets[[leg.root for leg in body.legs]])
    on_thigh = hips + rot.rotate(thigh, np.array([[0.10, 0.03, -0.25], [0.10, -0.03, -0.25]]) * size)
    seated = reach(body, trunk, _within_reach(body, trunk, on_thigh), rot.rotate(quat, np.array([[0.30, 1.0, 0.0], [-0.30, 1.0, 0.0]])))
    if style.hands > 0.5:
        spot = np.array([[0.135, 0.09, 0.0], [0.135, -0.09, 0.0]]) * size
        place = trunk.pelvis_pos_w[:, None] + rot.rotate(trunk.pelvis_quat_w[:, None], spot + np.array([0.0, 0.0, 0.12 * size]))
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
    return blend(blend(arms, support, start), resting, rest), bearing


def _within_reach(body: Body, trunk: Trunk, wrist_pos_w: np.ndarray) -> np.ndarray:
    """Wrists (T, 2, 3) [m] pulled smoothly towards the shoulders where the arms would have to be straight: elbows do not snap."""
    roots, most, soft = shoulders(body, trunk), 0.95 * sum(body.length(body.arms[0])), 0.02 * body.size
    delta = wrist_pos_w - roots
    length = np.linalg.norm(delta, axis=-1, keepdims=True)
    return roots + delta / length * (most - soft * np.logaddexp(0.0, (most - length) / soft))
