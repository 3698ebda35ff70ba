"""What episodes come to, on made-up traces of placed robots: who stays, who falls, when, and in what."""

from dataclasses import replace

import numpy as np
import pytest
import torch

import stool
from mimicbench.core import rotations as rot
from mimicbench.envs.metrics import PHASES, EpisodeMetrics
from mimicbench.objects.registry import FAMILIES
from mimicbench.robots.registry import ROBOTS
from mimicbench.sim.native import NativePhysics
from mimicbench.sim.physics import ObjectState, RobotState
from mimicbench.sim.rows import Rows
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.registry import TASKS
from stool import H1, block, seated, standing

SIT_CHAIR = TASKS.get("sit-chair")
STAND, JOINTS = standing()
SIT, SITTING = seated(0.42)
FAR, NEAR = STAND, np.array([-0.5, 0.0, STAND[2]])
HIGH = np.array([0.0, 0.0, STAND[2]])
LYING = rot.from_rotvec(np.array([0.0, 1.5, 0.0]))


class Trace:
    """One robot beside a stool, and what the metrics make of the poses that it is shown in."""

    def __init__(self, envs=1, task=SIT_CHAIR, obj=None, control_dt=CONTROL_DT):
        self.physics = NativePhysics(H1, [obj or block()] * envs, workers=1)
        self.metrics = EpisodeMetrics(task, H1, self.physics, control_dt)
        stool.place(self.physics, STAND, JOINTS)
        self.metrics.begin(Rows.every(envs), torch.full((envs, 2, 3), torch.nan), self.physics.state().root_pos_w)

    def show(self, frames, pos, joints=JOINTS, quat=rot.IDENTITY, turning=0.0):
        """Some control steps in one pose, `turning` about the vertical [rad/s]."""
        for _ in range(frames):
            stool.put(
                self.physics, [0], pos[None], quat[None], joints[None], root_ang_vel_b=np.array([[0.0, 0.0, turning]])
            )
            self.metrics.update(self.physics.links())

    def move(self, frames, pos, obj_pos):
        """Some control steps in one pose beside an object that was moved to `obj_pos` [m]."""
        still, upright = torch.zeros(1, 3), torch.tensor(rot.IDENTITY[None])
        robot = RobotState.of(pos[None], rot.IDENTITY[None], JOINTS[None])
        self.physics.reset(
            Rows.every(1), robot, ObjectState(torch.tensor(np.array(obj_pos)[None]), upright, still, still)
        )
        for _ in range(frames):
            self.metrics.update(self.physics.links())

    def fall(self):
        """On the floor."""
        self.show(1, np.array([-1.0, 0.0, 0.2]), quat=LYING)

    def phase(self):
        found = self.metrics.verdict()
        return PHASES[int(found.fell_phase[0])], float(found.fell_time[0])


def test_who_sits_in_the_last_three_tenths_of_a_second_stays():
    trace = Trace()
    trace.show(10, FAR)
    assert not trace.metrics.stays.any()
    trace.show(14, SIT, SITTING)
    assert not trace.metrics.stays.any(), "0.28 s"
    trace.show(1, SIT, SITTING)
    assert trace.metrics.stays.all() and trace.metrics.success.all()
    trace.show(1, FAR)
    assert not trace.metrics.stays.any() and trace.metrics.success.all(), "who gets up has succeeded, but does not stay"
    trace.show(15, SIT, SITTING)
    assert trace.metrics.stays.all()


def test_who_fell_does_not_stay_even_back_on_the_seat():
    trace = Trace()
    trace.fall()
    trace.show(20, SIT, SITTING)
    found = trace.metrics.verdict()
    assert found.fell.all() and found.success.all() and found.success_at_end.all() and not found.stays.any()


@pytest.mark.parametrize("task", ["touch-points", "lift-box"])
def test_who_bends_down_has_not_fallen_and_who_sinks_down_has(task):
    """A root at 0.6 of its height is as low as people bend; below 0.45 of it the robot is on the floor."""
    obj = replace(block(), seat_height=None)
    for height, quat, fallen in ((0.6, LYING, False), (0.46, rot.IDENTITY, False), (0.44, rot.IDENTITY, True)):
        trace = Trace(task=TASKS.get(task), obj=obj)
        trace.show(3, np.array([*FAR[:2], height * STAND[2]]), quat=quat)
        assert bool(trace.metrics.verdict().fell[0]) == fallen, (height, quat)


@pytest.mark.parametrize(
    ("before", "phase"),
    [
        (dict(pos=FAR), "walking"),
        (dict(pos=FAR, turning=0.7), "turning"),
        (dict(pos=FAR, turning=0.5), "walking"),
        (dict(pos=NEAR), "acting"),
        (dict(pos=NEAR, turning=0.7), "turning"),
        (dict(pos=NEAR - [0, 0, 0.2], turning=0.7), "acting"),
        (dict(pos=SIT, joints=SITTING), "after success"),
        # 0.35 m from the rectangle of the stool, on all sides and at its corner
        (dict(pos=HIGH + [-0.59, 0, 0]), "acting"),
        (dict(pos=HIGH + [-0.61, 0, 0]), "walking"),
        (dict(pos=HIGH + [0.59, 0, 0]), "acting"),
        (dict(pos=HIGH + [0.61, 0, 0]), "walking"),
        (dict(pos=HIGH + [0, -0.59, 0]), "acting"),
        (dict(pos=HIGH + [0, -0.61, 0]), "walking"),
        (dict(pos=HIGH + [0, 0.59, 0]), "acting"),
        (dict(pos=HIGH + [0, 0.61, 0]), "walking"),
        (dict(pos=HIGH + [0.45, 0.45, 0]), "acting"),
        (dict(pos=HIGH + [0.55, 0.55, 0]), "walking"),
        # who is below 0.92 of the height at the start goes down, however it turns
        (dict(pos=NEAR * [1, 1, 0.93], turning=0.7), "turning"),
        (dict(pos=NEAR * [1, 1, 0.91], turning=0.7), "acting"),
    ],
)
def test_when_and_in_what_a_robot_fell(before, phase):
    trace = Trace()
    trace.show(40, **before)
    trace.fall()
    assert trace.phase() == (phase, pytest.approx(41 * CONTROL_DT))
    trace.show(10, SIT, SITTING)
    trace.fall()
    assert trace.phase() == (phase, pytest.approx(41 * CONTROL_DT)), "the first fall counts"


@pytest.mark.parametrize("moved", [False, True])
@pytest.mark.parametrize(
    ("x", "y", "phase"),
    [
        (-0.19, 0.3, "acting"),
        (-0.21, 0.3, "walking"),
        (0.99, 0.3, "acting"),
        (1.01, 0.3, "walking"),
        (0.4, -0.29, "acting"),
        (0.4, -0.31, "walking"),
        (0.4, 0.89, "acting"),
        (0.4, 0.91, "walking"),
    ],
)
def test_near_is_near_the_object_wherever_it_is(x, y, phase, moved):
    """A stool around (0.4, 0.3), built there or moved there, is from 0.15 to 0.65 and 0.05 to 0.55; near is 0.35 m."""
    there = np.array([0.4, 0.3, 0.0])
    pos = np.array([x, y, STAND[2]])
    if moved:
        trace = Trace(task=TASKS.get("lift-box"), obj=replace(block(movable=True, mass=2.0), seat_height=None))
        trace.move(40, pos, there)
    else:
        trace = Trace(obj=replace(block(), box_pos=block().box_pos + there))
        trace.show(40, pos)
    trace.fall()
    assert trace.phase()[0] == phase


def test_who_swings_a_leg_does_not_turn():
    """The hips turn at 1 rad/s, the root does not."""
    trace = Trace()
    swing = np.zeros((1, 19))
    swing[0, [stool.JOINT["left_hip_yaw"], stool.JOINT["right_hip_yaw"]]] = 1.0
    stool.put(trace.physics, [0], FAR[None], rot.IDENTITY[None], JOINTS[None], joint_vel=swing)
    assert float(trace.physics.links().ang_vel_w[0, 1, 2]) == pytest.approx(1.0)
    for _ in range(40):
        trace.metrics.update(trace.physics.links())
    trace.fall()
    assert trace.phase()[0] == "walking"


def test_who_lifts_a_thigh_does_not_lean():
    """The first link of a G1 after its root is a thigh, level here: 1.57 rad is more than a root may lean."""
    g1 = ROBOTS.get("g1")
    joints = np.zeros(len(g1.joint_names))
    joints[0] = -np.pi / 2
    physics = NativePhysics(g1, [block()], workers=1)
    metrics = EpisodeMetrics(SIT_CHAIR, g1, physics, CONTROL_DT)
    stool.place(physics, np.array([-1.0, 0.0, 0.7]), joints)
    metrics.begin(Rows.every(1), torch.full((1, 2, 3), torch.nan), physics.state().root_pos_w)
    thigh = physics.links().quat_w[0, 1].numpy()
    assert rot.rotate(thigh, np.array([0.0, 0.0, 1.0]))[2] == pytest.approx(0.0, abs=1e-6)
    metrics.update(physics.links())
    assert not metrics.verdict().fell[0]


@pytest.mark.parametrize(
    ("height", "lean", "fallen"),
    [
        (0.42 - 0.14, (0, 0, 0), False),
        (0.42 - 0.16, (0, 0, 0), True),
        (0.9, (1.19, 0, 0), False),
        (0.9, (1.21, 0, 0), True),
        (0.9, (0, 1.19, 0), False),
        (0.9, (0, -1.21, 0), True),
    ],
)
def test_who_is_far_below_the_seat_or_leans_too_far_has_fallen(height, lean, fallen):
    trace = Trace()
    trace.show(1, np.array([*SIT[:2], height]), quat=rot.from_rotvec(np.array(lean, float)))
    assert bool(trace.metrics.verdict().fell[0]) == fallen


@pytest.mark.parametrize(
    ("seat", "where", "height", "fallen"),
    [
        (0.24, FAR, 0.2, True),
        (0.24, SIT, 0.2, False),
        (0.24, FAR, 0.26, False),
        (0.6, FAR, 0.46, False),
        (0.55, FAR, 0.44, True),
        (0.55, SIT, 0.44, False),
    ],
)
def test_who_is_on_the_floor_beside_a_low_seat_has_fallen(seat, where, height, fallen):
    """Lower than the seat and than 0.45 of the height at the start, which is 1 m; above the seat, 0.15 m below it."""
    trace = Trace(obj=block(seat))
    trace.show(1, np.array([*where[:2], height * STAND[2]]))
    assert bool(trace.metrics.verdict().fell[0]) == fallen


def test_when_k_was_fulfilled_and_what_effort_counts():
    """By hand: 10 steps of walking, and the hold time of sitting; later effort is none of P's."""
    trace = Trace()
    trace.show(10, FAR)
    trace.metrics.max_effort += 7.0
    hold = SIT_CHAIR.hold_frames(1 / CONTROL_DT)
    trace.show(hold - 1, SIT, SITTING)
    assert not trace.metrics.success.any() and trace.metrics.effort().tolist() == [7.0]
    trace.show(5, SIT, SITTING)
    found = trace.metrics.verdict()
    assert found.first_success.tolist() == pytest.approx([(10 + hold) * CONTROL_DT])
    assert found.steps.tolist() == [10 + hold + 4]
    trace.metrics.max_effort += 5.0
    trace.show(1, FAR)
    found = trace.metrics.verdict()
    assert found.effort.tolist() == [7.0] and found.success.all() and not found.success_at_end.any()
    assert trace.metrics.over().all() and found.first_success.tolist() == pytest.approx([(10 + hold) * CONTROL_DT])


@pytest.mark.parametrize("control_dt", [0.02, 0.05])
def test_a_fall_began_half_a_second_before(control_dt):
    """Who walks, then turns for the last 0.4 s before it lies, fell while walking; after 0.6 s, while turning."""
    for seconds, phase in ((0.4, "walking"), (0.6, "turning")):
        trace = Trace(control_dt=control_dt)
        trace.show(40, FAR)
        trace.show(round(seconds / control_dt), FAR, turning=1.0)
        trace.fall()
        assert trace.phase()[0] == phase


def test_a_fall_began_in_the_frame_before_where_frames_last_half_a_second():
    trace = Trace(control_dt=0.5)
    trace.show(3, FAR)
    trace.show(1, FAR, turning=1.0)
    trace.fall()
    assert trace.phase() == ("turning", pytest.approx(2.5))


def test_whose_root_is_at_the_limit_has_not_fallen():
    """A root 0.15 m below a seat at 0.65 m is at 0.5 m, to the last bit."""
    for height, fallen in ((0.5, False), (np.nextafter(np.float32(0.5), np.float32(0.0)), True)):
        trace = Trace(obj=block(0.65))
        trace.show(1, np.array([*FAR[:2], height]))
        assert float(trace.physics.links().pos_w[0, 0, 2]) == height
        assert bool(trace.metrics.verdict().fell[0]) == fallen


def test_what_was_seen_is_taken_up():
    """Half a second ago it walked, and it has had an effort of 7: another judge that is told so says so."""
    trace, other = Trace(), Trace()
    trace.show(40, FAR)
    trace.show(20, FAR, turning=1.0)
    trace.metrics.max_effort += 7.0
    other.metrics.load_state_tensors(trace.metrics.state_tensors())
    for judged in (trace, other):
        judged.show(3, FAR, turning=1.0)
        judged.fall()
        assert judged.phase() == ("walking", pytest.approx(64 * CONTROL_DT))
        assert judged.metrics.effort().tolist() == [7.0] and judged.metrics.verdict().steps.tolist() == [64]


def test_who_holds_a_box_at_once_stays_only_after_three_tenths_of_a_second():
    """K of lift-box asks for one frame; staying for 15 of 0.02 s. Wrists are within the box, which is 0.2 m up."""
    trace = Trace(task=TASKS.get("lift-box"), obj=replace(block(1.8, 0.6, movable=True, mass=2.0), seat_height=None))
    trace.move(14, FAR, [*FAR[:2], 0.21])
    assert trace.metrics.success.all() and not trace.metrics.stays.any()
    trace.move(1, FAR, [*FAR[:2], 0.21])
    assert trace.metrics.stays.all()
    trace.move(1, FAR, [*FAR[:2], 0.19])
    assert not trace.metrics.success.any() and not trace.metrics.stays.any()


def test_who_falls_at_once_was_walking():
    trace = Trace()
    trace.fall()
    assert trace.phase() == ("walking", pytest.approx(CONTROL_DT))


def test_another_episode_forgets_the_last_one():
    trace = Trace(2)
    trace.show(20, SIT, SITTING)
    trace.fall()
    before = {name: value.clone() for name, value in vars(trace.metrics.verdict()).items()}
    assert before["fell"][0] and before["success"][0] and before["effort"].shape == (2,)
    trace.metrics.max_effort += 5.0
    stool.put(trace.physics, [0], STAND[None], rot.IDENTITY[None], JOINTS[None])
    trace.metrics.begin(Rows.of([0], 2), torch.full((1, 2, 3), torch.nan), trace.physics.state().root_pos_w)
    found = trace.metrics.verdict()
    assert (found.effort.tolist(), found.steps.tolist()) == ([0.0, 5.0], [0, 21])
    assert not found.success[0] and not found.fell[0] and torch.isnan(found.first_success[0])
    assert torch.isnan(found.fell_time[0]) and found.fell_phase[0] == 0
    trace.fall()
    assert trace.phase() == ("walking", pytest.approx(CONTROL_DT)), "nothing of the last episode's phases is left"


class Awaited(NativePhysics):
    """Physics as on a GPU, whose tensors stay tensors."""

    asynchronous = True


@pytest.mark.parametrize("task", TASKS.names())
def test_arrays_and_tensors_come_to_the_same(task):
    """On the CPU NumPy works it out, on a GPU torch: to the last bit, whoever falls, goes on or begins anew."""
    task, random = TASKS.get(task), np.random.default_rng(0)
    objects = [FAMILIES.get(task.family).make(index, 0) for index in range(6)]
    both = [kind(H1, objects, workers=1) for kind in (NativePhysics, Awaited)]
    judges = [EpisodeMetrics(task, H1, physics, CONTROL_DT) for physics in both]
    goals = torch.from_numpy(random.normal([-0.7, 0.0, 1.0], 0.3, (6, 2, 3)))
    goals[0] = torch.nan
    for step in range(60):
        some = torch.from_numpy(random.random(6) < (1.0 if step == 0 else 0.05))
        pos = random.normal([-0.5, 0.0, 0.9], [0.5, 0.3, 0.2], (6, 3))
        quat, joints = rot.from_rotvec(random.normal(0.0, 0.3, (6, 3))), random.normal(JOINTS, 0.2, (6, 19))
        active = None if step % 3 == 0 else torch.from_numpy(random.random(6) < 0.9)
        for physics, judge in zip(both, judges, strict=True):
            rows = Rows.where(some, physics.asynchronous)
            if some.any():
                stool.put(physics, some.nonzero()[:, 0].tolist(), *(part[some.numpy()] for part in (pos, quat, joints)))
                judge.begin(rows, goals[rows.ids], physics.state().root_pos_w)
            physics.step(torch.from_numpy(joints.astype(np.float32)), True)
            judge.update(physics.links(), active)
        arrays, tensors = (judge.state_tensors() for judge in judges)
        for name, value in tensors.items():
            torch.testing.assert_close(arrays[name], value, rtol=0, atol=0, equal_nan=True, msg=name)
        assert judges[0].stays.tolist() == judges[1].stays.tolist()
