"""Goals of all tasks: their numbers for known objects, what moves them, and what is said about missed ones."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from mimicbench.core.errors import BadObject
from mimicbench.objects.families.chair import make_chair
from mimicbench.objects.registry import FAMILIES
from mimicbench.objects.shape import SceneObject
from mimicbench.objects.symmetry import MOTIONS, symmetries
from mimicbench.tasks.goal import Field, GoalSpec
from mimicbench.tasks.lift_box import WIDEST
from mimicbench.tasks.registry import TASKS
from mimicbench.tasks.task import BodyPoints, ObjectInfo
from stool import block

FOUND = [task for task in TASKS.all() if not task.goal.given]
MIXED = GoalSpec(
    (
        Field("grip", "point", 0.01, 0.1),
        Field("size", "scalar", 0.02, 0.05, 0.4),
        Field("front", "direction", 0.03, 0.4),
        Field("middle", "place", 0.04, 0.1),
    ),
    None,
)
METERS = st.floats(-3, 3)
ANGLES = st.floats(-math.pi, math.pi)


def bed(head_xy, size=(2.0, 1.6, 0.5)):
    return SceneObject(
        "bed-x",
        "bed",
        "bed",
        np.array([[0.0, 0.0, size[2] / 2]]),
        np.array([[1.0, 0, 0, 0]]),
        np.array([size]) / 2,
        np.full((1, 3), 0.5),
        seat_height=size[2],
        seat_polygon=np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.array(size[:2]) / 2,
        head_xy=np.array(head_xy, float),
    )


def test_a_seat():
    goal = TASKS.get("sit-chair").goal
    assert goal.columns == {"middle": (0, 1), "front": (2, 3), "height": (4,), "depth": (5,)}
    assert goal.size == 6 and goal.memory_size == 10 and goal.where == (0, 1)
    # a block is the same from all four sides
    assert goal.label(block(0.5, 0.25)).tolist() == [
        [0, 0, 0, 1, 0.5, 0.5],
        [0, 0, 1, 0, 0.5, 0.5],
        [0, 0, 0, -1, 0.5, 0.5],
        [0, 0, -1, 0, 0.5, 0.5],
    ]
    middle, spread = goal.middle_and_spread()
    torch.testing.assert_close(middle, torch.tensor([0, 0, 0, 0, 0.45, 0.45]))
    torch.testing.assert_close(spread, torch.tensor([0.1, 0.1, 0.4, 0.4, 0.05, 0.06]))


def test_a_berth():
    goal = TASKS.get("lie-bed").goal
    # the head goes to -x, nearer to that end than to any side, and nothing tells this end from the other
    answers = goal.label(bed((-0.8, 0.3))).tolist()
    assert answers == [[0, 0, 0, 1, 0, -1, 0.5, 2.0, 1.6], [0, 0, 0, -1, 0, 1, 0.5, 2.0, 1.6]]
    # beside it a front that is not on the line of the head: both ends and both sides are anybody's guess
    assert len(goal.label(bed((0.1, 0.7), (0.8, 1.9, 0.4)))) == 4
    with pytest.raises(BadObject, match="where the head goes"):
        goal.label(bed(()))
    along_y = goal.label(bed((0.1, 0.7), (0.8, 1.9, 0.4)))[0]
    np.testing.assert_allclose(along_y, [0, 0, 0, 1, 1, 0, 0.4, 1.9, 0.8])


def test_a_box():
    task = TASKS.get("lift-box")
    box = FAMILIES.get("box").make(0, 0)
    answers = task.goal.label(box)
    low, high = box.bounds()
    np.testing.assert_allclose(answers[0], [0, 0, 0, 1, *(high - low) / 2], atol=1e-9)
    np.testing.assert_allclose(answers[1:, 2:4], [[0, -1]], atol=1e-9)  # and turned by half a circle
    assert len(task.goal.label(block(0.4, 0.3))) == 4  # square


def test_a_box_is_taken_from_where_one_stands_if_it_is_narrow_enough():
    goal = TASKS.get("lift-box").goal
    seen = torch.tensor(
        [
            [1.0, 0.0, 1.0, 0.0, 0.27, 0.20, 0.4],  # its narrow side is to the left: 0.54 m can be clasped from here
            [1.0, 0.0, 1.0, 0.0, 0.31, 0.20, 0.4],  # 0.62 m cannot
            [1.0, 0.0, 0.0, -1.0, 0.27, 0.20, 0.4],  # its narrow side is ahead
            [0.0, -2.0, 0.6, 0.8, 0.25, 0.20, 0.3],  # to the right, its front 37 degrees to the left of +x
            [0.0, -2.0, 0.8, 0.6, 0.25, 0.20, 0.3],  # 53 degrees
        ]
    )
    turned = goal.taken(seen)
    torch.testing.assert_close(turned[0], torch.tensor([1.0, 0.0, 0.0, -1.0, 0.20, 0.27, 0.4]))
    torch.testing.assert_close(turned[3], torch.tensor([0.0, -2.0, 0.8, -0.6, 0.20, 0.25, 0.3]))
    torch.testing.assert_close(turned[[1, 2, 4]], seen[[1, 2, 4]])


@given(METERS, METERS, ANGLES, st.floats(0.1, 0.4), st.floats(0.1, 0.4))
@settings(deadline=None)
def test_a_box_is_taken_for_the_same_box(x, y, yaw, depth, width):
    goal = TASKS.get("lift-box").goal
    seen = torch.tensor([[x, y, math.sin(yaw), math.cos(yaw), depth, width, 0.4]])
    taken = goal.taken(seen)
    along = torch.tensor([math.cos(yaw), math.sin(yaw)]) * depth
    across = torch.tensor([-math.sin(yaw), math.cos(yaw)]) * width
    # the middles of the sides that are the front and the back, from the middle of the box
    front = taken[0, [3, 2]] * taken[0, 4]
    off = min(float((front - sign * side).norm()) for side in (along, across) for sign in (-1, 1))
    assert off < 1e-5 and sorted(taken[0, 4:6].tolist()) == sorted(seen[0, 4:6].tolist())
    assert taken[0, [0, 1, 6]].tolist() == seen[0, [0, 1, 6]].tolist()
    if not torch.equal(taken, seen):
        # the hands are no farther apart than anybody's, and who looks stands before the front rather than beside it
        assert 2 * taken[0, 5] <= WIDEST and float(-front @ seen[0, :2]) >= 0
        torch.testing.assert_close(goal.taken(taken), taken)


def test_targets_of_the_wrists_are_told():
    goal = TASKS.get("touch-points").goal
    assert goal.given and goal.size == 6 and goal.memory_size == 12
    targets = torch.arange(6.0).reshape(1, 2, 3)
    assert goal.told(targets).tolist() == [[0, 1, 2, 3, 4, 5]]
    # from one meter behind the origin, facing left: what is ahead in the world is to the right
    seen = goal.to_root(goal.told(targets), torch.tensor([[-1.0, 0.0]]), torch.tensor([math.pi / 2]))
    torch.testing.assert_close(seen, torch.tensor([[1.0, -1.0, 2.0, 4.0, -4.0, 5.0]]))


@pytest.mark.parametrize("task", FOUND, ids=lambda task: task.name)
def test_every_goal_found(task):
    objects = [FAMILIES.get(task.family).make(i, 0) for i in range(8)]
    answers = task.goal.labels(objects)
    assert answers.shape[0] == 8 and answers.shape[2] == task.goal.size and torch.isfinite(answers).all()
    torch.testing.assert_close(task.goal.normalized(answers), answers)
    middle, spread = task.goal.middle_and_spread()
    scalar = [c for field in task.goal.fields if field.kind == "scalar" for c in task.goal.columns[field.name]]
    off = (answers[..., scalar] - middle[scalar]).abs() / spread[scalar]
    assert off.mean() < 3, "a network's outputs are near 1"
    sides = [np.ptp(obj.corners().reshape(-1, 3)[:, :2], axis=0) for obj in objects]
    assert np.median(np.linalg.norm(sides, axis=-1)) < task.goal.window, "the window has room for the object"
    assert task.goal.window < 128 * task.map_cell


def test_symmetries():
    assert len(symmetries(block(0.5, 0.25))) == 8
    assert len(symmetries(bed((0, 0)))) == 4
    dining = next(chair for chair in map(make_chair, range(99)) if chair.kind == "dining")
    found = symmetries(dining)
    assert [motion.tolist() for motion in found] == [MOTIONS[0].tolist(), [[1, 0], [0, -1]]]
    # one that is mirrored only: what stands on one side cannot be turned away
    both = TASKS.get("sit-chair").goal.label(dining)
    assert len(both) == 1


@given(st.lists(METERS, min_size=8, max_size=8), ANGLES, METERS, METERS, ANGLES)
def test_odometry_carries_a_goal(numbers, front, x, y, yaw):
    """Remembered and carried is the same as seen from where the robot is now."""
    goal = torch.tensor([[*numbers[:4], math.sin(front), math.cos(front), *numbers[4:6]]], dtype=torch.float64)
    start, start_yaw = torch.tensor([numbers[6:8]], dtype=torch.float64), torch.tensor([0.7], dtype=torch.float64)
    moved, turned = torch.tensor([[x, y]], dtype=torch.float64), torch.tensor([yaw], dtype=torch.float64)
    cos, sin = start_yaw.cos(), start_yaw.sin()
    here = start + torch.stack([cos * x - sin * y, sin * x + cos * y], -1)
    seen = MIXED.to_root(goal, start, start_yaw)
    memory = MIXED.carried(seen, moved, turned)
    torch.testing.assert_close(memory[:, :8], seen)
    torch.testing.assert_close(MIXED.now(memory), MIXED.to_root(goal, here, start_yaw + turned))
    torch.testing.assert_close(MIXED.from_root(seen, start, start_yaw), goal)
    assert memory.shape == (1, MIXED.memory_size) == (1, 15)


def test_what_moves_and_what_does_not():
    goal = torch.tensor([[1.0, 0.0, 0.8, 0.4, 0.0, 1.0, 2.0, 0.0]])
    memory = MIXED.carried(goal, torch.tensor([[1.0, 0.0]]), torch.tensor([math.pi / 2]))
    # one meter ahead and turned left: what was two meters ahead is one meter to the right, what faced ahead faces right
    torch.testing.assert_close(
        memory, torch.tensor([[1, 0, 0.8, 0.4, 0, 1, 2, 0, 0, 0, 0.8, -1, 0, 0, -1.0]]), atol=1e-6, rtol=0
    )


def test_errors_are_as_large_as_told():
    goal = torch.tensor([[1.0, 0.0, 0.8, 0.4, 0.6, 0.8, 2.0, 0.0]]).expand(20_000, -1)
    seen = MIXED.disturbed(goal, torch.Generator().manual_seed(0))
    torch.testing.assert_close(
        seen[:, [0, 1, 2, 3, 6, 7]].std(0), torch.tensor([0.01, 0.01, 0.01, 0.02, 0.04, 0.04]), rtol=0.05, atol=0
    )
    torch.testing.assert_close(MIXED.normalized(seen), seen)
    assert MIXED.errors(seen, goal)["front"].pow(2).mean().sqrt() == pytest.approx(0.03, rel=0.05)
    assert torch.equal(seen, MIXED.disturbed(goal, torch.Generator().manual_seed(0)))


def test_the_nearest_of_several_answers():
    goal = TASKS.get("sit-chair").goal
    answers = goal.labels([block(0.5, 0.25)]).expand(2, -1, -1)
    seen = torch.tensor([[0.1, 0, -0.9, 0.2, 0.5, 0.5], [0.1, 0, 0.1, -0.8, 0.5, 0.5]])
    assert goal.nearest(seen, answers)[:, 2:4].tolist() == [[-1, 0], [0, -1]]
    # objects with fewer answers repeat them
    both = goal.labels([block(0.5, 0.25), make_chair(0)])
    assert both.shape == (2, 4, 6) and (both[1] == both[1, 0]).all()


def test_errors_in_words():
    goal = TASKS.get("sit-chair").goal
    truth = torch.tensor([1.0, 0, 0, 1, 0.5, 0.5])
    assert goal.in_words(truth, truth) == "right"
    seen = torch.tensor([1.03, 0.04, math.sin(0.35), math.cos(0.35), 0.5, 0.48])
    assert goal.in_words(seen, truth) == "middle 5 cm off, front 20 degrees off, depth 2 cm off"


def body(pelvis=(0, 0, 0), ankles=((0, 0, 0), (0, 0, 0)), wrists=((0, 0, 0), (0, 0, 0))):
    return BodyPoints(*(np.array([points], float) for points in (pelvis, ankles, wrists)))


@pytest.mark.parametrize(
    ("task", "points", "reason"),
    [
        ("sit-chair", body((0.28, 0, 0.6)), "pelvis 3 cm beside the seat"),
        ("sit-sofa", body((0, 0, 0.8)), "pelvis 3 cm too high"),
        ("sit-chair", body((-0.35, 0, 0.45)), "pelvis 10 cm beside the seat, pelvis 5 cm too low"),
        ("sit-chair", body((0, 0, 0.6)), ""),
        (
            "lie-bed",
            body((0, 0, 0.6), ((0.4, 0, 0.6), (0, 0, 0.48))),
            "an ankle 15 cm beside the bed, an ankle 2 cm too low",
        ),
        ("lie-sofa", body((0, 0, 0.6), ((0.4, 0, 0.6), (0, 0, 0.2))), "an ankle 5 cm too low"),
        ("touch-points", body(wrists=((0.3, 0, 0), (0, 0, 0))), "left wrist 20 cm too far from its target"),
        ("lift-box", body(wrists=((0, 0, 0), (0, 0, 0))), "box 20 cm too low"),
        ("lift-box", body(wrists=((0, 1.0, 0.1), (0, 0, 0))), "a wrist 65 cm too far from the box, box 20 cm too low"),
    ],
)
def test_what_is_missing_is_said(task, points, reason):
    facts = ObjectInfo.of([block(0.5, 0.25)], [np.zeros((2, 3))])
    assert TASKS.get(task).failure_reason(points, facts) == [reason]


@pytest.mark.parametrize("name", TASKS)
@given(st.lists(st.floats(-1.2, 1.2), min_size=18, max_size=18))
def test_k_holds_where_nothing_is_missing(name, numbers):
    task, values = TASKS.get(name), np.array(numbers)
    points = body(values[:3], values[3:9].reshape(2, 3), values[9:15].reshape(2, 3))
    facts = ObjectInfo.of([block(0.5, 0.6)], [np.zeros((2, 3))]).moved(values[None, 15:18], np.array([[1.0, 0, 0, 0]]))
    assert task.holds(points, facts)[0] == (task.failure_reason(points, facts) == [""])


def test_answers_that_face_the_robot():
    goal = TASKS.get("sit-chair").goal
    answers = torch.tensor(goal.label(block(0.5, 0.25))).float()[None]
    seen = goal.to_root(answers, torch.tensor([[[1.0, 0.4, 0.9]]]), torch.tensor([[2.0]]))
    found = goal.facing(seen)
    # of the four sides of a block, two are turned to who stands before an edge; the others are not to be learned
    kept = [any(torch.equal(one, other) for other in found[0]) for one in seen[0]]
    assert sum(kept) == 2
    x, y, sin, cos = found[0, :, :4].T
    assert (cos * x + sin * y < 0).all()
    alone = seen[:, 2:3]
    assert torch.equal(goal.facing(alone), alone), "who has one front has it on any side"
