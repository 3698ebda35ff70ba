from dataclasses import asdict, fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadObject, UnknownName
from mimicbench.core.motion import HumanMotion
from mimicbench.objects.families.chair import make_chair
from mimicbench.objects.registry import FAMILIES
from mimicbench.objects.shape import SceneObject
from mimicbench.references.actions.sit_styles import SitStyle
from mimicbench.references.body import skeletons as human
from mimicbench.references.body.body import unihsi_body
from mimicbench.references.body.limbs import two_link
from mimicbench.references.checks.quality import Limits, check_clip, faults
from mimicbench.references.curves import minimum_jerk, smooth_below
from mimicbench.references.locomotion.balance import balance, support_point
from mimicbench.references.locomotion.feet import swing_feet
from mimicbench.references.locomotion.gait import Gait, plan_footsteps
from mimicbench.references.locomotion.route import around_box
from mimicbench.references.synthesis.manner import Middle
from mimicbench.references.synthesis.registry import synthesize
from mimicbench.tasks.registry import TASKS

CLIPS = 48


@pytest.fixture(scope="module")
def clips() -> list[tuple[HumanMotion, SceneObject]]:
    return [(synthesize("sit-chair", i, make_chair(i, 0), 0), make_chair(i, 0)) for i in range(CLIPS)]


def test_skeleton_stands_upright_in_rest():
    motion = HumanMotion(
        "rest", "sit-chair", human.UNIHSI, 30.0, np.zeros((2, 3)), np.tile(rot.IDENTITY, (2, 15, 1)), "none"
    )
    pos, _ = motion.forward_kinematics()
    assert pos[0, human.UNIHSI.index("left_foot")] == pytest.approx([0, 0.084887, -0.831416])
    assert pos[0, human.UNIHSI.index("right_hand")] == pytest.approx([-0.02405, -0.18311, 0.236151 + 0.2435 - 0.533735])
    assert human.UNIHSI.scaled(1.1).offsets[1, 2] == pytest.approx(1.1 * 0.236151)


coordinate = st.floats(-1, 1, allow_nan=False)


@settings(max_examples=80, deadline=None)
@given(st.tuples(coordinate, coordinate, coordinate), st.floats(0.05, 0.995), st.floats(-0.8, 0.8), st.booleans())
def test_limb_reaches_its_end_and_bends_the_right_way(
    direction: tuple[float, float, float], stretch: float, yaw: float, backward: bool
):
    towards = np.array(direction) + [0, 0, -2.0]
    root, upper, lower = np.array([[0.3, -0.2, 1.0]]), 0.42, 0.41
    end = root + (0.02 + stretch * (upper + lower - 0.02)) * towards / np.linalg.norm(towards)
    side = np.array([[-np.sin(yaw), np.cos(yaw), 0.0]])
    upper_quat, lower_quat, hinge = two_link(root, end, side, upper, lower, backward)
    knee = root + rot.rotate(upper_quat, np.array([0, 0, -upper]))
    assert knee + rot.rotate(lower_quat, np.array([0, 0, -lower])) == pytest.approx(end, abs=1e-9)
    local = rot.to_rotvec(rot.multiply(rot.conjugate(upper_quat), lower_quat))
    assert local == pytest.approx(np.array([[0, hinge[0], 0]]), abs=1e-7)  # a hinge about y, nothing else
    assert (hinge[0] >= 0) == backward


def test_limb_out_of_reach_is_stretched_towards_the_end():
    root, end = np.zeros((1, 3)), np.array([[0.0, 0.0, -5.0]])
    upper, lower, hinge = two_link(root, end, np.array([[0.0, 1.0, 0.0]]), 0.4, 0.4, True)
    assert np.isfinite(np.concatenate([upper, lower])).all() and abs(hinge[0]) < 1e-3


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(0, 1), min_size=2, max_size=60), st.integers(1, 8))
def test_smooth_below_never_exceeds_its_limit(values: list[float], half_width: int):
    limit = np.array(values)
    below = smooth_below(limit, half_width)
    assert (below <= limit + 1e-12).all() and below.min() >= limit.min() - 1e-12


def test_minimum_jerk_by_hand():
    assert minimum_jerk(np.array([-1, 0, 0.25, 0.5, 1, 2])) == pytest.approx([0, 0, 0.103515625, 0.5, 1, 1])


@settings(max_examples=60, deadline=None)
@given(st.floats(-1.75, 1.75), st.floats(0.0, 1.0))
def test_route_keeps_clear_of_the_object(azimuth: float, extra: float):
    low, high, margin = np.array([-0.25, -0.3]), np.array([0.25, 0.3]), 0.4
    start, goal = (1.1 + extra) * np.array([np.cos(azimuth), np.sin(azimuth)]), np.array([0.66, 0.0])
    route = around_box(start, goal, low, high, margin)
    points = np.array([route.at(s)[0] for s in np.linspace(0, route.length, 200)])
    gap = np.linalg.norm(np.maximum(np.maximum(low - points, points - high), 0), axis=-1)
    assert gap.min() >= margin - 0.005  # the arc is a polygon
    assert points[0] == pytest.approx(start) and points[-1] == pytest.approx(goal)
    assert route.length <= np.linalg.norm(goal - start) * 1.5 + 1e-9


@settings(max_examples=40, deadline=None)
@given(st.floats(-3.1, 3.1), st.floats(-1.7, 1.7), st.floats(0.8, 2.0))
def test_footsteps_keep_step_turn_and_width(start_yaw: float, azimuth: float, distance: float):
    gait, scale = Gait(), 1.08
    start = distance * np.array([np.cos(azimuth), np.sin(azimuth)]) + [0.3, 0]
    goal = np.array([0.3, 0.0])
    route = around_box(start, np.array([0.66, 0.0]), np.array([-0.25, -0.3]), np.array([0.25, 0.3]), 0.4)
    steps = plan_footsteps(start_yaw, route, goal, 0.0, gait, scale)
    assert (np.diff(steps.side) != 0).all()  # left, right, left, ...
    assert np.abs(np.diff([steps.first_yaw, *steps.yaw])).max() <= 1.01 * gait.max_turn
    feet, yaws = steps.first_xy.copy(), np.full(2, steps.first_yaw)
    for side, xy, yaw in zip(steps.side, steps.xy, steps.yaw, strict=True):
        sideways = (1 - 2 * side) * (xy - feet[1 - side]) @ np.array([-np.sin(yaws[1 - side]), np.cos(yaws[1 - side])])
        assert sideways >= 0.8 * gait.width * scale - 1e-9  # legs never cross
        assert np.linalg.norm(xy - feet[side]) < 2.5 * gait.speed * gait.period
        feet[side], yaws[side] = xy, yaw
    assert feet.mean(0) == pytest.approx(goal, abs=0.03) and np.cos(yaws) == pytest.approx(1)
    # who turned keeps the last foot to its own side
    assert np.linalg.norm(feet[0] - feet[1]) == pytest.approx(gait.width * scale, abs=0.055)


def test_pendulum_is_balanced_over_the_feet():
    gait = Gait()
    route = around_box(np.array([3.0, 0.0]), np.array([1.0, 0.0]), np.array([-0.25, -0.3]), np.array([0.25, 0.3]), 0.4)
    steps = plan_footsteps(np.pi, route, np.array([0.8, 0.0]), 0.0, gait, 1.0)
    time = np.arange(int((steps.end + 1.5) * 60)) / 60
    body = unihsi_body()
    center, support = balance(steps, time, gait, body), support_point(steps, time, gait, body)
    acceleration = np.diff(center, 2, axis=0) * 60**2
    assert center[1:-1] - 0.9 / 9.81 * acceleration == pytest.approx(support[1:-1], abs=1e-9)
    feet = swing_feet(steps, time, gait, body)
    for side in (0, 1):  # while one foot swings, the support is nearer to the other, and in the middle under it
        swings = ~feet.contact[:, side]
        away = np.linalg.norm(support[swings, None] - feet.pos_w[swings, :, :2], axis=-1)
        assert (away[:, 1 - side] < away[:, side]).mean() > 0.6 and away[:, 1 - side].min() < 0.02
        assert feet.pos_w[swings, side, 2].max() >= body.sole + 0.05


def test_clips_pass_the_gate(clips: list[tuple[HumanMotion, SceneObject]]):
    passed = 0
    for motion, obj in clips:
        measures = check_clip(motion, obj)
        assert set(faults(measures)) <= {"object_depth"}, (motion.id, obj.kind, measures)
        assert measures["skate"] < 1e-9 and measures["seat_depth"] <= 0.02 and measures["object_depth"] < 0.03
        passed += not faults(measures)
    assert passed >= 0.9 * len(clips)  # the others lean on an armrest or a back by up to 5 mm too much as they rest
    assert {obj.kind for _, obj in clips} == {"dining", "armchair", "easy", "stool"}


def test_clips_end_on_the_seat_facing_forward(clips: list[tuple[HumanMotion, SceneObject]]):
    for motion, obj in clips:
        scale = motion.style["body_scale"]
        end = motion.root_pos_w[-1]
        low, high = obj.seat_polygon.min(0), obj.seat_polygon.max(0)
        assert (end[:2] > low).all() and (end[:2] < high).all()
        assert -0.02 <= end[2] - obj.require_seat() - unihsi_body(scale).buttock <= 0
        assert abs(rot.yaw_of(motion.local_quat[-1, 0])) < 0.25
        rests = motion.root_pos_w[-round(0.5 * motion.fps) :]
        assert np.ptp(rests[:, 2]) < 0.005 and np.ptp(rests, axis=0).max() < 0.04  # shifts on the seat, not off it
        assert motion.contacts[-1, :3].all() and not motion.contacts[0, 2:].any()


def test_clips_are_smooth_and_of_usual_length(clips: list[tuple[HumanMotion, SceneObject]]):
    durations = [motion.duration for motion, _ in clips]
    assert np.mean(durations) == pytest.approx(14.8, abs=0.25) and np.std(durations) == pytest.approx(0.5, abs=0.15)
    for motion, _ in clips:
        velocity = np.diff(motion.root_pos_w, axis=0) * motion.fps
        assert np.linalg.norm(velocity[0]) < 0.06 and np.linalg.norm(velocity, axis=-1).max() < 1.3


def test_people_sit_down_in_many_ways(clips: list[tuple[HumanMotion, SceneObject]]):
    down = {(motion.style["left_down"], motion.style["right_down"]) for motion, _ in clips}
    rest = {(motion.style["left_rest"], motion.style["right_rest"]) for motion, _ in clips}
    assert len(down) >= 6 and len(rest) >= 6
    assert 0.2 < np.mean([motion.style["against"] > 0 for motion, _ in clips]) < 0.8
    for motion, _ in clips:
        assert set(motion.style) == {field.name for field in fields(SitStyle)} | {"turn"}
        assert all(type(value) is float for value in motion.style.values())


def test_feet_stay_near_the_pelvis_heading(clips: list[tuple[HumanMotion, SceneObject]]):
    for motion, _ in clips:
        _, quat = motion.forward_kinematics()
        heading = rot.yaw_of(quat[:, 0])
        for foot in ("left_foot", "right_foot"):
            assert (
                np.abs(rot.wrap_angle(rot.yaw_of(quat[:, motion.skeleton.index(foot)]) - heading)).max() < 0.45
            )  # toes out, pelvis turned a little


def test_starts_are_spread(clips: list[tuple[HumanMotion, SceneObject]]):
    start = np.array([motion.root_pos_w[0, :2] for motion, _ in clips])
    azimuth, distance = np.arctan2(start[:, 1], start[:, 0]), np.linalg.norm(start, axis=-1)
    assert np.abs(azimuth).max() < np.deg2rad(104) and np.ptp(azimuth) > np.deg2rad(150)
    assert distance.min() > 0.93 and distance.max() < 2.1
    heading = np.array([rot.yaw_of(motion.local_quat[0, 0]) for motion, _ in clips])
    assert abs(np.exp(1j * heading).mean()) < 0.35  # all around


def test_a_clip_is_remade_alone_from_its_id():
    obj = make_chair(3, 0)
    first, again = synthesize("sit-chair", 7, obj, 5), synthesize("sit-chair", 7, obj, 5)
    assert first.id == "sit-chair-5-00007" and first.object_id == obj.id
    assert (
        first.local_quat.tobytes() == again.local_quat.tobytes()
        and first.root_pos_w.tobytes() == again.root_pos_w.tobytes()
    )
    assert first.style == again.style and (first.contacts == again.contacts).all()
    assert (
        synthesize("sit-chair", 8, obj, 5).style != first.style
        and synthesize("sit-chair", 7, obj, 6).style != first.style
    )


@pytest.mark.parametrize("task", list(TASKS))
def test_people_who_are_alike_differ_in_where_they_begin_alone(task):
    """Nobody has to be told how they do it: two clips on one object have one style. They are not those of others."""
    obj = FAMILIES.get(TASKS.get(task).family).make(2, 0)
    one, other, usual = (synthesize(task, index, obj, 0, alike) for index, alike in ((0, True), (1, True), (0, False)))
    # which place on a sofa, and which side of a bed, follow from where somebody comes from; so does who is in a hurry
    led = {"seat_y", "turn", "walking", "reach_duration", "overlap", "body_scale"}
    same = {name for name in one.style if one.style[name] == other.style[name]}
    assert set(one.style) - same <= led
    assert not np.allclose(one.root_pos_w[0, :2], other.root_pos_w[0, :2], atol=1e-3)
    assert one.style != usual.style


def test_the_middle_of_what_can_be_drawn():
    chance = Middle()
    assert chance.uniform(2, 5) == 3.5 and chance.uniform(size=2).tolist() == [0.5, 0.5]
    assert chance.standard_normal() == 0.0 and chance.integers(2) == 0 and chance.integers(1, 9) == 1
    assert chance.choice([3, 4, 5], p=[0.2, 0.5, 0.3]) == 4 and chance.choice([7, 8], 2).tolist() == [7, 7]
    assert chance.permutation([2.0, 1.0]).tolist() == [2.0, 1.0]


def test_unknown_task_and_missing_seat():
    obj = make_chair(0, 0)
    with pytest.raises(UnknownName, match="sit-chair"):
        synthesize("fly", 0, obj, 0)
    seatless = SceneObject.from_dict({**obj.to_dict(), "seat_height": None})
    with pytest.raises(BadObject, match="no seat"):
        synthesize("sit-chair", 0, seatless, 0)


def test_the_gate_sees_skating_and_sinking():
    obj = make_chair(1, 0)
    motion = synthesize("sit-chair", 1, obj, 0)
    moved = motion.root_pos_w.copy()
    moved[:, 2] -= 0.05
    sunk = HumanMotion(**{**vars(motion), "root_pos_w": moved})
    assert {"floor_depth", "object_depth"} <= set(faults(check_clip(sunk, obj)))
    moved = motion.root_pos_w.copy()
    moved[:, 0] += 0.002 * np.arange(len(moved))
    assert "skate" in faults(check_clip(HumanMotion(**{**vars(motion), "root_pos_w": moved}), obj))
    assert faults(check_clip(motion, obj), Limits(object_depth=0.0)) and asdict(Limits())["object_depth"] == 0.02
