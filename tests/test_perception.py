"""What a network sees of any task's goal, what is remembered of it; the shipped network sees what it always saw."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import making
import mimicbench
from mimicbench.benchmark.recipe import stage_type
from mimicbench.core.checkpoint import BadCheckpoint
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.files import read_record, write_record
from mimicbench.imitate.goals import GoalMemory
from mimicbench.imitate.learn_perception import (
    Sights,
    draw_maps,
    evaluate_perception,
    goal_loss,
    of_other_heights,
    train_perception,
)
from mimicbench.imitate.perception import Perception, load_perception, save_perception, turned, window
from mimicbench.imitate.settings.perception import PerceptionConfig
from mimicbench.objects.families.chair import make_chair
from mimicbench.objects.registry import FAMILIES, make_object
from mimicbench.objects.shape import split_of
from mimicbench.objects.stretch import stretched
from mimicbench.objects.symmetry import MOTIONS
from mimicbench.robots.rigs import HEAD_RIG, PELVIS_RIG
from mimicbench.sensors.heightmap import ObjectMaps, box_heightmap
from mimicbench.tasks.registry import TASKS

SIT = TASKS.get("sit-chair")
FOUND = [task for task in TASKS.all() if not task.goal.given]
SIGHT = PerceptionConfig(
    heights=(1.0, 1.0),
    steps=150,
    maps=192,
    seen=0.25,
    batch=32,
    widths=(4, 8, 8),
    hidden=32,
    dropout=0.0,
    distance=(1.5, 2.0),
    threads=1,
)
SEEN = [
    [1.4174763, 0.404996455, -0.163718373, -0.986507118, 0.456843883, 0.435975939],
    [1.38077843, -0.157530889, 0.639245391, 0.769002736, 0.485949814, 0.426812828],
    [1.63812602, 0.543464065, -0.992644012, 0.121069662, 0.428570241, 0.395468086],
    [0.718978941, 0.216440037, 0.998507798, 0.054609295, 0.477896899, 0.537810504],
]
UNCERTAIN = [0.0105450414, 0.0130062234, 0.0140585452, 0.0167995449]
"""[m] What the shipped network said of four maps before goals were data."""


@pytest.fixture(scope="module")
def chairs():
    return [make_chair(i) for i in range(3)]


def test_the_shipped_network_sees_what_it_always_saw():
    net = load_perception(Path(mimicbench.__file__).parent / "checkpoints" / "sit-chair" / "perception", "h1")
    pos = torch.tensor([[1.5, 0.2, 1.0], [-1.0, 0.9, 0.97], [0.3, -1.7, 1.02], [-0.2, 0.7, 0.95]])
    yaw = torch.tensor([3.0, -0.6, 1.4, -1.5])
    objects = ObjectMaps([make_object(f"chair-0-{i:05d}") for i in range(4)])
    maps = objects.sample(torch.arange(4), pos, yaw, occlusion=torch.tensor([True, False, True, False]))
    goals, uncertainty, likely = net(*window(maps + pos[:, 2, None, None], net.window, net.cell))
    assert likely.shape == (4, 1)
    goal, uncertainty = SIT.goal.normalized(goals[:, 0]), uncertainty[:, 0]
    # to the last bit on the machine that made them; other processors add up in another order
    torch.testing.assert_close(goal, torch.tensor(SEEN), atol=1e-6, rtol=0)
    torch.testing.assert_close(uncertainty, torch.tensor(UNCERTAIN), atol=1e-7, rtol=0)


@pytest.mark.parametrize("task", FOUND, ids=lambda task: task.name)
def test_every_goal_can_be_learned(task, tmp_path):
    objects = [FAMILIES.get(task.family).make(i, 0) for i in range(3)]
    config = replace(SIGHT, steps=100, maps=96, batch=16, learning_rate=4e-3, distance=(0.8, 1.4), hypotheses=1)
    net = train_perception(tmp_path / "training", config, task, objects)
    errors = evaluate_perception(net, task, objects, maps=32)
    assert list(errors) == [field.name for field in task.goal.fields] and errors["middle"] < 0.3
    untrained = evaluate_perception(Perception(config, task), task, objects, maps=32)
    # a minute would be needed for directions
    lengths = [field.name for field in task.goal.fields if field.kind != "direction"]
    assert sum(errors[name] for name in lengths) < 0.8 * sum(untrained[name] for name in lengths)
    drawn = draw_maps(config, task, Sights.of(task, objects), 8, "check", seen=1.0)
    save_perception(tmp_path, net, "h1", errors)
    loaded = load_perception(tmp_path, "h1")
    assert torch.equal(loaded.perceive(drawn.maps, drawn.root_height), net.perceive(drawn.maps, drawn.root_height))
    assert loaded.goal is task.goal and loaded.cell == task.map_cell


def test_perception_learns_a_few_chairs(chairs, tmp_path):
    net = train_perception(tmp_path / "training", SIGHT, SIT, chairs)
    drawn = draw_maps(SIGHT, SIT, Sights.of(SIT, chairs), 64, "check", seen=0.0)
    found = net.perceive(drawn.maps, drawn.root_height)
    error = SIT.goal.errors(found, SIT.goal.nearest(found, drawn.answers))
    assert error["middle"].mean() < 0.1 and error["height"].mean() < 0.05
    torch.testing.assert_close(found, SIT.goal.normalized(found))
    # a map without anything gives numbers too
    assert torch.isfinite(net.perceive(-torch.ones(1, 128, 128), torch.ones(1))).all()


def test_what_is_told_need_not_be_learned(tmp_path):
    with pytest.raises(MimicbenchError, match="touch-points tells the robot its goal; there is nothing to learn"):
        train_perception(tmp_path, SIGHT, TASKS.get("touch-points"), [])


def test_a_checkpoint_of_no_task_is_refused(tmp_path):
    save_perception(tmp_path, Perception(SIGHT, SIT), "h1")
    config = read_record(tmp_path / "config.json")
    write_record(tmp_path / "config.json", {**config, "notes": {}})
    with pytest.raises(BadCheckpoint, match="does not say which task's goal it finds"):
        load_perception(tmp_path, "h1")
    write_record(tmp_path / "config.json", {**config, "notes": {"task": "lie-bed"}})
    with pytest.raises(BadCheckpoint):  # another goal has another number of outputs
        load_perception(tmp_path, "h1")


def test_a_killed_perception_goes_on(chairs, tmp_path):
    config = replace(SIGHT, steps=6, maps=64, save_every=0.0)
    whole = train_perception(tmp_path / "whole", config, SIT, chairs).state_dict()
    done = 0

    def kill(batches, loss):
        nonlocal done
        done += batches
        if done == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_perception(tmp_path / "killed", config, SIT, chairs, kill)
    seen = []
    resumed = train_perception(
        tmp_path / "killed", config, SIT, chairs, lambda batches, loss: seen.append(batches)
    ).state_dict()
    assert seen == [4, 1, 1] and all(torch.equal(whole[name], resumed[name]) for name in whole)


@pytest.mark.parametrize(("quarters", "mirror"), [(1, False), (2, False), (3, True), (0, True)])
def test_turned_maps_are_maps(quarters, mirror):
    # a symmetric chair seen from the mirrored place, and by a robot that has turned right, gives the mirrored and
    # turned map
    chair = next(chair for chair in map(make_chair, range(99)) if chair.kind == "easy")
    answers = SIT.goal.labels([chair])

    def look(y, yaw):
        pos = np.array([1.3, y, 0.9])
        height = torch.tensor(box_heightmap(chair, pos, yaw) + 0.9).float()[None]
        seen = SIT.goal.to_root(answers, torch.tensor(pos).float()[None, None], torch.tensor([[yaw]]).float())
        return *window(height, 48, 0.04), seen

    # turning the robot to the right turns what it sees to the left
    expected = look(-0.713 if mirror else 0.713, (2.9 if mirror else -2.9) - quarters * math.pi / 2)
    motion = MOTIONS[quarters + 4 * mirror]
    view, center, seat = look(0.713, -2.9)
    view, center = turned(view, center, motion)
    seat = SIT.goal.transformed(seat, motion)
    torch.testing.assert_close(center, expected[1])
    torch.testing.assert_close(seat, expected[2], atol=1e-5, rtol=0)
    assert float(((view - expected[0]).abs() > 1e-4).float().mean()) < 0.01


@pytest.mark.parametrize("task", FOUND, ids=lambda task: task.name)
def test_what_is_seen_does_not_depend_on_the_side_it_is_seen_from(task):
    """Of any network, even one that has learned nothing."""
    torch.manual_seed(3)
    net, obj = Perception(SIGHT, task), FAMILIES.get(task.family).make(1, 0)
    pos, yaw = np.array([1.4, 0.3, 0.95]), 2.6
    height = torch.tensor(box_heightmap(obj, pos, yaw)).float()[None]
    goal, uncertainty = net.look(height, torch.tensor([0.95]))
    assert len(net.sides) == 2 * task.rig.quarters()
    for motion in net.sides[1:]:
        moved, _ = turned(height, torch.zeros(1, 2), motion)
        found, doubt = net.look(moved, torch.tensor([0.95]))
        torch.testing.assert_close(found, task.goal.transformed(goal, motion), atol=2e-5, rtol=0)
        torch.testing.assert_close(doubt, uncertainty, atol=2e-5, rtol=0)


def test_answers_that_agree_outweigh_a_likelier_one():
    net = Perception(SIGHT, SIT)
    ahead = torch.tensor([1.0, 0.0, 0.0, 1.0, 0.45, 0.4])
    aside = ahead + torch.tensor([0.0, 0.02, 0.0, 0.0, 0.0, 0.0])
    back = torch.tensor([1.0, 0.01, 0.0, -1.0, 0.45, 0.4])
    goals, off = torch.stack([ahead, back, aside])[None], torch.tensor([[0.01, 0.05, 0.03]])
    goal, uncertainty = net._agreed(goals, off, torch.tensor([[0.3, 0.4, 0.3]]).log())
    middle, (sin, cos) = goal[0, :2], goal[0, 2:4]
    assert float(middle[1]) == pytest.approx(0.01, abs=5e-4) and abs(float(sin)) < 1e-5 and float(cos) == 1.0
    # they are 2 cm off in the mean, and 1 cm from their mean; what says the contrary is as wrong as can be: 0.35
    assert float(uncertainty) == pytest.approx(0.02 + 0.6 * 0.01 + 0.4 * 0.35, abs=1e-3)
    sure, little = net._agreed(goals[:, :1], off[:, :1], torch.zeros(1, 1))
    torch.testing.assert_close(sure, goals[:, 0])
    assert float(little) == pytest.approx(0.01)


def test_who_has_been_in_doubt_of_everything_can_become_sure(chairs):
    """Also where the doubt was beyond its bound: of sofas to lie on it stayed there."""
    net = Perception(SIGHT, SIT)
    with torch.no_grad():
        net.layers[-1].bias.view(1 + SIGHT.hypotheses, -1)[0, SIT.goal.size] = 9.0
    drawn = draw_maps(SIGHT, SIT, Sights.of(SIT, chairs), 16, "check", seen=0.0)
    seen = window(drawn.maps + drawn.root_height[:, None, None], net.window, net.cell)
    optimizer, doubts = torch.optim.Adam(net.parameters(), 3e-2), []
    for _ in range(60):
        found, off, likely = net(*seen)
        doubts.append(float(off.detach().mean()))
        optimizer.zero_grad()
        goal_loss(net, found, off, likely, drawn.answers).backward()
        optimizer.step()
    assert doubts[0] == pytest.approx(0.03 * math.exp(3.0)) and doubts[-1] < 0.5 * doubts[0]


def in_its_frame(seen):
    """(N, 2) where the goals (N, G) in the heading frames of robots are from these robots, in the goals' own frame."""
    middle, (sin, cos) = seen[:, :2], seen[:, 2:4].T
    x, y = cos * middle[:, 0] + sin * middle[:, 1], cos * middle[:, 1] - sin * middle[:, 0]
    return torch.stack([x, y], -1).numpy()


def test_robots_of_the_training_maps_look_at_the_object_from_outside():
    assert PELVIS_RIG.quarters() == 4 and HEAD_RIG.quarters() == 1
    np.testing.assert_allclose(np.rad2deg(HEAD_RIG.views()), [[-60, 60]])
    np.testing.assert_allclose(np.rad2deg(PELVIS_RIG.views())[0], [-90, 0])
    task = TASKS.get("lift-box")
    drawn = draw_maps(
        SIGHT, task, Sights.of(task, [FAMILIES.get("box").make(i, 0) for i in range(4)]), 256, "look", seen=1.0
    )
    x, y = drawn.answers[:, 0, 0], drawn.answers[:, 0, 1]
    assert (torch.atan2(y, x).abs() < math.radians(61)).all(), "the camera looks ahead"
    shown = (drawn.maps + drawn.root_height[:, None, None] > 0.1).flatten(1).any(1)
    assert shown.float().mean() > 0.95
    beds, bed = TASKS.get("lie-bed"), FAMILIES.get("bed").make(0, 0)
    drawn = draw_maps(replace(SIGHT, distance=(0.5, 0.6)), beds, Sights.of(beds, [bed]), 256, "look", seen=0.0)
    here = -in_its_frame(drawn.answers[:, 0])
    low, high = bed.bounds()
    outside = np.maximum(low[:2] - here, here - high[:2]).max(-1)
    assert outside.min() > 0.05, "not from upon the bed"


def test_the_loss_takes_the_nearest_answer():
    net = Perception(SIGHT, SIT)
    answers = SIT.goal.labels([next(chair for chair in map(make_chair, range(99)) if chair.kind == "stool")])
    assert answers.shape[1] > 1
    other = answers[0, 0] + torch.tensor([0, 0, 0.3, 0, 0, 0])
    off, likely = torch.full((1, 2), 0.01), torch.tensor([[0.9, 0.1], [0.5, 0.5], [0.1, 0.9]]).log()
    for right in answers[0]:
        found = torch.stack([right, other])[None]
        sure, torn, wrong = (goal_loss(net, found, off, share[None], answers) for share in likely)
        assert sure < torn < wrong, "who is right should be likely"
        assert sure < goal_loss(net, found + 0.1, off, likely[:1], answers)
        torch.testing.assert_close(SIT.goal.nearest(right[None], answers), right[None])


@pytest.mark.parametrize(("hypotheses", "off"), [(1, (0.6, 1.0)), (4, (0.0, 0.1))])
def test_of_two_fronts_one_is_seen_and_not_their_mean(hypotheses, off):
    """The same map, whose front is ahead as often as to the left: the mean is pi / 4 from both."""
    torch.manual_seed(0)
    net = Perception(replace(SIGHT, hypotheses=hypotheses), SIT)
    fronts = SIT.goal.labels([make_chair(0)])[0, :1].repeat(16, 1)
    fronts[:, list(SIT.goal.front)] = torch.tensor([[0.0, 1.0], [1.0, 0.0]]).repeat(8, 1)
    view, optimizer = torch.rand(1, net.window, net.window).repeat(16, 1, 1), torch.optim.Adam(net.parameters(), 1e-2)
    for _ in range(150):
        found, uncertainty, likely = net(view, torch.zeros(16, 2))
        optimizer.zero_grad()
        goal_loss(net, found, uncertainty, likely, fronts[:, None]).backward()
        optimizer.step()
    best = net.goal.normalized(found)[0, likely[0].argmax()]
    nearest = min(float(net.goal.errors(best, right)["front"]) for right in fronts[:2])
    assert off[0] <= nearest < off[1]
    assert float(likely[0].exp().max()) == pytest.approx(1.0 if hypotheses == 1 else 0.5, abs=0.2)


@pytest.mark.parametrize("task", FOUND, ids=lambda task: task.name)
def test_the_surest_look_is_remembered(task):
    truth = task.goal.labels([FAMILIES.get(task.family).make(0, 0)])[:, 0]
    pos, yaw = torch.tensor([[1.5, 0.5, 1.0], [1.0, 0.9, 1.0]]), torch.tensor([2.0, -2.5])
    first, second = (task.goal.to_root(truth, pos[i], yaw[i]) for i in (0, 1))
    moved = task.goal.from_root  # only the robot moves, so its odometry follows from both poses
    cos, sin = yaw[0].cos(), yaw[0].sin()
    step = pos[1, :2] - pos[0, :2]
    odometry = torch.stack([cos * step[0] + sin * step[1], cos * step[1] - sin * step[0]])[None]
    turned_by = (yaw[1] - yaw[0])[None]

    class Eyes(Perception):
        def look(self, elevation, root_height):
            return looks.pop(0)

    looks = [
        (first + 0.1, torch.tensor([0.1])),
        (second, torch.tensor([0.01])),
        (second + 0.2, torch.tensor([0.2])),
    ]
    memory, everyone = GoalMemory(Eyes(SIGHT, task), 1), torch.tensor([0])
    still = torch.zeros(1, 2), torch.zeros(1)
    memory.look(everyone, torch.zeros(1), torch.ones(1), *still)
    far = bool(memory.goal[0, list(task.goal.where)].norm() > SIGHT.distance[0] + 0.1)
    assert memory.unsure(*still).tolist() == [far]
    for _ in range(2):
        memory.look(everyone, torch.zeros(1), torch.ones(1), odometry, turned_by)
        torch.testing.assert_close(memory.goal, first, atol=1e-5, rtol=0)
        torch.testing.assert_close(memory.goal, moved(second, odometry, turned_by), atol=1e-5, rtol=0)
    assert memory.unsure(odometry, turned_by).tolist() == [False]
    torch.testing.assert_close(task.goal.now(memory.recall(odometry, turned_by)), second, atol=1e-5, rtol=0)
    memory.forget(everyone)
    assert memory.uncertainty.isinf().all()


def test_few_objects_do_for_learning_but_not_for_measuring(tmp_path):
    """Of three chairs none is held out; of a single one that is held out nothing can be learned."""
    imitate = stage_type("imitate", {"learner": "bc-clock"})(perception=replace(SIGHT, maps=4, steps=1, batch=2))
    made = making.make("perception", tmp_path, making.small(objects=3, imitate=imitate))
    assert made.complete and not made.summary
    assert load_perception(made.folder, "h1").config.maps == 4
    held_out = next(seed for seed in range(99) if split_of(FAMILIES.get("chair").make(0, seed).id) == "test")
    with pytest.raises(MimicbenchError, match="no object in .* is of the training split; make more"):
        making.make("perception", tmp_path, making.small(objects=1, seed=held_out, imitate=imitate))


def test_objects_with_other_heights_differ_in_nothing_else():
    chair = next(chair for chair in map(make_chair, range(99)) if (np.abs(chair.box_quat[:, 0]) < 0.999).any())
    low = stretched(chair, "low", np.array([1.0, 1.0, 0.5]))
    assert (
        low.id == "low"
        and low.seat_height == 0.5 * chair.seat_height
        and np.array_equal(low.seat_polygon, chair.seat_polygon)
    )
    np.testing.assert_allclose(low.box_pos, chair.box_pos * [1.0, 1.0, 0.5])
    straight = np.abs(chair.box_quat[:, 0]) > 1 - 1e-12
    np.testing.assert_allclose(low.box_half[straight], chair.box_half[straight] * [1.0, 1.0, 0.5])
    # turned about y by 60 degrees, a quarter of z and three quarters of x (squared) are upright
    quat = np.array([[np.cos(np.pi / 6), 0.0, np.sin(np.pi / 6), 0.0]])
    board = replace(chair, box_pos=np.zeros((1, 3)), box_quat=quat, box_half=np.ones((1, 3)), box_rgb=np.zeros((1, 3)))
    half = stretched(board, "low", np.array([1.0, 1.0, 0.5])).box_half[0]
    np.testing.assert_allclose(half, [np.sqrt(1 - 0.75 * 0.75), 1.0, np.sqrt(1 - 0.75 * 0.25)])


def test_heights_are_drawn_for_each_object(chairs):
    assert of_other_heights(SIGHT, chairs) == []
    many = [make_chair(i) for i in range(20)]
    drawn = of_other_heights(replace(SIGHT, heights=(0.4, 1.2)), many)
    factors = [other.seat_height / chair.seat_height for chair, other in zip(many, drawn, strict=True)]
    assert 0.4 <= min(factors) < 0.6 and 1.0 < max(factors) <= 1.2


def test_who_has_seen_lower_chairs_sees_how_low_a_chair_is(chairs, tmp_path):
    config = replace(SIGHT, heights=(0.5, 0.5), learning_rate=1e-2, hypotheses=1, seen=0.0, steps=200)
    net = train_perception(tmp_path, config, SIT, chairs)
    # who has not is 0.22 m off
    assert evaluate_perception(net, SIT, of_other_heights(config, chairs), maps=32)["height"] < 0.06


@pytest.mark.parametrize("task", [task for task in FOUND if task.goal.taken], ids=lambda task: task.name)
def test_what_is_seen_is_remembered_as_it_is_gone_about(task):
    beside = task.goal.labels([FAMILIES.get(task.family).make(0, 0)])[:, 0]
    found = torch.cat([task.goal.to_root(beside, torch.tensor([[0.0, y]]), torch.zeros(1)) for y in (1.0, -1.0)])
    depth = task.goal.columns["half depth"][0]
    found[:, depth] = 0.25  # narrow enough to be clasped from here

    class Eyes(Perception):
        def look(self, elevation, root_height):
            return found, torch.full((2,), 0.01)

    memory = GoalMemory(Eyes(SIGHT, task), 2)
    memory.look(torch.arange(2), torch.zeros(2), torch.ones(2), torch.zeros(2, 2), torch.zeros(2))
    torch.testing.assert_close(memory.goal, task.goal.taken(found))
    assert not torch.allclose(memory.goal, found)
