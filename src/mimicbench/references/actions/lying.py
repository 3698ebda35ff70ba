"""Lying down, whatever on: sit on the free edge, turn along the bed while one leg after the other swings up, lower the
trunk, stretch, rest; and never be quite still.

Pelvis and chest stay nearly one piece, and the thighs go where the pelvis faces, so that a body with a stiff trunk and
narrow hips can do the same. Three turns make the pelvis's path: about the vertical from the free side to the foot end,
a lean in its own sagittal plane that balances the lifted legs, and a tilt of the spine towards the pillow.
"""

from collections.abc import Callable

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.core.seeds import rng
from mimicbench.core.skeleton import forward_kinematics
from mimicbench.objects.shape import SceneObject
from mimicbench.references.actions import on_side
from mimicbench.references.actions.berths import SINK, Berth, lifted_share
from mimicbench.references.actions.lying_limbs import lay_hands_down, move_arms, move_legs, rests_beside
from mimicbench.references.actions.lying_style import LYING_TIME, LieStyle, Lying, ease, needed_time
from mimicbench.references.body.body import Body
from mimicbench.references.body.hands import keep_off
from mimicbench.references.body.limbs import about_y
from mimicbench.references.body.liveliness import Rest, enliven, unrest
from mimicbench.references.body.posing import Trunk, pose
from mimicbench.references.curves import minimum_jerk
from mimicbench.references.locomotion.course import Course
from mimicbench.references.locomotion.gait import Gait, last_turn
from mimicbench.references.locomotion.route import Route
from mimicbench.references.locomotion.walking import FPS, Excerpt, Walk, walk

CONTACT_NAMES = ("left_foot", "right_foot", "pelvis", "back", "left_hand", "right_hand")
SETTLES = 1.6
"""Who lies down begins to breathe and look as who is at rest so long before [s]."""
GAZE = np.array([0.7, 0.7, 1.4])
"""How far the head of who lies tilts, nods and turns to look around, as shares of what who sits does."""
LOOKS = (0.25, 0.7)
"""How far the head turns to the pillow before the trunk goes down [rad]."""
WOBBLE = np.array([0.02, 0.02, 0.06])
"""How far the head tilts, nods and turns without a reason until somebody rests [rad]. The chest, which robots
have, too, does not: they follow it no better, and people are told from real ones as surely (docs/notes/lying.md)."""
RECLINED = np.pi / 2 - 0.05
"""How far a lying trunk is tilted: the chest rests a little higher than the pelvis [rad]."""


def lie_down(clip_id: str, course: Course, route: Route, start_yaw: float, style: LieStyle) -> HumanMotion:
    """The whole clip: walk along the route from heading `start_yaw` [rad], sit down on the berth's edge, lie down,
    rest.
    """
    excerpt, stop = Excerpt(style.duration, style.lead), (course.stop_xy, course.stop_yaw)
    return course.act(clip_id, walk(course.body, route, start_yaw, *stop, course.gait, course.after, excerpt))


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
    act = Lying(body, berth, way, style)
    clock, scoot = act.clock, ease(act.clock, 0.4 + 0.35 * style.stagger, 2.3 + 0.7 * style.stagger)
    trunk = _trunk(act, scoot)
    legs, still = move_legs(act, trunk, scoot)
    arms, hands = move_arms(act, trunk, legs)
    hands |= rests_beside(act)
    on_back = clock >= 4.2
    lain = legs
    if style.side > 0.5:
        below, turns = act.near, style.turns
        trunk, legs, arms = on_side.turn_over(act, trunk, legs, arms)
        on_back &= (clock < turns) & (turns > LYING_TIME - 1.0)
        still[:, below] &= (clock < turns - 0.3) | (clock >= act.ends)
        still[:, 1 - below] &= clock < turns - 0.3
        hands &= clock[:, None] < turns
    contacts = np.concatenate([still, np.stack([act.sitting >= 0.9, on_back], -1), hands], -1)
    arms = keep_off(body, trunk, legs, arms)
    quat = lay_hands_down(act, trunk, lain, pose(body, trunk, legs, arms))
    held = (0.0, 0.0) if style.side < 0.5 else (1.0, 1.0)
    rest = Rest(act.rest + SETTLES, held=held, trunk=0.0, gaze=GAZE)
    root, quat = enliven(body, trunk.pelvis_pos_w, quat, rest, style.habits)
    return HumanMotion(
        clip_id,
        task,
        body.skeleton,
        FPS,
        root,
        quat,
        obj.id,
        CONTACT_NAMES,
        contacts,
        {**{name: float(value) for name, value in vars(style).items()}, "turn": last_turn(way.steps)},
    )


def _trunk(act: Lying, scoot: np.ndarray) -> Trunk:
    body, berth, way, style = act.body, act.berth, act.way, act.style
    clock, sitting, slow = act.clock, act.sitting, 0.5 * act.style.stagger
    # the hips go back a little before they go down
    back, down = minimum_jerk(sitting / 0.95), minimum_jerk((sitting - 0.06) / 0.94)
    seat = np.array([*berth.seat_xy, berth.height + body.buttock - 0.01])
    lying = np.array([*berth.pelvis_xy, berth.height + body.back - SINK])
    pelvis_pos = (
        way.pelvis_pos_w
        + np.stack([back, back, down], -1) * (seat - way.pelvis_pos_w[-1])
        + scoot[:, None] * (lying - seat)
    )

    lean, upright = minimum_jerk(sitting / 0.7), minimum_jerk((sitting - 0.80) / 0.6)
    lifted = ease(clock, -0.7, 0.7) - ease(clock, 2.0 + slow, 4.0 + slow)
    balance = (0.48 + 1.75 * (0.66 - lifted_share(body, berth))) * lifted
    tilt = 0.33 * ease(clock, 0.3, 2.4) + (RECLINED - 0.33) * ease(clock, 1.9 + 0.5 * slow, 4.6)
    sideways = np.array([-berth.head[1], berth.head[0], 0.0])
    turn = rot.multiply(rot.from_rotvec(tilt[:, None] * sideways), rot.from_yaw(berth.turn * act.turn))
    pelvis = rot.multiply(turn, way.pelvis_quat(0.03 + (style.lean - 0.03) * lean - style.lean * upright - balance))

    curl = 0.16 * (ease(clock, 0.2, 1.4) - ease(clock, 3.4, 4.8))
    wobble = unrest(style.habits, way.time - way.end, WOBBLE)
    wobble *= 1 - minimum_jerk((act.rest + SETTLES) / 1.2)[:, None]
    chest = rot.multiply(pelvis, way.chest_turn(0.02 + 0.16 * lean - 0.17 * upright + curl))
    on_pillow = _nod_on_pillow(body, berth, pelvis_pos[-1], rot.normalize(pelvis[-1]), chest[-1])
    nod = (
        0.12 - 0.30 * lean + 0.20 * upright + 0.25 * ease(clock, 0.6, 2.2) + (on_pillow - 0.27) * ease(clock, 3.3, 4.9)
    )
    look = rng(abs(int(style.habits)), "pillow").uniform(*LOOKS) * (ease(clock, -1.0, 0.2) - ease(clock, 1.6, 3.2))
    turned = rot.multiply(rot.from_yaw(-np.sign(berth.turn) * look), way.head_turn(nod))
    head = rot.multiply(rot.from_rotvec(wobble), turned)
    return Trunk(pelvis_pos, pelvis, chest, rot.multiply(chest, head))


def _nod_on_pillow(body: Body, berth: Berth, pelvis_pos: np.ndarray, pelvis: np.ndarray, chest: np.ndarray) -> float:
    """How far the lying head must nod so that it rests on the pillow [rad]; the chest is straight above the pelvis."""
    ball = next(part for part in body.parts if part.role == "head")
    nods = np.array([-0.4, 0.5])
    quat = np.tile(rot.IDENTITY, (2, len(body.skeleton.joint_names), 1))
    quat[:, body.pelvis] = chest
    quat[:, list(body.neck)] = about_y(nods / len(body.neck))[:, None]
    pos, orientation = forward_kinematics(body.skeleton, np.tile(pelvis_pos, (2, 1)), quat)
    height = (pos[:, ball.joint] + rot.rotate(orientation[:, ball.joint], np.array(ball.start)))[:, 2]
    wanted = berth.height + berth.pillow + ball.radius - 0.008
    return float(np.clip(np.interp(wanted, height, nods), -0.4, 0.5))
