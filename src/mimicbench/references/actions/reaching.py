"""How a person comes a few steps up to something and gets both hands to it: into postures, past the object, onto it
from outside.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.core.skeleton import forward_kinematics
from mimicbench.objects.shape import SceneObject
from mimicbench.references.actions.postures import (
    CRANE,
    EYES,
    NOD,
    STRETCH,
    Posture,
    chest_turn,
    depth,
    elbow_axes,
    in_own_way,
    spine_flexion,
)
from mimicbench.references.body.body import Body
from mimicbench.references.body.limbs import about_y
from mimicbench.references.body.liveliness import unrest
from mimicbench.references.body.posing import Arms, Legs, Trunk, blend, pose, reach, shoulders
from mimicbench.references.curves import minimum_jerk
from mimicbench.references.locomotion.gait import Footsteps, Gait
from mimicbench.references.locomotion.walking import Walk

Some = TypeVar("Some", Trunk, Legs, Arms)
SIZES = (0.86, 1.04)
"""Body sizes: statures of 1.55 to 1.88 m."""
STRIDES = Gait(speed=0.55, stand=0.5, width=0.185, first_step=0.65, last_step=0.7, stretch=0.05)
"""Short steps, feet as far apart as who bends and squats wants them."""
WRIST = 1.2
"""[rad] that a wrist bends, at most."""
AHEAD = 0.6
"""How much fingers of a forearm that stands on a surface turn to the front, instead of where it leans."""
STRAIN = np.array([0.012, 0.008, 0.012])
"""How far the chest of who bears a load tilts, nods and turns without a reason, and the head over it [rad]."""
HANGS = 0.3
"""How far the arms of who leans hang straight down, instead of going with the trunk."""
MOST_STRETCH = 0.985
"""On the way there, hands that are farther away than the arm is long stay behind smoothly, below this share of its
length."""
DETOURS = (
    (0.0, 0.0, 0.0),
    (0.12, 0.0, 0.0),
    (0.0, 0.0, 0.12),
    (0.0, 0.12, 0.0),
    (0.12, 0.0, 0.12),
    (0.12, 0.12, 0.0),
    (0.0, 0.0, 0.25),
    (0.2, 0.2, 0.0),
    (0.0, 0.22, 0.0),
    (0.08, 0.30, 0.10),
    (0.2, 0.0, 0.25),
)
"""Ways round the object for the hands: how far they bulge towards the person, outward and upward [m]; the first that is
free is taken."""


def steps_up_to(
    start_xy: np.ndarray, start_yaw: float, stop_xy: np.ndarray, stop_yaw: float, gait: Gait, scale: float
) -> Footsteps:
    """Steps straight to a stop near by, turning on the way, and one that closes the feet.

    The point between the ankles goes from (2,) to (2,) [m]; the first foot is the one on the side that the way leads
    to.
    """
    way = stop_xy - start_xy
    turn = float(rot.wrap_angle(stop_yaw - start_yaw))
    count = max(1, int(np.ceil(np.linalg.norm(way) / (gait.first_step * gait.speed * gait.period) - 0.1)))
    left = np.array([-np.sin(stop_yaw), np.cos(stop_yaw)])
    # the foot that arrives first is on the far side, so that legs do not cross
    arrives = 0 if way @ left >= 0 else 1
    sides = (arrives + np.arange(count, -1, -1) + 1) % 2
    shares = np.minimum(np.arange(1, count + 2) / count, 1.0)
    yaws = start_yaw + turn * shares
    signs, half = 1.0 - 2.0 * sides, 0.5 * gait.width * scale
    xy = start_xy + shares[:, None] * way + (half * signs)[:, None] * np.stack([-np.sin(yaws), np.cos(yaws)], -1)
    first = start_xy + half * np.array([[1.0], [-1.0]]) * np.array([-np.sin(start_yaw), np.cos(start_yaw)])
    touch_down = gait.stand + gait.period * (np.arange(count + 1) + 1.0 - gait.overlap)
    return Footsteps(first, start_yaw, sides, xy, yaws, touch_down - gait.swing_time, touch_down)


def draw_approach(random: np.random.Generator, stop_xy: np.ndarray, stop_yaw: float) -> tuple[np.ndarray, float]:
    """Where somebody comes from, 0.3 to 0.62 m behind or beside the place where they stop, and their heading: (2,)
    [m], [rad].
    """
    away = stop_yaw + np.pi + np.deg2rad(random.uniform(-25, 25))
    return stop_xy + random.uniform(0.3, 0.62) * np.array([np.cos(away), np.sin(away)]), stop_yaw + np.deg2rad(
        random.uniform(-22, 22)
    )


def settle(
    way: Walk, scale: float, postures: Sequence[tuple[Posture, np.ndarray]], look_w: np.ndarray, phase: float
) -> Trunk:
    """The trunk of a walk that goes on into postures, one after the other, each with its share (T,) from 0 to 1.

    `look_w` (T, 3) is what the person looks at [m] as far as the first posture's share says. Who stands breathes, and
    the weight wanders between and along the feet, with some phase [rad].
    """
    pos, breath = way.pelvis_pos_w, 0.012 * np.sin(2 * np.pi * way.time / 3.7 + phase)
    pitch, twist, bend = np.full(len(way.time), 0.03), np.zeros(len(way.time)), np.zeros(len(way.time))
    before = Posture(way.pelvis_pos_w[-1], *(np.array(value) for value in (0.03, 0.0, 0.0, 0.0, 0.0)))
    for posture, share in postures:
        pos = pos + share[:, None] * (posture.pelvis_pos_w - before.pelvis_pos_w)
        pitch, twist = pitch + share * (posture.pitch - before.pitch), twist + share * (posture.twist - before.twist)
        bend = bend + share * (posture.bend - before.bend)
        before = posture
    stands = postures[0][1][:, None]
    wander = scale * np.stack([_wander(way.time, phase), _wander(way.time, phase + 2.0)], -1) * [0.006, 0.009]
    aside = rot.rotate(rot.from_yaw(way.yaw), np.concatenate([wander, np.zeros_like(wander[:, :1])], -1))
    pos = pos + stands * aside
    pitch = pitch + 0.012 * stands[:, 0] * _wander(way.time, phase + 4.0)
    pelvis = rot.multiply(rot.from_yaw(0.3 * twist), way.pelvis_quat(pitch))
    chest = rot.multiply(rot.multiply(pelvis, way.chest_turn(breath)), chest_turn(pitch, twist, bend))
    # the eyes do the rest of the way; a target right below does not turn the head round
    x, y, z = rot.rotate_inverse(chest, look_w - pos - rot.rotate(chest, EYES * scale)).T
    away = np.maximum(x, 0.25)
    lean = pitch + spine_flexion(pitch, bend)
    turn = np.clip(0.8 * np.arctan2(y, away), -0.6, 0.6)
    nod = np.clip(0.5 * np.arctan2(-z, away) - CRANE * lean, -0.8, NOD)
    looking = rot.multiply(chest, rot.multiply(rot.from_yaw(turn), about_y(nod)))
    ahead = rot.multiply(chest, way.head_turn(np.full(len(pos), 0.1)))
    first = postures[0][1]
    return Trunk(pos, pelvis, chest, rot.slerp(ahead, looking, first))


def strained(trunk: Trunk, time: np.ndarray, phase: float, load: np.ndarray) -> Trunk:
    """The trunk of who bears some share (T,) of a load, at times (T,) [s]: the chest gives by STRAIN all the time, and
    the head with it. `phase` [rad] is that of `settle`.
    """
    gives = rot.from_rotvec(load[:, None] * unrest(1e5 * phase, time, STRAIN))
    chest = rot.multiply(trunk.chest_quat_w, gives)
    head = rot.multiply(chest, rot.multiply(rot.conjugate(trunk.chest_quat_w), trunk.head_quat_w))
    return replace(trunk, chest_quat_w=chest, head_quat_w=rot.multiply(head, gives))


def _wander(time: np.ndarray, phase: float) -> np.ndarray:
    """(T,) between -1 and 1, as the weight of who stands goes to and fro within some seconds."""
    return 0.6 * np.sin(2 * np.pi * 0.31 * time + phase) + 0.4 * np.sin(2 * np.pi * 0.53 * time + 2.3 * phase)


def hands_from_outside(
    swinging_w: np.ndarray, goal_w: np.ndarray, normals: np.ndarray, progress: np.ndarray, detour: np.ndarray
) -> np.ndarray:
    """(T, 2, 3) paths of the wrists from where they swing (T, 2, 3) to their goals (T, 2, 3) or (2, 3), where they
    arrive along the normals (2, 3).

    `detour` (2, 3) or (T, 2, 3) is how far the paths bulge in the middle [m], `progress` (T,) goes from 0 to 1.
    """
    towards, onto = minimum_jerk(progress / 0.85)[:, None, None], minimum_jerk((progress - 0.4) / 0.6)[:, None, None]
    before = 0.10 * normals
    bulge = (16 * towards**2 * (1 - towards) ** 2) * detour
    return goal_w + (1 - onto) * before + (1 - towards) * (swinging_w - goal_w - before) + bulge


@dataclass(frozen=True)
class Grasp:
    """Where both hands go, and how."""

    goal_w: np.ndarray
    """(2, 3) goals of the wrists [m]."""
    normals: np.ndarray
    """(2, 3) of the surface there, out of the object."""
    elbow: float
    """How far the elbows are swung out [rad]."""


def reach_past(
    body: Body,
    obj: SceneObject,
    trunk: Trunk,
    legs: Legs,
    swinging: Arms,
    grasp: Grasp,
    progress: np.ndarray,
    found: list[int],
) -> Arms:
    """Arms that go from swinging to their goals past an object at the origin, by the first of DETOURS that is free,
    or else the freest.

    `found` is that one's number, or empty: then it is looked for and put there. See `hands_from_outside` for the rest.
    """
    swinging = hanging(trunk, swinging)
    back = rot.rotate(rot.from_yaw(rot.yaw_of(trunk.chest_quat_w[-1])), np.array([-1.0, 0.0, 0.0]))
    left = np.array([-back[1], back[0], 0.0]) * -1.0
    hands, elbows = wrists_of(body, trunk, swinging), np.full(len(progress), grasp.elbow)
    leave = minimum_jerk(2.5 * progress)
    detours = np.array(DETOURS)
    detours = (
        detours[:, :1, None] * back
        + detours[:, 1:2, None] * np.stack([left, -left])
        + detours[:, 2:, None] * np.array([0.0, 0.0, 1.0])
    )

    def follow(detour: np.ndarray, some: np.ndarray | slice) -> tuple[Trunk, Arms]:
        """Trunk and arms in some of the frames."""
        part = frames(trunk, some)
        outside = hands_from_outside(hands[some], grasp.goal_w, grasp.normals, progress[some], detour)
        wrists = within_reach(body, part, outside)
        return part, blend(
            frames(swinging, some), reach(body, part, wrists, elbow_axes(part.chest_quat_w, elbows[some])), leave[some]
        )

    if found:
        return follow(detours[found[0]], slice(None))[1]
    # all detours at once, in every third frame
    tried = np.flatnonzero((progress > 0.05) & (progress < 1.0))[::3]
    every = np.tile(tried, len(detours))
    part, arms = follow(np.repeat(detours, len(tried), 0), every)
    pos, quat = forward_kinematics(body.skeleton, part.pelvis_pos_w, pose(body, part, frames(legs, every), arms))
    deep = depth(body, pos, quat, obj, np.zeros(3), ("hand", "lower_arm", "upper_arm"))
    deep = np.maximum(deep, in_own_way(body, pos, quat)).reshape(len(detours), -1).max(-1)
    found.append(
        int(np.argmax(deep < 0.0)) if (deep < 0.0).any() else int(np.argmin(deep + 0.003 * np.arange(len(deep))))
    )
    return follow(detours[found[0]], slice(None))[1]


def hanging(trunk: Trunk, swinging: Arms) -> Arms:
    """Arms that swing from the shoulders of an upright trunk as they hang from those of one that leans: rather down."""
    upright = rot.multiply(rot.conjugate(trunk.chest_quat_w), rot.from_yaw(rot.yaw_of(trunk.chest_quat_w)))
    return Arms(rot.multiply(rot.from_rotvec(HANGS * rot.to_rotvec(upright))[:, None], swinging.upper), swinging.elbow)


def lay_hands(body: Body, quat: np.ndarray, trunk: Trunk, normals: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Local rotations (T, J, 4) with wrists that bend with share (T,) until in the end the hands lie on surfaces
    with normals (2, 3).
    """
    quat = quat.copy()
    ahead = rot.rotate(rot.from_yaw(rot.yaw_of(trunk.pelvis_quat_w[-1])), np.array([1.0, 0.0, 0.0]))
    for side, arm in enumerate(body.arms):
        forearm = rot.multiply(rot.multiply(trunk.chest_quat_w[-1], quat[-1, arm.root]), quat[-1, arm.middle])
        along, normal = rot.rotate(forearm, np.array([0.0, 0.0, -1.0])), normals[side]
        into = max(-float(along @ normal), 0.0)
        # fingers turn out of the surface, and from a steep forearm to the front
        wanted = along + into * normal + AHEAD * into**2 * (ahead - (ahead @ normal) * normal)
        axis = rot.rotate_inverse(forearm, np.cross(along, wanted))
        sine = float(np.linalg.norm(axis))
        angle = min(np.arctan2(sine, float(along @ wanted)), WRIST) if into > 0.0 else 0.0
        quat[:, arm.end] = rot.from_rotvec(share[:, None] * angle * axis / max(sine, 1e-6))
    return quat


def within_reach(body: Body, trunk: Trunk, wrists_w: np.ndarray) -> np.ndarray:
    """Wrists (T, 2, 3) [m] that stay where they are up to STRETCH, and approach MOST_STRETCH beyond it, so that no
    elbow snaps straight.
    """
    roots, length = shoulders(body, trunk), sum(body.length(body.arms[0]))
    away = np.linalg.norm(wrists_w - roots, axis=-1, keepdims=True)
    room = (MOST_STRETCH - STRETCH) * length
    over = np.maximum(away - STRETCH * length, 0.0)
    return roots + (wrists_w - roots) * (np.minimum(away, STRETCH * length) + room * (1 - np.exp(-over / room))) / away


def cut(motion: HumanMotion, first: int, last: int) -> HumanMotion:
    """The frames of a clip from `first` to before `last`."""
    per_frame = ("root_pos_w", "local_quat", "contacts", "object_pos_w", "object_quat_w")
    return replace(motion, **{name: getattr(motion, name)[first:last] for name in per_frame})


def frames(of: Some, some: np.ndarray | slice) -> Some:
    """Some frames of trunk, legs or arms."""
    return replace(of, **{name: value[some] for name, value in vars(of).items() if value is not None})


def wrists_of(body: Body, trunk: Trunk, arms: Arms) -> np.ndarray:
    """(T, 2, 3) where arms hold the wrists [m]."""
    roots, upper = shoulders(body, trunk), rot.multiply(trunk.chest_quat_w[:, None], arms.upper)
    offsets = body.skeleton.offsets
    elbows = roots + rot.rotate(upper, offsets[[arm.middle for arm in body.arms]])
    return elbows + rot.rotate(rot.multiply(upper, arms.elbow), offsets[[arm.end for arm in body.arms]])
