"""K by hand at every threshold, P by hand, and a judge on a made-up trace of placed robots."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import stool
from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadObject, UnknownName
from mimicbench.core.motion import RobotMotion
from mimicbench.core.seeds import rng
from mimicbench.envs.metrics import EpisodeMetrics
from mimicbench.envs.rule_starts import Stance, draw_start
from mimicbench.objects.families.chair import make_chair
from mimicbench.objects.families.household import make_household
from mimicbench.objects.shape import SceneObject
from mimicbench.sim.native import NativePhysics
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.lie_bed import TASK as LIE_BED
from mimicbench.tasks.lie_sofa import TASK as LIE_SOFA
from mimicbench.tasks.lift_box import TASK as LIFT_BOX
from mimicbench.tasks.registry import TASKS
from mimicbench.tasks.sit_chair import PELVIS_BAND
from mimicbench.tasks.sit_chair import TASK as SIT_CHAIR
from mimicbench.tasks.task import SLACK, BodyPoints, ObjectInfo, first_run, longest_run
from mimicbench.tasks.touch_points import TASK as TOUCH_POINTS
from stool import H1, block, place, seated, standing

H, EPS = 0.5, 1e-9


def holds(x, y, z):
    """K's condition in one frame, with the pelvis at (x, y, z) and a stool of 0.5 m height and +-0.25 m."""
    points = np.array([[x, y, z]], float)
    return bool(
        SIT_CHAIR.holds(BodyPoints(points, np.zeros((1, 2, 3)), np.zeros((1, 2, 3))), ObjectInfo.of([block(H)]))[0]
    )


@pytest.mark.parametrize(
    ("z", "expected"),
    [
        (H, True),
        (H - EPS, False),
        (H + 0.27, True),
        (H + 0.27 - EPS, True),
        (H + 0.27 + EPS, False),
        (H + 0.1, True),
        (0.0, False),
        (1.0, False),
    ],
)
def test_height_of_the_pelvis(z, expected):
    assert holds(0, 0, z) is expected


@pytest.mark.parametrize("z", [H + 0.1])
@pytest.mark.parametrize(("edge", "expected"), [(0.25, True), (0.25 - EPS, True), (0.25 + EPS, False), (2.0, False)])
def test_footprint(edge, expected, z):
    for x, y in ((edge, 0), (-edge, 0), (0, edge), (0, -edge), (edge, edge), (-edge, edge)):
        assert holds(x, y, z) is expected


def test_the_footprint_is_the_whole_chair_seen_from_above():
    # a back that leans out behind the seat belongs to the chair's interior (appendix D.1)
    seat = block(0.45)
    leaning = SceneObject(
        "c",
        "chair",
        "dining",
        np.array([[0, 0, 0.225], [-0.4, 0, 0.7]]),
        np.tile(rot.IDENTITY, (2, 1)),
        np.array([[0.25, 0.25, 0.225], [0.05, 0.1, 0.25]]),
        np.ones((2, 3)),
        0.45,
        seat.seat_polygon,
    )
    facts = ObjectInfo.of([seat, leaning])
    assert facts.interior_xy(np.array([[-0.44, 0.2, 0.6]] * 2)).tolist() == [False, True]


def test_facts_of_an_object_without_a_seat():
    obj = block()
    bare = SceneObject(obj.id, "box", "box", obj.box_pos, obj.box_quat, obj.box_half, obj.box_rgb)
    assert np.isnan(ObjectInfo.of([bare]).seat_height[0])
    points = np.array([[0, 0, 0.3]])
    assert not SIT_CHAIR.holds(BodyPoints(points, np.zeros((1, 2, 3)), np.zeros((1, 2, 3))), ObjectInfo.of([bare]))[0]
    with pytest.raises(BadObject, match="has no seat"):
        bare.require_seat()


def test_three_tenths_of_a_second_are_fifteen_frames():
    assert (SIT_CHAIR.hold_frames(50), SIT_CHAIR.hold_frames(30), SIT_CHAIR.hold_frames(1)) == (15, 9, 1)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.booleans(), max_size=40))
def test_longest_run(values):
    best = run = 0
    for value in values:
        run = run + 1 if value else 0
        best = max(best, run)
    assert longest_run(np.array(values, bool)) == best


def clip(seated_frames, fps=50.0, frames=40):
    """A motion that stands, sits for so many frames, and stands again."""
    (up, joints), (down, bent) = standing(), seated(0.42)
    sits = (np.arange(frames) >= 10) & (np.arange(frames) < 10 + seated_frames)
    pos, angles = np.where(sits[:, None], down, up), np.where(sits[:, None], bent, joints)
    return RobotMotion(
        "c", "sit-chair", "h1", H1.joint_names, fps, pos, np.tile(rot.IDENTITY, (frames, 1)), angles, "block", "c"
    )


def test_k_of_a_motion():
    assert SIT_CHAIR.fulfilled(clip(15), block(), H1)
    assert not SIT_CHAIR.fulfilled(clip(14), block(), H1)
    assert SIT_CHAIR.fulfilled(clip(14, fps=30.0), block(), H1), "nine frames are enough at 30 Hz"
    assert not SIT_CHAIR.fulfilled(clip(30), block(0.8), H1), "too low for a higher stool"


@pytest.mark.parametrize("fps", [30.0, 50.0])
def test_learning_sees_little_of_the_rest(fps):
    """K holds from the first seated frame, so it is fulfilled after the hold time, and the clip ends 1.5 s later."""
    motion = clip(190, fps, 200)
    cut = SIT_CHAIR.trimmed(motion, block(), H1)
    assert cut.frames == 10 + SIT_CHAIR.hold_frames(fps) + round(1.5 * fps)
    assert (cut.joint_pos == motion.joint_pos[: cut.frames]).all() and SIT_CHAIR.fulfilled(cut, block(), H1)
    assert SIT_CHAIR.trimmed(cut, block(), H1) is cut
    assert SIT_CHAIR.trimmed(motion, block(0.8), H1) is motion, "never fulfilled"
    assert LIFT_BOX.trimmed(motion, block(), H1) is motion, "judged in the last frame"


@pytest.mark.parametrize("fps", [30.0, 50.0])
def test_who_still_moves_is_followed_until_at_rest(fps):
    """Who sits moves an arm at 1 rad/s until frame f: from 0.1 s before f on it is 0.1 rad from there or less, so that
    half a second of rest is over in frame f + 0.4 s; where that is more than `rest` s after K, in the frame of then.
    Who is never at rest, but does so at half the speed from 2.0 to 2.6 s, moves least in half a second of that.
    """
    slow, motion = replace(SIT_CHAIR, rest=3.0), clip(390, fps, 400)
    fulfilled = 10 + SIT_CHAIR.hold_frames(fps) - 1
    assert slow.trimmed(motion, block(), H1).frames == SIT_CHAIR.trimmed(motion, block(), H1).frames, "at rest at once"
    for seconds, ends in ((1.0, 1.5), (2.0, 2.4), (2.5, 2.9), (2.8, 3.0)):
        angles = motion.joint_pos.copy()
        angles[:, -1] += np.minimum(np.arange(400) - fulfilled, round(seconds * fps)) / fps
        cut = slow.trimmed(replace(motion, joint_pos=angles), block(), H1)
        assert cut.frames == pytest.approx(fulfilled + 1 + round(ends * fps), abs=1)
        assert SIT_CHAIR.trimmed(replace(motion, joint_pos=angles), block(), H1).frames == 1 + fulfilled + 1.5 * fps
    since = (np.arange(400) - fulfilled) / fps
    angles = motion.joint_pos.copy()
    angles[:, -1] += since - 0.5 * np.clip(since - 2.0, 0.0, 0.6)
    cut = slow.trimmed(replace(motion, joint_pos=angles), block(), H1)
    assert 2.49 < (cut.frames - 1 - fulfilled) / fps < 2.61


def test_the_pose_that_is_held_fulfils_k():
    """Who sits for 25 frames from the tenth on and then stands up again: K is fulfilled in frame 24 and lost from frame
    35 on, so that half of the way there is frame 29. Who rises by no more than 5 cm is followed to the end.
    """
    motion = clip(25)
    cut = SIT_CHAIR.trimmed(motion, block(), H1)
    assert cut.frames == 30
    assert SIT_CHAIR.held(cut, block(), H1)[-SIT_CHAIR.hold_frames(50.0) :].all()
    for above, frames in ((0.01, 30), (-0.01, 40)):
        pos = motion.root_pos_w.copy()
        pos[35:] = [*pos[34, :2], 0.42 + PELVIS_BAND + SLACK + above]
        assert SIT_CHAIR.trimmed(replace(motion, root_pos_w=pos), block(), H1).frames == frames


@given(st.lists(st.booleans(), max_size=20), st.integers(1, 4))
def test_first_run(values, length):
    end = first_run(np.array(values, bool), length)
    if end is None:
        assert longest_run(np.array(values, bool)) < length
    else:
        assert all(values[end - length + 1 : end + 1]) and longest_run(np.array(values[:end], bool)) < length


def test_body_points():
    pos, quat = H1.forward_kinematics(np.array([[1.0, 2.0, 3.0]]), rot.IDENTITY[None], np.zeros((1, 19)))
    points = BodyPoints.of(H1, pos, quat)
    assert points.pelvis_pos_w.tolist() == [[1, 2, 3]]
    assert points.ankle_pos_w.shape == points.wrist_pos_w.shape == (1, 2, 3)
    for pair in (points.ankle_pos_w[0], points.wrist_pos_w[0]):
        assert pair[0, 1] > 2 > pair[1, 1], "left, then right"
        np.testing.assert_allclose(pair[0, [0, 2]], pair[1, [0, 2]], atol=1e-12)


def show(judge, physics, postures, active=None):
    """Let the judge see a made-up trace: in each frame, robots that sit where `postures` (N,) says so and stand
    elsewhere.
    """
    (up, joints), (down, bent) = standing(), seated(0.42)
    for sits in postures:
        sits = np.array(sits)[:, None]
        n = len(sits)
        stool.put(
            physics, np.arange(n), np.where(sits, down, up), np.tile(rot.IDENTITY, (n, 1)), np.where(sits, bent, joints)
        )
        judge.update(physics.links(), None if active is None else torch.from_numpy(active))


def test_metrics_on_a_made_up_trace():
    physics = NativePhysics(H1, [block()] * 3, workers=1)
    judge = EpisodeMetrics(SIT_CHAIR, H1, physics, CONTROL_DT)
    # the first sits for 14 frames, gets up and sits again; the second sits for 15 and gets up; the third never sits
    show(judge, physics, [(True, True, False)] * 14)
    assert not judge.success.any()
    show(judge, physics, [(False, True, False)])
    assert judge.success.tolist() == [False, True, False] and judge.held.tolist() == [False, True, False]
    assert judge.first_success[1] == pytest.approx(15 * 0.02)
    show(judge, physics, [(True, False, False)] * 15)
    assert judge.success.tolist() == [True, True, False], "fulfilled is fulfilled"
    assert judge.held.tolist() == [True, False, False]
    assert judge.first_success[0] == pytest.approx(30 * 0.02) and torch.isnan(judge.first_success[2])
    assert judge.steps.tolist() == [30, 30, 30] and not judge.fell.any() and not judge.diverged.any()


def test_metrics_does_not_look_at_episodes_that_are_over():
    physics = NativePhysics(H1, [block()] * 2, workers=1)
    judge = EpisodeMetrics(SIT_CHAIR, H1, physics, CONTROL_DT)
    show(judge, physics, [(True, True)] * 20, active=np.array([True, False]))
    assert judge.success.tolist() == [True, False] and judge.steps.tolist() == [20, 0]


def test_metrics_sees_falls():
    physics = NativePhysics(H1, [block()] * 3, workers=1)
    judge = EpisodeMetrics(SIT_CHAIR, H1, physics, CONTROL_DT)
    tilts = rot.from_rotvec(np.array([[0, 1.1, 0], [0, 1.3, 0], [0, 0, 2.0]]))
    stool.put(physics, np.arange(3), np.array([[-1, 0, 1.0]] * 3), tilts, np.zeros((3, 19)))
    judge.update(physics.links())
    assert judge.fell.tolist() == [False, True, False], "a turn about the vertical is no fall"
    stool.put(
        physics,
        np.arange(3),
        np.array([[0, 0, 0.42 - 0.14], [-1, 0, 1], [0, 0, 0.42 - 0.16]]),
        np.tile(rot.IDENTITY, (3, 1)),
        np.zeros((3, 19)),
    )
    judge.update(physics.links())
    assert judge.fell.tolist() == [False, True, True]


def test_metrics_keeps_the_largest_effort_up_to_the_success():
    physics = NativePhysics(H1, [block()], workers=1)
    judge = EpisodeMetrics(SIT_CHAIR, H1, physics, CONTROL_DT)
    pos, joints = seated(0.42)
    place(physics, pos, joints)
    efforts = []
    for step in range(20):
        kick = joints + (0.5 if step == 17 else 0.0)  # after K is fulfilled
        physics.step(torch.tensor(kick)[None], measure_effort=True)
        efforts.append(float(physics.effort[0]))
        judge.update(physics.links())
    assert judge.success[0] and judge.first_success[0] == pytest.approx(15 * CONTROL_DT)
    assert judge.effort()[0] == pytest.approx(max(efforts[:15]))
    assert judge.max_effort[0] == pytest.approx(max(efforts)) and max(efforts) > 2 * max(efforts[:15])


def test_broken_physics_is_no_success():
    physics = NativePhysics(H1, [block()] * 2, workers=1)
    judge = EpisodeMetrics(SIT_CHAIR, H1, physics, CONTROL_DT)
    pos, joints = seated(0.42)
    place(physics, pos, joints, joint_vel=np.concatenate([np.zeros((1, 19)), np.full((1, 19), 1e12)]))
    for _ in range(20):
        physics.step(torch.tensor(joints).expand(2, 19), measure_effort=True)
        judge.update(physics.links())
    assert judge.success.tolist() == [True, False] and judge.diverged.tolist() == [False, True]
    assert torch.isfinite(judge.max_effort).all()


def test_registry():
    assert TASKS.get("sit-chair") is SIT_CHAIR
    with pytest.raises(UnknownName, match="unknown task 'sit-floor'; known are: .*sit-chair"):
        TASKS.get("sit-floor")


@pytest.mark.parametrize("task", TASKS.all(), ids=TASKS.names())
def test_every_task_can_be_sent_to_a_worker(task):
    assert pickle.loads(pickle.dumps(task)) is task
    assert pickle.loads(pickle.dumps(task.fulfilled_by_human)).__self__ is task


@pytest.mark.parametrize("task", TASKS.all(), ids=TASKS.names())
def test_every_task_is_whole(task):
    assert task.time_limit in (10.0, 20.0) and 0 <= task.hold_time <= 1 and task.family and task.title
    facts = ObjectInfo.of([make_chair(i) for i in range(3)])
    found = task.holds(BodyPoints(np.zeros((3, 3)), np.zeros((3, 2, 3)), np.zeros((3, 2, 3))), facts)
    assert found.shape == (3,) and found.dtype == bool


def body(pelvis=(0, 0, 0), ankles=((0, 0, 0), (0, 0, 0)), wrists=((0, 0, 0), (0, 0, 0))):
    """The key positions of one robot."""
    return BodyPoints(*(np.array([points], float) for points in (pelvis, ankles, wrists)))


def facts(height=0.5, half=0.25, goals=None):
    return ObjectInfo.of([block(height, half)], goals)


def test_sitting_on_a_sofa_is_judged_as_on_a_chair():
    assert (
        TASKS.get("sit-sofa").holds is SIT_CHAIR.holds and TASKS.get("sit-sofa").hold_time == SIT_CHAIR.hold_time == 0.3
    )


@pytest.mark.parametrize("joint", range(3))
@pytest.mark.parametrize(
    ("place", "expected"),
    [
        ((0, 0, H), True),
        ((0, 0, H - EPS), False),
        ((0, 0, H + 0.4 - EPS), True),
        ((0, 0, H + 0.4 + EPS), False),
        ((0.25, 0, H), True),
        ((0.25 + EPS, 0, H), False),
    ],
)
def test_lying_on_a_bed_needs_pelvis_and_both_ankles_on_it(joint, place, expected):
    points = [(0.0, 0.0, H + 0.1)] * 3
    points[joint] = place
    assert LIE_BED.holds(body(points[0], points[1:]), facts())[0] == expected


@pytest.mark.parametrize(
    ("pelvis", "ankle", "expected"),
    [
        (H, 0.25 + EPS, True),
        (H, 0.25, False),
        (H - EPS, 0.4, False),
        (H + 0.4 - EPS, 0.4, True),
        (H + 0.4 + EPS, 0.4, False),
    ],
)
def test_lying_on_a_sofa_needs_ankles_above_half_of_its_height(pelvis, ankle, expected):
    # the ankles may be anywhere seen from above, only not low
    for ankles in (((2, 0, ankle), (0, 0, 1)), ((0, 0, 1), (0, 2, ankle))):
        assert LIE_SOFA.holds(body((0, 0, pelvis), ankles), facts())[0] == expected


@pytest.mark.parametrize(("off", "expected"), [(0.1 - EPS, True), (0.1 + EPS, False), (0.0, True)])
def test_touching_points_needs_both_wrists_within_a_tenth_of_a_meter(off, expected):
    goal = np.array([[0.4, 0.2, 0.8], [0.4, -0.2, 0.7]])
    for wrist in (0, 1):
        for direction in np.eye(3):
            wrists = goal.copy()
            wrists[wrist] += off * direction
            assert TOUCH_POINTS.holds(body(wrists=wrists), facts(goals=[goal]))[0] == expected
    assert not TOUCH_POINTS.holds(body(), facts())[0], "without a goal nothing is touched"
    for wrist in (0, 1):  # a hand without a goal may be anywhere
        one = goal.copy()
        one[1 - wrist] = np.nan
        wrists = goal + 5.0
        wrists[wrist] = goal[wrist] + [off, 0.0, 0.0]
        assert TOUCH_POINTS.holds(body(wrists=wrists), facts(goals=[one]))[0] == expected
    assert TOUCH_POINTS.hold_frames(50) == 50


@pytest.mark.parametrize(
    ("lift", "off", "expected"),
    [(0.2, 0.1 - EPS, True), (0.2 - EPS, 0.0, False), (0.5, 0.1 + EPS, False), (0.3, 0.05, True)],
)
def test_lifting_a_box_needs_height_and_both_wrists_at_its_surface(lift, off, expected):
    # turned by a quarter and shifted: its sides are still 0.25 m from its middle
    scene = facts().moved(np.array([[0.1, 0.0, lift]]), rot.from_yaw(np.array([np.pi / 2])))
    wrists = np.array([[0.1, 0.25 + off, lift + 0.3], [0.1, -0.25, lift + 0.3]])
    for pair in (wrists, wrists[::-1]):
        assert LIFT_BOX.holds(body(wrists=pair), scene)[0] == expected


def test_a_toppled_box_is_not_lifted():
    box = block(
        0.9, 0.4, movable=True, mass=2.0
    )  # 0.8 m deep and 0.9 m high, so its base's middle is 0.4 m above the floor then
    toppled = ObjectInfo.of([box]).moved(np.array([[0, 0, 0.4]]), rot.from_rotvec(np.array([[0.0, np.pi / 2, 0.0]])))
    wrists = np.array([[0.45, 0.42, 0.4], [0.45, -0.42, 0.4]])
    assert not LIFT_BOX.holds(body(wrists=wrists), toppled)[0]
    reason = LIFT_BOX.failure_reason(body(wrists=wrists), toppled)[0]
    assert reason == "box 25 cm too low", "its middle was 0.45 m above the floor, and is 0.4 m now"


def test_lifting_a_box_is_judged_in_the_last_frame():
    box = block(0.8, 0.2, movable=True, mass=2.0)
    physics = NativePhysics(H1, [box], workers=1)
    judge = EpisodeMetrics(LIFT_BOX, H1, physics, CONTROL_DT)
    pos, joints = standing()
    hands = (
        BodyPoints.of(H1, *H1.forward_kinematics(pos[None], rot.IDENTITY[None], joints[None])).wrist_pos_w[0].mean(0)
    )
    for height, expected in ((0.0, False), (0.3, True), (0.1, False)):
        place(physics, pos, joints)
        physics.qpos()[0, -7:-4] = [hands[0], hands[1], height]
        judge.update(physics.links())
        # the hands hang beside the hips, 0.2 m to the left and right of the middle: at the sides of the box
        assert judge.success.tolist() == judge.held.tolist() == [expected] and not judge.over().any()
    assert judge.first_success[0] == pytest.approx(2 * CONTROL_DT)


def test_who_lies_has_not_fallen_where_lying_is_the_task():
    obj = block(0.42, 1.0)
    for task, fallen in ((LIE_BED, False), (SIT_CHAIR, True)):
        physics = NativePhysics(H1, [obj], workers=1)
        judge = EpisodeMetrics(task, H1, physics, CONTROL_DT)
        stool.put(
            physics, np.arange(1), np.array([[0, 0, 0.6]]), rot.from_rotvec(np.array([[0, -1.5, 0]])), np.zeros((1, 19))
        )
        judge.update(physics.links())
        assert judge.fell.tolist() == [fallen]


def test_k_of_a_motion_that_moves_its_object():
    frames = 10
    pos, joints = standing()
    hands = (
        BodyPoints.of(H1, *H1.forward_kinematics(pos[None], rot.IDENTITY[None], joints[None])).wrist_pos_w[0].mean(0)
    )
    track = np.tile([hands[0], hands[1], 0.0], (frames, 1))
    still = np.tile(rot.IDENTITY, (frames, 1))
    box = block(0.8, 0.2, movable=True, mass=2.0)

    def lifted(heights):
        track[:, 2] = heights
        return RobotMotion(
            "c",
            "lift-box",
            "h1",
            H1.joint_names,
            50.0,
            np.tile(pos, (frames, 1)),
            still,
            np.tile(joints, (frames, 1)),
            box.id,
            "c",
            object_pos_w=track.copy(),
            object_quat_w=still,
        )

    assert LIFT_BOX.fulfilled(lifted(np.linspace(0, 0.25, frames)), box, H1)
    assert not LIFT_BOX.fulfilled(lifted(np.linspace(0.25, 0, frames)), box, H1), "put down again"


def test_starts_of_touch_points_show_both_targets_on_the_map():
    stance = Stance.of(H1)
    for index in range(60):
        start = draw_start(TOUCH_POINTS, make_household(index), stance, rng(index, "start"))
        ahead = rot.rotate_inverse(start.root_quat_w, start.wrist_goal_w - start.root_pos_w)
        assert (abs(ahead[:, :2]) < 0.64).all() and (ahead[:, 0] > 0).all()


def test_beside_is_signed_by_the_edge_of_the_interior():
    """Of a block 0.4 m deep and 0.6 m wide around the origin: outside, the way to it; inside, to its nearest edge."""
    half = np.array([[0.2, 0.3, 0.2]])
    block = SceneObject("b", "b", "b", np.array([[0, 0, 0.2]]), np.array([[1.0, 0, 0, 0]]), half, np.ones((1, 3)), 0.4)
    places = np.array([[0.0, 0.0, 1.0], [0.15, 0.0, 0.0], [0.2, 0.1, 0.0], [0.25, 0.0, 0.0], [0.23, -0.34, 0.0]])
    info = ObjectInfo.of([block] * len(places))
    np.testing.assert_allclose(info.beside(places), [-0.2, -0.05, 0.0, 0.05, 0.05], atol=1e-12)
    assert (info.interior_xy(places) == (info.beside(places) <= 0)).all()
