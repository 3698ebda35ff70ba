from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.core.skeleton import forward_kinematics
from mimicbench.objects.families.box import make_box
from mimicbench.objects.families.household import make_household
from mimicbench.objects.shape import SceneObject
from mimicbench.references.actions import postures, reaching
from mimicbench.references.body.body import body_of, core4d_body
from mimicbench.references.body.posing import Arms, Legs, Trunk, pose, reach, shoulders
from mimicbench.references.checks.quality import check_clip, faults
from mimicbench.references.checks.signals import RATE, signals_of
from mimicbench.references.locomotion.gait import Gait
from mimicbench.references.synthesis import lift_box
from mimicbench.references.synthesis.registry import synthesize
from mimicbench.references.synthesis.touch_points import synthesize_touch_points

CLIPS = 24
Clips = list[tuple[HumanMotion, SceneObject]]


def _clips(task: str, make: Callable[[int], SceneObject]) -> Clips:
    objects = [make(i) for i in range(CLIPS)]
    return [(synthesize(task, i, obj, 0), obj) for i, obj in enumerate(objects)]


@pytest.fixture(scope="module")
def touches() -> Clips:
    return _clips("touch-points", make_household)


@pytest.fixture(scope="module")
def lifts() -> Clips:
    return _clips("lift-box", make_box)


def _wrists(motion: HumanMotion) -> np.ndarray:
    pos, _ = motion.forward_kinematics()
    return pos[:, [arm.end for arm in body_of(motion.skeleton).arms]]


def test_nearly_all_clips_pass_the_gate(touches: Clips, lifts: Clips):
    assert sum(not faults(check_clip(*clip)) for clip in touches) >= CLIPS - 2
    assert sum(not faults(check_clip(*clip)) for clip in lifts) >= CLIPS - 2


def test_wrists_stay_at_their_targets_for_more_than_a_second(touches: Clips):
    for motion, _ in touches:
        away = np.linalg.norm(_wrists(motion) - motion.wrist_goal_w, axis=-1).max(-1)
        assert (away[-33:] < 0.03).all()
        hands = [motion.contact_names.index(name) for name in ("left_hand", "right_hand")]
        assert motion.contacts[-33:, hands].all() and not motion.contacts[0, hands].any()


def test_boxes_are_lifted_between_the_hands_and_never_touch_the_floor_again(lifts: Clips):
    for motion, obj in lifts:
        wrists, touched = _wrists(motion), motion.contacts[:, motion.contact_names.index("left_hand")]
        local = rot.rotate_inverse(motion.object_quat_w[:, None], wrists - motion.object_pos_w[:, None])
        assert motion.object_pos_w[-1, 2] >= 0.25 and obj.distance(local[-1]).max() <= 0.03
        held = local[touched]
        assert np.abs(held - held[-1]).max() < 0.012  # as rigid as a clasp is
        lifted = motion.object_pos_w[:, 2] > 1e-3
        assert not lifted[~touched].any()
        corners = motion.object_pos_w[:, None] + rot.rotate(
            motion.object_quat_w[:, None], obj.corners().reshape(1, -1, 3)
        )
        assert corners[..., 2].min() > -2e-3


def _lean(motion: HumanMotion) -> np.ndarray:
    """(T,) of the chest from upright [rad]."""
    up = rot.rotate(motion.forward_kinematics()[1][:, body_of(motion.skeleton).chest], np.array([0.0, 0.0, 1.0]))
    return np.arccos(up[:, 2])


def _face(motion: HumanMotion) -> np.ndarray:
    """(T, 3) between the eyes [m]."""
    body = body_of(motion.skeleton)
    pos, quat = motion.forward_kinematics()
    skull = next(part for part in body.parts if part.role == "head")
    return pos[:, body.head] + rot.rotate(quat[:, body.head], np.array(skull.start) + [skull.radius, 0.0, 0.0])


def test_whoever_lifts_stands_up_and_holds_the_box_against_the_body(lifts: Clips):
    for motion, obj in lifts:
        body, lean = body_of(motion.skeleton), _lean(motion)
        pos, quat = motion.forward_kinematics()
        assert lean.max() > np.deg2rad(30) and lean[-1] < np.deg2rad(30)
        assert pos[-1, body.pelvis, 2] > 0.9 * body.standing_height
        away = -postures.depth(body, pos[-1:], quat[-1:], obj, motion.object_pos_w[-1], lift_box.FRONT)[0]
        assert -0.02 < away < 0.04
        wrists = _wrists(motion)[-1]
        assert 0.8 < wrists[:, 2].mean() / body.standing_height < 1.25


def test_heavy_boxes_are_clasped_lower_than_light_ones():
    obj, style = make_box(0), lift_box.draw_style(np.random.default_rng(0))
    light, heavy = (replace(obj, mass=mass) for mass in (1.0, 4.0))
    heights = [lift_box._clasp(box, style, 1.0)[:, 2].mean() for box in (light, heavy)]
    assert heights[0] - heights[1] == pytest.approx(0.10 * obj.bounds()[1][2], abs=1e-9)


def test_faces_keep_a_natural_distance(touches: Clips, lifts: Clips):
    for clips, least in ((touches, 0.40), (lifts, 0.40)):
        away = []
        for motion, _ in clips:
            held = motion.contacts[:, motion.contact_names.index("left_hand")]
            away.append(np.linalg.norm(_face(motion) - _wrists(motion).mean(1), axis=-1)[held].min())
        assert np.median(away) > least


def test_nobody_freezes_who_holds_or_touches(touches: Clips, lifts: Clips):
    for motion, _ in touches + lifts:
        pos, _ = motion.forward_kinematics()
        speed = np.linalg.norm(np.diff(pos, axis=0), axis=-1).mean(-1) * motion.fps
        assert np.convolve(speed, np.full(8, 1 / 8), "valid").min() > 2e-3


def test_chests_give_under_a_box(lifts: Clips):
    """Shoulders turn against hips: 0.3 degrees/s^2 before they did, 152 in recordings."""
    for motion, _ in lifts:
        twist = signals_of(motion).single["shoulders against hips"]
        assert np.abs(np.diff(twist, 2)[len(twist) // 2 :]).mean() * RATE**2 > 5


def test_durations_are_the_papers(touches: Clips, lifts: Clips):
    for clips, mean in ((touches, 3.3), (lifts, 4.3)):
        durations = [motion.duration for motion, _ in clips]
        assert np.mean(durations) == pytest.approx(mean, abs=0.12) and 0.1 < np.std(durations) < 0.3


def test_clips_begin_in_motion_a_few_steps_away(touches: Clips, lifts: Clips):
    for motion, _ in touches + lifts:
        ankles = motion.forward_kinematics()[0][:, [leg.end for leg in body_of(motion.skeleton).legs], :2]
        assert 0.05 < np.linalg.norm(ankles[0].mean(0) - ankles[-1].mean(0)) < 0.8
        lifted_off = np.diff(motion.contacts[:, :2].astype(int), axis=0) == -1
        assert 1 <= lifted_off.sum() + (~motion.contacts[0, :2]).sum() <= 3
    speeds = [np.linalg.norm(motion.root_pos_w[1] - motion.root_pos_w[0]) * motion.fps for motion, _ in touches + lifts]
    assert np.median(speeds) > 0.1


def test_start_object_and_style_determine_the_clip():
    obj = make_household(3)
    once, again = (synthesize_touch_points("touch-points-0-00003", obj, 0) for _ in range(2))
    assert np.array_equal(once.local_quat, again.local_quat) and once.style == again.style
    assert not np.array_equal(once.local_quat[0], synthesize_touch_points("touch-points-1-00003", obj, 1).local_quat[0])


def test_center_of_mass_by_hand():
    body = core4d_body()
    pos = np.zeros((1, len(body.skeleton.joint_names), 3))
    assert postures.center_of_mass(body, pos) == pytest.approx(np.zeros((1, 3)))
    # shares of the segments add up to one body, so moving all of it by 1 m moves the center by 1 m
    assert postures.center_of_mass(body, pos + [1.0, 0.0, 0.0])[0] == pytest.approx([1.0, 0.0, 0.0])
    # one forearm with hand is 2.2 % of the mass, its center 68.2 % along it
    pos[0, body.arms[0].end, 2] = -1.0
    assert postures.center_of_mass(body, pos)[0, 2] == pytest.approx(-0.022 * 0.682, rel=2e-3)


def test_postures_are_balanced_and_reach():
    body, yaw = core4d_body(0.95), np.pi
    ground = postures.Ground.at(body, np.array([0.6, 0.1]), yaw, Gait())
    assert ground.ankle_pos_w[0, 1] < 0.1 < ground.ankle_pos_w[1, 1]  # who faces -x has the left foot at the smaller y
    obj = make_box(0)
    for height in (0.5, 0.8, 1.1):
        wrists = np.array([[0.42, -0.1, height], [0.42, 0.3, height]])
        posture, short, _ = postures.find_posture(body, ground, wrists, obj, np.array([-5.0, 0, 0]), postures.Manner())
        assert short == 0.0
        trunk = postures.Posture(*(np.asarray(value)[None] for value in vars(posture).values())).trunk(yaw)
        arms = reach(body, trunk, wrists[None], postures.elbow_axes(trunk.chest_quat_w, np.array([posture.elbow])))
        pos, _ = forward_kinematics(body.skeleton, trunk.pelvis_pos_w, pose(body, trunk, ground.legs(1), arms))
        assert pos[0, [arm.end for arm in body.arms]] == pytest.approx(wrists, abs=1e-6)
        assert pos[0, [leg.end for leg in body.legs]] == pytest.approx(ground.ankle_pos_w, abs=1e-6)
        assert postures.center_of_mass(body, pos)[0, :2] == pytest.approx(ground.support(body), abs=0.015)
        if height == 0.5:  # the hips are behind the feet, the trunk leans
            assert posture.pelvis_pos_w[0] > 0.65 and posture.pitch > 0.4


def test_hands_arrive_along_the_normals_from_outside():
    progress, goal = np.linspace(0, 1, 31), np.array([[0.0, -0.3, 0.8], [0.0, 0.3, 0.8]])
    swinging = np.tile([[0.6, -0.25, 0.9], [0.6, 0.25, 0.9]], (31, 1, 1))
    path = reaching.hands_from_outside(swinging, goal, lift_box.SIDES, progress, np.zeros((2, 3)))
    assert path[0] == pytest.approx(swinging[0]) and path[-1] == pytest.approx(goal)
    late = path[27:30] - goal
    assert (late[:, 0, 1] < 0).all() and (np.abs(late[..., [0, 2]]) < 0.2 * np.abs(late[..., 1:2])).all()


def test_hands_out_of_reach_stay_behind_without_a_snap():
    body = core4d_body()
    trunk = Trunk(np.tile([0.0, 0.0, 1.0], (50, 1)), *(np.tile(rot.IDENTITY, (50, 1)) for _ in range(3)))
    root, length = shoulders(body, trunk), sum(body.length(body.arms[0]))
    away = np.linspace(0.5, 2.0, 50)[:, None, None] * length * np.array([1.0, 0.0, 0.0])
    kept = np.linalg.norm(reaching.within_reach(body, trunk, root + away) - root, axis=-1) / length
    assert (
        kept[0] == pytest.approx(0.5) and kept.max() < reaching.MOST_STRETCH and (np.diff(kept, axis=0) > -1e-12).all()
    )


def test_steps_arrive_beside_each_other_without_crossing():
    stop = np.array([0.7, 0.2])
    for side in (-0.2, 0.2):
        steps = reaching.steps_up_to(stop + [0.6, side], np.pi + 0.3, stop, np.pi, reaching.STRIDES, 1.0)
        left, right = (steps.xy[steps.side == foot][-1] for foot in (0, 1))
        assert 0.5 * (left + right) == pytest.approx(stop) and right[1] - left[1] == pytest.approx(
            reaching.STRIDES.width
        )
        assert (np.diff(steps.side) != 0).all() and steps.yaw[-1] == pytest.approx(np.pi)


def test_frames_keeps_what_is_not_there():
    legs = Legs(np.zeros((5, 2, 3)), np.zeros((5, 2, 4)), np.zeros((5, 2, 3)))
    assert reaching.frames(legs, np.array([1, 3])).toe_bend is None
    assert len(reaching.frames(Arms(np.zeros((5, 2, 4)), np.zeros((5, 2, 4))), slice(0, 2)).upper) == 2
