"""Plans tried out in the mind: what goes wrong there is not done."""

from dataclasses import replace

import numpy as np
import pytest

from learning import ROBOT
from mimicbench.benchmark.shipped import SHIPPED
from mimicbench.imitate.learners.online import OnlineConfig
from mimicbench.imitate.online.planning import Planning, from_standing
from mimicbench.imitate.online.rehearsal import choose, rehearse, room, strayed
from mimicbench.objects.registry import FAMILIES
from mimicbench.tasks.registry import TASKS
from mimicbench.track.checkpoint import load_tracker

TASK = TASKS.get("sit-chair")
NOTHING = np.zeros((0, 3))


@pytest.fixture(scope="module")
def plans():
    """How to sit down on a chair from 2 m in front of it, in some styles."""
    goal = TASK.goal.describe(FAMILIES.get("chair").make(0, 0))
    goal[:2] = 0.0
    begin = from_standing(ROBOT, np.array([2.0, 0.3, np.pi]), np.array(ROBOT.rest_pose))
    return Planning(ROBOT, TASK, OnlineConfig("optimization", tries=8, rehearsals=2)).plans(goal, NOTHING, begin, 0)


def beside(plan):
    """The same plan, 60 cm beside the chair."""
    return replace(plan, motion=replace(plan.motion, root_pos_w=plan.motion.root_pos_w + [0.0, 0.6, 0.0]))


def test_as_many_are_planned_as_are_to_be_rehearsed(plans):
    assert len(plans) == 2
    assert np.abs(plans[0].motion.joint_pos[-1] - plans[1].motion.joint_pos[-1]).max() > 0.05, "in another style"


def test_the_plan_that_goes_well_is_followed(plans):
    tracker = load_tracker(SHIPPED / "sit-chair" / "tracker", ROBOT)
    good = plans[0]
    (stays, success, roomy, effort), badly = rehearse(tracker, ROBOT, TASK, [good, beside(good)])
    assert stays and success and roomy == 0.0 and -1e8 < effort < 0
    assert badly[:2] == (False, False)
    found = [[beside(good), good], [good, beside(good)], [beside(good)]]
    chosen = choose(tracker, ROBOT, TASK, found)
    assert chosen[0] is good and chosen[1] is good
    assert chosen[2] is found[2][0], "who has but one plan takes it"


def test_of_two_that_stay_the_one_with_room_and_then_with_less_effort_is_followed(plans):
    tracker = load_tracker(SHIPPED / "sit-chair" / "tracker", ROBOT)
    worth = rehearse(tracker, ROBOT, TASK, plans, 0.1)
    assert all(stays and 0.0 <= roomy <= 0.1 for stays, _, roomy, _ in worth)
    assert any(roomy for _, _, roomy, _ in worth)
    for most in (0.0, 0.1):
        (chosen,) = choose(tracker, ROBOT, TASK, [plans], most)
        assert chosen is plans[max(range(len(plans)), key=lambda i: worth[i][2:] if most else worth[i][3])]


def test_room_is_what_k_can_lose(plans):
    """Of a chair with its seat at H: the pelvis is to be in the rectangle of the chair, from H to H + 0.27 m."""
    motion, chair = plans[0].motion, plans[0].stand_in
    (low, high), seat = np.array(chair.bounds())[:, :2], chair.seat_height
    end = np.concatenate([motion.root_pos_w[-1], motion.root_quat_w[-1], motion.joint_pos[-1]])

    def with_pelvis_at(x, y, height):
        end[:3] = x, y, seat + height
        return room(TASK, ROBOT, motion, chair, end)

    x, y = (low + high) / 2
    assert with_pelvis_at(x, y, 0.07) == pytest.approx(0.07), "above the seat"
    assert with_pelvis_at(x, y, 0.25) == pytest.approx(0.02), "below what is too high"
    assert with_pelvis_at(x, y, 0.30) == pytest.approx(-0.03), "too high"
    assert with_pelvis_at(high[0] - 0.04, y, 0.1) == pytest.approx(0.04), "within the front edge"
    assert with_pelvis_at(high[0] + 0.03, high[1] + 0.04, 0.1) == pytest.approx(-0.05), "off a corner"


def test_how_far_somebody_strayed(plans):
    motion = plans[0].motion
    there = np.concatenate([motion.root_pos_w[-1], motion.root_quat_w[-1], motion.joint_pos[-1]])
    assert strayed(ROBOT, motion, there) < 1e-9
    away = there.copy()
    away[:3] += [0.3, 0.0, -0.4]
    assert strayed(ROBOT, motion, away) == pytest.approx(0.5)
    leg = there.copy()
    leg[7 + ROBOT.joint_names.index("left_knee_joint")] += 0.5
    by_hand = 2 * 0.4 * np.sin(0.25)  # the ankle is 0.4 m below the knee
    assert strayed(ROBOT, motion, leg) == pytest.approx(by_hand, abs=0.01)
