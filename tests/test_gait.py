import time

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import pace
from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.motion import HumanMotion
from mimicbench.references.body.body import Body, core4d_body, roam_body, unihsi_body
from mimicbench.references.body.limbs import ease
from mimicbench.references.checks.quality import bearing_points, stance_slides
from mimicbench.references.locomotion.feet import rolled
from mimicbench.references.locomotion.gait import Gait
from mimicbench.references.locomotion.replan import walk_from
from mimicbench.references.locomotion.route import Route, around_box
from mimicbench.references.locomotion.states import BodyState, state_of_motion, state_of_walk
from mimicbench.references.locomotion.straight import clip_of_walk, straight_way
from mimicbench.references.locomotion.walking import FPS, Excerpt, Walk, walk

BODIES = (unihsi_body(1.08), roam_body(1.0), core4d_body(1.0))
LOW, HIGH, MARGIN = np.array([-0.3, -0.35]), np.array([0.3, 0.35]), 0.4
STOP, GOAL = np.array([0.45, 0.0]), np.array([0.75, 0.0])

bodies = st.integers(0, 2)  # not the bodies themselves: they are long to print


def around(body: Body, azimuth: float, distance: float, yaw: float, gait: Gait) -> Walk:
    start = distance * np.array([np.cos(azimuth), np.sin(azimuth)])
    return walk(body, around_box(start, GOAL, LOW, HIGH, MARGIN, start_yaw=yaw), yaw, STOP, 0.0, gait, 1.0)


def test_gait_by_hand():
    assert Gait(speed=0.5).period == 0.82 and Gait(speed=0.65).period == pytest.approx(0.8)
    assert Gait(speed=1.3).period == pytest.approx(0.8 * 0.5**0.45)
    assert Gait(speed=0.65).overlap == pytest.approx(0.22) and Gait(speed=1.3).overlap == pytest.approx(0.155)
    assert Gait(speed=0.65).swing_time == pytest.approx(0.8 * 0.78)


def test_a_foot_pitched_by_hand():
    body = unihsi_body()  # ankle 0.05 over the sole, toe 0.1335 in front of it, heel 0.0435 behind it
    quarter = np.array(np.pi / 2)
    on_toes = rolled(
        body, quarter, np.array(0.0), np.array(0.0)
    )  # the ankle is then 0.1335 above the toe and 0.05 in front of it
    assert on_toes == pytest.approx([0.1335 + 0.05, 0.0, 0.1335 - 0.05])
    on_heel = rolled(body, -quarter, np.array(np.pi / 2), np.array(1.0))  # foot to the left
    assert on_heel == pytest.approx([0.0, -0.0435 - 0.05, 0.0435 - 0.05], abs=1e-12)


@settings(max_examples=30, deadline=None)
@given(st.floats(-2, 2), st.floats(-3, 3), st.floats(0.1, 1.0), st.booleans())
def test_eased_values_begin_as_asked_and_join(first: float, rate: float, lasts: float, forward: bool):
    values = np.sin(np.arange(60) / 30)
    eased = ease(values, first, rate, 30.0, lasts, forward)
    assert eased[0] == pytest.approx(first)
    joined = int(np.ceil(lasts * 30))
    assert eased[joined:] == pytest.approx(values[joined:])
    fine = ease(np.zeros(2000), first, rate, 1000.0, lasts, forward)
    assert (fine[1] - fine[0]) * 1000 == pytest.approx(rate, abs=0.05 * (1 + abs(rate) + abs(first)) / lasts)


@settings(max_examples=12, deadline=None)
@given(bodies, st.floats(0.5, 1.3), st.floats(-1.7, 1.7), st.floats(1.1, 2.2), st.floats(-3.1, 3.1))
@example(2, 1.28125, 1.5, 1.875, 1.25)  # a quick walk that turns: the pelvis's own lean once left the knee at 6 degrees
def test_feet_roll_without_sliding_and_legs_reach(
    which: int, speed: float, azimuth: float, distance: float, yaw: float
):
    body = BODIES[which]
    way = around(body, azimuth, distance, yaw, Gait(speed=speed))
    motion = clip_of_walk(body, way)
    pos, quat = motion.forward_kinematics()
    for side, leg in enumerate(body.legs):
        assert pos[:, leg.end] == pytest.approx(way.feet.pos_w[:, side], abs=1e-6)  # never out of the leg's reach
        points, stands = bearing_points(body, pos, quat, side), way.feet.contact[:, side]
        assert stance_slides(points, stands).max() < 1e-6
        assert points[..., 2].min() > -1e-6 and points[stands][..., 2].min(-1).max() < 1e-6
        knee = rot.to_rotvec(motion.local_quat[:, leg.middle])[:, 1]
        assert knee.min() > np.deg2rad(2.5)  # those of people are straight to within 3 to 4 degrees
    assert np.linalg.norm(np.diff(pos, 2, axis=0), axis=-1).max() * FPS < 2.5


@pytest.mark.parametrize("body", BODIES, ids=lambda body: body.skeleton.name)
def test_heel_lands_first_and_rises_before_the_toes(body: Body):
    gait = Gait(speed=0.7)
    way = straight_way(body, gait, 5.0)
    steps = way.steps
    for i in range(3, len(steps.side) - 3):
        side = steps.side[i]

        def pitch(moment: float, side: int = side) -> float:
            return float(np.interp(moment, way.time, way.feet.pitch[:, side]))

        assert pitch(steps.touch_down[i]) < -0.15 and pitch(steps.lift_off[i]) > 0.25
        cycle = 2 * gait.period
        assert (
            -0.1 < pitch(steps.touch_down[i] + 0.13 * cycle) < -0.04
            and abs(pitch(steps.touch_down[i] + 0.27 * cycle)) < 0.01
        )
    bend = way.feet.toe_bend
    assert (
        bend is not None
        and bend.min() >= 0
        and bend[way.feet.contact] == pytest.approx(np.maximum(way.feet.pitch, 0)[way.feet.contact])
    )


@pytest.mark.parametrize("speed", [0.5, 0.65, 0.85, 1.0, 1.3])
def test_speed_cadence_and_pelvis_are_as_people_walk(speed: float):
    body, gait = BODIES[0], Gait(speed=speed)
    way = straight_way(body, gait, 8.0)
    steady = slice(int(0.35 * len(way.time)), int(0.65 * len(way.time)))
    pelvis = way.pelvis_pos_w[steady]
    assert np.diff(pelvis[:, 0]).mean() * FPS == pytest.approx(speed, rel=0.12)
    assert 0.004 < np.ptp(pelvis[:, 2]) < 0.06  # 2 to 5 cm at usual speeds, less when slow
    spectrum = np.abs(np.fft.rfft((pelvis[:, 2] - pelvis[:, 2].mean()) * np.hanning(len(pelvis)), 4096))
    assert np.argmax(spectrum) * FPS / 4096 == pytest.approx(1 / gait.period, rel=0.12)  # up and down with every step
    turn = np.rad2deg(way.twist[steady])
    assert 3 < np.ptp(turn) < 14  # 2 to 7 degrees to either side
    assert (way.twist * way.ahead).max() <= 0  # the side of the leading leg comes forward
    # the pelvis is tilted back and the chest bent forward over it, until the person has come to stand
    assert np.deg2rad(-8) < way.bend[steady].mean() < np.deg2rad(-4) and way.bend[-1] == 0 == way.stoop[-1]
    assert np.deg2rad(4) < way.stoop[steady].mean() < np.deg2rad(9)


@settings(max_examples=40, deadline=None)
@given(st.floats(-1.75, 1.75), st.floats(0.0, 1.0), st.floats(-3.1, 3.1), st.floats(-1.5, 1.5))
def test_curved_route_keeps_clear_and_leaves_along_the_heading(
    azimuth: float, extra: float, yaw: float, goal_yaw: float
):
    start = (1.1 + extra) * np.array([np.cos(azimuth), np.sin(azimuth)])
    route = around_box(start, GOAL, LOW, HIGH, MARGIN, yaw, np.pi + goal_yaw)
    points = np.array([route.at(s)[0] for s in np.linspace(0, route.length, 200)])
    gap = np.linalg.norm(np.maximum(np.maximum(LOW - points, points - HIGH), 0), axis=-1)
    assert gap.min() >= MARGIN - 0.012 and points[0] == pytest.approx(start) and points[-1] == pytest.approx(GOAL)
    shortest = around_box(start, GOAL, LOW, HIGH, MARGIN)
    assert shortest.length - 1e-9 <= route.length < 1.35 * shortest.length + 0.05
    again = around_box(start, GOAL, LOW, HIGH, MARGIN, yaw, np.pi + goal_yaw)
    assert again.points.tobytes() == route.points.tobytes()


def test_curved_route_by_hand():
    start, goal = np.array([3.0, 0.0]), np.array([1.0, 0.0])
    route = around_box(start, goal, LOW, HIGH, MARGIN, start_yaw=np.pi - 0.8)
    assert route.at(0.0)[1] == pytest.approx(np.pi - 0.8, abs=0.15) and route.points[:, 1].max() > 0.05
    assert np.abs(np.diff(np.unwrap([route.at(s)[1] for s in np.linspace(0, route.length - 1e-3, 100)]))).max() < 0.35
    assert len(around_box(start, goal, LOW, HIGH, MARGIN, start_yaw=0.0).points) == 2  # turns on the spot instead
    assert route.after(0.0) == pytest.approx(route.points) and route.after(route.length)[-1] == pytest.approx(goal)


def test_a_walk_begins_in_its_midst():
    whole, cut = around(BODIES[2], 0.8, 1.6, 2.0, Gait()), None
    start = 1.6 * np.array([np.cos(0.8), np.sin(0.8)])
    route = around_box(start, GOAL, LOW, HIGH, MARGIN, start_yaw=2.0)
    cut = walk(BODIES[2], route, 2.0, STOP, 0.0, Gait(), 1.0, Excerpt(lead=3.0))
    assert len(cut.time) == len(whole.time) - 90 and cut.time[0] == 0 and cut.end == pytest.approx(whole.end - 3.0)
    assert (cut.pelvis_pos_w == whole.pelvis_pos_w[90:]).all() and (cut.feet.pos_w == whole.feet.pos_w[90:]).all()
    assert np.linalg.norm(cut.pelvis_pos_w[1] - cut.pelvis_pos_w[0]) * FPS > 0.1
    long = walk(BODIES[2], route, 2.0, STOP, 0.0, Gait(), 1.0, Excerpt(duration=20.0, lead=1.5))
    assert len(long.time) == 601


def check_continues(body: Body, way: Walk, frame: int, state: BodyState) -> None:
    finished = state.place[0] < GOAL[0] + 0.02 and abs(state.place[1]) < 0.4  # what is left is the turn
    route = (
        Route(np.stack([state.place, state.place + 1e-6]))
        if finished
        else around_box(state.place, GOAL, LOW, HIGH, MARGIN)
    )
    new = walk_from(body, state, route, STOP, 0.0, Gait(speed=0.65), 1.0)
    (pos, quat), (pos_new, quat_new) = (
        clip_of_walk(body, way).forward_kinematics(),
        clip_of_walk(body, new).forward_kinematics(),
    )
    lower = [body.pelvis, *(joint for leg in body.legs for joint in leg)]
    assert np.linalg.norm(pos[frame] - pos_new[0], axis=-1)[lower].max() < 0.01
    assert rot.angle_between(quat[frame], quat_new[0])[lower].max() < 0.02
    velocity, velocity_new = (pos[frame + 1, 0] - pos[frame, 0]) * FPS, (pos_new[1, 0] - pos_new[0, 0]) * FPS
    assert np.linalg.norm(velocity - velocity_new) < 0.1
    assert np.linalg.norm(np.diff(pos_new, 2, axis=0), axis=-1).max() * FPS < 2.5
    for side in (0, 1):
        points, stands = bearing_points(body, pos_new, quat_new, side), new.feet.contact[:, side]
        assert points[..., 2].min() > -0.003 and stance_slides(points, stands).max() < 0.005
    assert (
        new.feet.pos_w[-1, :, :2].mean(0) == pytest.approx(STOP, abs=0.03) and abs(rot.wrap_angle(new.yaw[-1])) < 0.06
    )


@settings(max_examples=15, deadline=None)
@given(bodies, st.floats(-1.7, 1.7), st.floats(1.1, 2.2), st.floats(-3.1, 3.1), st.floats(0, 1), st.booleans())
def test_walks_go_on_from_any_frame(which: int, azimuth: float, distance: float, yaw: float, share: float, seen: bool):
    body = BODIES[which]
    way = around(body, azimuth, distance, yaw, Gait(speed=0.65))
    frame = 1 + int(share * (len(way.time) - 4))
    check_continues(
        body, way, frame, state_of_motion(clip_of_walk(body, way), frame) if seen else state_of_walk(way, frame)
    )


def test_state_of_a_clip_is_that_of_its_walk():
    body = BODIES[1]
    way = around(body, 1.0, 2.0, 1.0, Gait(speed=0.65))
    for frame in (20, 50, 77, 101):
        walked, seen = state_of_walk(way, frame), state_of_motion(clip_of_walk(body, way), frame)
        assert (
            seen.feet.pos_w == pytest.approx(walked.feet.pos_w, abs=1e-6)
            and (seen.feet.bears == walked.feet.bears).all()
        )
        assert seen.feet.pitch == pytest.approx(walked.feet.pitch, abs=1e-6) and np.cos(
            seen.yaw - walked.yaw
        ) == pytest.approx(1)
        assert seen.pelvis_vel_w == pytest.approx(walked.pelvis_vel_w, abs=1e-6) and seen.roll == pytest.approx(
            walked.roll, abs=1e-6
        )
        assert np.minimum(seen.since, 1) == pytest.approx(np.minimum(walked.since, 1), abs=0.51 / FPS)
    unlabeled = HumanMotion(
        "bare", "none", body.skeleton, FPS, way.pelvis_pos_w, clip_of_walk(body, way).local_quat, "none"
    )
    with pytest.raises(BadMotion, match="contact labels"):
        state_of_motion(unlabeled, 3)


def test_a_plan_takes_milliseconds():
    body, gait = BODIES[0], Gait(speed=0.65)
    way = around(body, 1.2, 1.8, 0.5, gait)
    state = state_of_walk(way, 60)
    route = around_box(state.place, GOAL, LOW, HIGH, MARGIN)
    spent = []
    for _ in range(5):
        begin = time.process_time()
        walk_from(body, state, route, STOP, 0.0, gait, 1.0)
        spent.append(time.process_time() - begin)
    assert min(spent) < 3.0 * pace.unit()
