"""The gate: hand-made clips with one thing wrong, on all three skeletons, and distances against brute force."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.objects.families.box import make_box
from mimicbench.objects.families.chair import make_chair
from mimicbench.objects.families.sofa import make_sofa
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body.angles import joint_angles
from mimicbench.references.body.body import Body, body_of, core4d_body, roam_body, unihsi_body
from mimicbench.references.body.limbs import about_x, about_y
from mimicbench.references.checks.penetration import depths, soft_boxes
from mimicbench.references.checks.quality import check_clip, faults, gate, stance_slides, told
from mimicbench.tasks.sit_chair import TASK as SIT_CHAIR
from mimicbench.tasks.task import Task

BODIES = (unihsi_body(1.05), roam_body(1.1), core4d_body(0.95))
FAR = make_chair(0, 0)


def standing(body: Body, at: tuple[float, float] = (3.0, 0.0), frames: int = 40) -> HumanMotion:
    """Somebody who stands still, on both feet."""
    root = np.tile([*at, body.standing_height], (frames, 1))
    quat = np.tile(rot.IDENTITY, (frames, len(body.skeleton.joint_names), 1))
    return HumanMotion(
        "stand",
        "sit-chair",
        body.skeleton,
        30.0,
        root,
        quat,
        FAR.id,
        ("left_foot", "right_foot"),
        np.ones((frames, 2), bool),
    )


def turned(motion: HumanMotion, joint: int, turn: np.ndarray) -> HumanMotion:
    """With one joint turned, all the time."""
    quat = motion.local_quat.copy()
    quat[:, joint] = turn
    return replace(motion, local_quat=quat)


@pytest.mark.parametrize("body", BODIES, ids=lambda body: body.skeleton.name)
def test_standing_still_is_good(body: Body):
    measures = check_clip(standing(body), FAR)
    assert faults(measures) == []
    assert (
        measures["floor_depth"] == pytest.approx(0, abs=1e-9)
        and measures["skate"] == 0
        and measures["object_depth"] == 0
    )


@pytest.mark.parametrize("body", BODIES, ids=lambda body: body.skeleton.name)
def test_what_no_joint_can_do_is_named(body: Body):
    still = standing(body)
    left, right = body.legs
    for joint, turn, name in (
        (left.middle, about_y(np.array(2.8)), "knee_flexion_most"),
        (left.middle, about_y(np.array(-0.2)), "knee_flexion_least"),
        (right.root, about_y(np.array(-2.5)), "hip_flexion_most"),
        (left.root, about_x(np.array(1.2)), "hip_abduction_most"),
        (right.root, about_x(np.array(-1.2)), "hip_abduction_most"),
        (left.root, rot.from_yaw(np.array(-1.2)), "hip_rotation_most"),
        (right.root, rot.from_yaw(np.array(1.2)), "hip_rotation_most"),
        (left.end, about_y(np.array(-0.9)), "ankle_plantarflexion_least"),
        (body.arms[0].middle, about_y(np.array(0.3)), "elbow_flexion_least"),
        (body.arms[1].root, about_y(np.array(1.3)), "shoulder_extension_most"),
        (body.chest, about_y(np.array(1.7)), "spine_flexion_most"),
        (body.head, rot.from_yaw(np.array(1.6)), "neck_rotation_most"),
    ):
        assert name in faults(check_clip(turned(still, joint, turn), FAR)), name


def test_angles_are_those_that_were_set():
    body = roam_body()
    quat = np.tile(rot.IDENTITY, (1, 27, 1))
    for leg, out in zip(body.legs, (1.0, -1.0), strict=True):
        quat[:, leg.root] = rot.multiply(about_x(np.array(0.3 * out)), about_y(np.array(-0.5)))
        quat[:, leg.middle] = about_y(np.array(0.7))
        quat[:, leg.end] = about_y(np.array(0.2))
    for joint in body.spine:
        quat[:, joint] = about_y(np.array(0.1))
    angles = joint_angles(body, quat)
    assert angles["knee_flexion"] == pytest.approx(np.full((1, 2), 0.7)) and angles[
        "ankle_plantarflexion"
    ] == pytest.approx(np.full((1, 2), 0.2))
    assert angles["spine_flexion"] == pytest.approx(np.array([0.4]))
    # the thigh points forward by 0.5 in its own plane, which leans out by 0.3
    assert angles["hip_abduction"] == pytest.approx(np.full((1, 2), np.arcsin(np.cos(0.5) * np.sin(0.3))))
    assert angles["hip_flexion"] == pytest.approx(np.full((1, 2), np.arctan2(np.sin(0.5), np.cos(0.5) * np.cos(0.3))))


@settings(max_examples=50, deadline=None)
@given(st.floats(0.05, 0.6), st.integers(3, 20), st.booleans())
def test_a_rolling_foot_does_not_slide_and_a_sliding_one_does(angle: float, frames: int, over_toe: bool):
    pivot, other = (
        (np.array([0.15, 0, 0]), np.array([-0.2, 0, 0])) if over_toe else (np.array([0.0, 0, 0]), np.array([0.2, 0, 0]))
    )
    pitch = np.linspace(0, angle, frames) * (1 if over_toe else -1)
    rolling = np.stack([np.broadcast_to(pivot, (frames, 3)), pivot + rot.rotate(about_y(pitch), other)], 1)
    stands = np.ones(frames, bool)
    assert stance_slides(rolling, stands) == pytest.approx([0.0], abs=1e-12)
    sliding = rolling + np.linspace(0, 0.03, frames)[:, None, None] * np.array([0.0, 1.0, 0.0])
    assert stance_slides(sliding, stands) == pytest.approx([0.03])
    stands[frames // 2] = False
    assert len(stance_slides(sliding, stands)) == (frames // 2 > 1) + (frames - frames // 2 - 1 > 1)


def test_floating_and_sunk_feet_are_named():
    still = standing(BODIES[1])
    assert "float_height" in faults(check_clip(replace(still, root_pos_w=still.root_pos_w + [0, 0, 0.04]), FAR))
    assert faults(check_clip(replace(still, root_pos_w=still.root_pos_w - [0, 0, 0.01]), FAR)) == ["floor_depth"]


def test_jumps_are_named():
    body = BODIES[2]
    still = standing(body)
    root = still.root_pos_w.copy()
    root[20:, 1] += 0.06
    found = faults(check_clip(replace(still, root_pos_w=root, contacts=np.zeros((40, 2), bool)), FAR))
    assert {"jump", "root_acceleration", "root_jerk"} <= set(found)
    box = make_box(0, 0)
    track = np.zeros((40, 3))
    track[20:, 2] = 0.03
    carried = replace(still, object_pos_w=track, object_quat_w=np.tile(rot.IDENTITY, (40, 1)))
    assert faults(check_clip(carried, box)) == ["object_jump"]


def test_faults_are_told_with_their_bounds():
    measures = {"skate": 0.25, "knee_flexion_most": 3.0, "knee_flexion_least": -0.5}
    assert told(measures, ["skate", "knee_flexion_most", "knee_flexion_least", "K"]) == (
        "skate 0.25 (0.01 at most), knee_flexion_most 3 (2.6 at most), knee_flexion_least -0.5 (-0.02 at least), K"
    )


def test_wrists_have_to_stay_at_their_targets():
    body = BODIES[2]
    still = standing(body, frames=60)
    wrists = still.forward_kinematics()[0][0, [arm.end for arm in body.arms]]
    assert check_clip(replace(still, wrist_goal_w=wrists), FAR)["reach"] == pytest.approx(0, abs=1e-12)
    assert faults(check_clip(replace(still, wrist_goal_w=wrists + [0.06, 0, 0]), FAR)) == ["reach"]
    one = replace(still, wrist_goal_w=np.array([wrists[0] + [0.03, 0, 0], [np.nan] * 3]))
    assert check_clip(one, FAR)["reach"] == pytest.approx(0.03)  # the other hand may be anywhere
    moving = replace(
        still,
        root_pos_w=still.root_pos_w + np.linspace(0, 2, 60)[:, None] * [0, 1.0, 0],
        contacts=np.zeros((60, 2), bool),
    )
    assert "reach" in faults(check_clip(replace(moving, wrist_goal_w=wrists), FAR))  # passes by, does not stay


def brute_force(obj: SceneObject, motion: HumanMotion, body: Body) -> float:
    """Depth of spheres along every part, one by one, in the object's frame."""
    pos, quat = motion.forward_kinematics()
    worst = 0.0
    for t in range(motion.frames):
        for part in body.parts:
            for share in np.linspace(0, 1, 7):
                place = pos[t, part.joint] + rot.rotate(
                    quat[t, part.joint], np.array(part.start) + share * (np.array(part.end) - part.start)
                )
                if len(motion.object_pos_w):
                    place = rot.rotate_inverse(motion.object_quat_w[t], place - motion.object_pos_w[t])
                for center, turn, half in zip(obj.box_pos, obj.box_quat, obj.box_half, strict=True):
                    beyond = np.abs(rot.rotate_inverse(turn, place - center)) - half
                    worst = max(worst, part.radius - np.linalg.norm(np.maximum(beyond, 0)) - min(beyond.max(), 0))
    return worst


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2), st.floats(-0.8, 0.8), st.floats(-0.8, 0.8), st.floats(-3, 3), st.booleans())
def test_depth_is_that_of_brute_force(which: int, x: float, y: float, yaw: float, moves: bool):
    body, obj = BODIES[which], make_chair(3, 0)
    motion = turned(standing(body, (x, y), 2), 0, rot.from_yaw(np.array(yaw)))
    if moves:
        track = np.array([[0.1, 0.2, 0.05], [0.0, 0.3, 0.1]])
        motion = replace(motion, object_pos_w=track, object_quat_w=rot.from_yaw(np.array([0.4, yaw])))
    found = depths(motion, obj, body, *motion.forward_kinematics())
    assert (
        found.hard == pytest.approx(brute_force(obj, motion, body), abs=1e-9)
        and found.soft == 0
        and found.moving == moves
    )


def test_upholstery_gives_more_than_wood():
    body, sofa = BODIES[1], make_sofa(1, 0)
    soft = soft_boxes(sofa)
    assert soft.any() and not soft_boxes(make_chair(1, 0)).any()
    assert sofa.corners()[soft].max((0, 1))[2] == sofa.bounds()[1][2]
    sunk = standing(body, (0.0, 0.0), 2)
    root = sunk.root_pos_w.copy()
    root[:, 2] = sofa.require_seat() + body.buttock - 0.03
    folded = turned(
        turned(replace(sunk, root_pos_w=root), body.legs[0].root, about_y(np.array(-1.5))),
        body.legs[1].root,
        about_y(np.array(-1.5)),
    )
    found = depths(folded, sofa, body, *folded.forward_kinematics())
    assert 0.02 < found.seat <= found.soft


def test_convex_pieces_are_judged_by_themselves():
    corners = np.array([[0, 0, 0], [1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]])
    obj = SceneObject(
        "mine-0",
        "household",
        "own",
        np.full((1, 3), 0.5),
        np.array([rot.IDENTITY]),
        np.full((1, 3), 0.5),
        np.ones((1, 3)),
        hulls=(corners,),
    )
    body = unihsi_body()
    motion = standing(body, (0.75, 0.75), 2)  # in the box around the piece, outside of the piece
    found = depths(motion, obj, body, *motion.forward_kinematics())
    assert found.hard == 0 and depths(motion, replace(obj, hulls=()), body, *motion.forward_kinematics()).hard > 0.05


def test_k_is_part_of_the_gate():
    still = standing(BODIES[0])
    assert gate(still, FAR) == [] and gate(still, FAR, SIT_CHAIR.fulfilled_by_human) == ["K"]


@pytest.mark.parametrize("body", BODIES, ids=lambda body: body.skeleton.name)
def test_k_reads_pelvis_ankles_and_wrists(body: Body):
    seen = []

    def holds(points, facts):
        seen.append(points)
        return np.ones(len(points.pelvis_pos_w), bool)

    task: Task = replace(SIT_CHAIR, holds=holds)
    motion = standing(body)
    assert task.fulfilled_by_human(motion, FAR) and not task.fulfilled_by_human(replace(motion, **cut(motion, 5)), FAR)
    points, skeleton = seen[0], body_of(motion.skeleton).skeleton
    assert points.pelvis_pos_w[0] == pytest.approx([3, 0, body.standing_height])
    assert (
        points.ankle_pos_w[0, :, 2] == pytest.approx(np.full(2, body.sole))
        and points.ankle_pos_w[0, 0, 1] > 0 > points.ankle_pos_w[0, 1, 1]
    )
    assert (
        points.wrist_pos_w.shape == (40, 2, 3)
        and points.wrist_pos_w[0, 0, 1] > 0.1
        and len(skeleton.offsets) in (15, 22, 27)
    )


def cut(motion: HumanMotion, frames: int) -> dict[str, np.ndarray]:
    """The first frames, fewer than K has to hold."""
    return {name: getattr(motion, name)[:frames] for name in ("root_pos_w", "local_quat", "contacts")}


@pytest.mark.parametrize("body", BODIES, ids=lambda body: body.skeleton.name)
def test_arms_in_the_own_body_are_named(body: Body):
    still = standing(body)
    assert check_clip(still, FAR)["own_depth"] == 0 and check_clip(still, FAR)["lap_depth"] < 0.02
    inward = turned(
        turned(still, body.arms[0].root, about_x(np.array(-0.5))), body.arms[1].root, about_x(np.array(0.5))
    )
    assert {"own_depth", "lap_depth"} & set(faults(check_clip(inward, FAR)))
