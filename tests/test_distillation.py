"""Learning to track from teachers."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from mimicbench.benchmark import keys
from mimicbench.benchmark.graph import make_track_stage, start
from mimicbench.benchmark.recipe import read_recipe
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.settings import BadSetting
from mimicbench.envs.clips import ClipSet
from mimicbench.track.checkpoint import CRITIC, TrackerConfig, load_tracker, save_tracker
from mimicbench.track.learning.distillation import Distiller, Teacher, pooled_statistics
from mimicbench.track.network import MLPConfig
from mimicbench.track.parts import TrackingParts
from mimicbench.track.settings import DistillConfig
from mimicbench.track.tracker import Layout
from mimicbench.track.train import train_tracker
from stool import H1, block
from tracked import CALM, LAYOUT, LIFT_BOX, ONE_THREAD, RESIDUAL, clip_set, lifted, tiny

BOX = block(0.4, 0.2, movable=True, mass=2.0)
LIFTS = ClipSet(LIFT_BOX, H1, [replace(lifted(), object_id=BOX.id)], {BOX.id: BOX})
BOTH = Layout.of(RESIDUAL, H1, [clip_set().task, LIFT_BOX])


def teacher_in(folder, layout, seed, bias=0.0, smoothing=0.0):
    """A made-up tracker whose statistics and actions are its own."""
    torch.manual_seed(seed)
    network = layout.blueprint(MLPConfig((8,))).network(19)
    network.obs_mean.fill_(seed)
    network.obs_std.fill_(1.0 + seed)
    with torch.no_grad():
        network.layers[-1].bias.fill_(bias)
    config = TrackerConfig("residual", layout.names, layout.widths, 19, (8,), {"smoothing": smoothing})
    save_tracker(folder, H1, config, network.tensors(), {"samples": 1, "tasks": ["sit-chair"]})
    return folder


def two_teachers(tmp_path):
    """Of a chair and of a box, and who is taught by which."""
    found = []
    for number, (layout, robots) in enumerate(((LAYOUT, slice(0, 1)), (BOTH, slice(1, 4)))):
        tracker = load_tracker(teacher_in(tmp_path / str(number), layout, number, bias=1.0 - 2 * number), H1)
        found.append(Teacher(tracker, (robots,), tuple(BOTH.columns_of(layout))))
    return found


def test_statistics_of_several_teachers_are_those_of_all_their_robots(tmp_path):
    mean, std = pooled_statistics(two_teachers(tmp_path), BOTH.size)
    # both see the body: a quarter has mean 0 and deviation 1, the rest 1 and 2; the object is seen by the second alone
    np.testing.assert_allclose(mean, 0.75)
    body = np.sqrt(0.25 * (1 + 0) + 0.75 * (4 + 1) - 0.75**2)
    unseen = np.sqrt(0.75 * (4 + 1) - 0.75**2)
    np.testing.assert_allclose(std, [*[body] * LAYOUT.size, *[unseen] * (BOTH.size - LAYOUT.size)], rtol=1e-6)


def test_each_robot_learns_from_the_teacher_of_its_task(tmp_path):
    teachers = two_teachers(tmp_path)
    torch.manual_seed(0)
    learner = Distiller(BOTH.blueprint(MLPConfig((64, 64))), 19, teachers, DistillConfig(learning_rate=3e-3, batch=32))
    obs = torch.randn(4, BOTH.size)
    obs[:1, LAYOUT.size :] = 0.0  # who lifts nothing sees no object
    errors = []
    for _ in range(100):
        for _ in range(8):
            learner.act(obs)
        errors.append(learner.update(obs)["action_error"])
    assert errors[-1] < 0.1 * errors[0], "which is of means that are 2 apart"
    with torch.no_grad():
        said = torch.cat([teachers[0].action(obs[:1]), teachers[1].action(obs[1:])])
    network = BOTH.blueprint(MLPConfig((64, 64))).network(19)
    network.load_tensors(learner.network_tensors())
    np.testing.assert_allclose(network(obs).detach(), said, atol=0.3)
    assert float((said[:1] - said[1:]).abs().mean()) > 1.0


def taught(tmp_path, folder, rounds, **more):
    folders = [teacher_in(tmp_path / "chair", LAYOUT, 0), teacher_in(tmp_path / "box", BOTH, 1)]
    config = replace(tiny(rounds), teachers=tuple(map(str, folders)), **more)
    return train_tracker(tmp_path / folder, [clip_set(), LIFTS], [], config, 0, ONE_THREAD)


def test_a_training_taken_up_in_the_middle_ends_in_the_same_bytes(tmp_path):
    whole = taught(tmp_path, "whole", 4)
    taught(tmp_path, "halves", 2)
    assert (taught(tmp_path, "halves", 4) / "model.safetensors").read_bytes() == (
        whole / "model.safetensors"
    ).read_bytes()
    tracker = load_tracker(whole, H1)
    assert set(tracker.observed) == set(BOTH.names) and not tracker.deviation
    assert not (whole / CRITIC).exists(), "nobody knows what its states are worth"


def test_learning_goes_on_from_a_tracker_of_the_same_sizes_alone(tmp_path):
    first = taught(tmp_path, "first", 2)
    still = DistillConfig(learning_rate=0.0, batch=32)
    after = load_tracker(taught(tmp_path, "after", 1, begin_from=str(first), distill=still), H1)
    for name, value in load_tracker(first, H1).network.tensors().items():
        np.testing.assert_array_equal(after.network.tensors()[name], value, err_msg=name)
    other = replace(tiny(1).ppo, hidden=(5, 5))
    with pytest.raises(MimicbenchError, match="other sizes or inputs"):
        taught(tmp_path, "other", 1, begin_from=str(first), ppo=other)


def test_robots_of_a_task_are_where_their_actions_go():
    env = TrackingParts(RESIDUAL, [clip_set(), LIFTS], [3, 4], 4, CALM, 0, ONE_THREAD)
    places = env.places()
    assert [(name, place.start, place.stop) for name, place in places] == [
        ("sit-chair", 0, 2),
        ("sit-chair", 2, 3),
        ("lift-box", 3, 5),
        ("lift-box", 5, 7),
    ]
    seen = env.observe()[:, BOTH.slices()[-1]]
    env.close()
    assert not seen[:3].any() and seen[3:].abs().sum(1).all(), "only who is at a box sees one"


def test_teachers_whose_actions_mean_something_else_are_refused(tmp_path):
    other = teacher_in(tmp_path / "other", LAYOUT, 0, smoothing=0.4)
    config = replace(tiny(1), teachers=(str(other),))
    with pytest.raises(BadSetting, match="smoothes its actions by 0.4, and the learner by 0; give"):
        train_tracker(tmp_path / "a", [clip_set()], [], config, 0, ONE_THREAD)
    wider = teacher_in(tmp_path / "wider", BOTH, 0)
    with pytest.raises(BadSetting, match="sees more than the learner"):
        train_tracker(tmp_path / "b", [clip_set()], [], replace(config, teachers=(str(wider),)), 0, ONE_THREAD)
    with pytest.raises(BadSetting, match="give --track.tracker residual"):
        train_tracker(tmp_path / "c", [clip_set()], [], replace(config, tracker="phc"), 0, ONE_THREAD)
    for given, said in (({"teachers": [str(other)]}, "smoothes"), ({"begin_from": str(tmp_path)}, "no tracker is")):
        with pytest.raises(BadSetting, match=said):
            make_track_stage(start(read_recipe({"task": "sit-chair", "track": given}), tmp_path / "work"))
    assert not (tmp_path / "work").exists(), "before anything is made for it"


def test_whom_a_teacher_teaches_is_part_of_what_a_tracker_is(tmp_path):
    first, second = (str(teacher_in(tmp_path / str(seed), LAYOUT, seed)) for seed in (0, 1))

    def key(also, *others, **more):
        track = {"also": also, **({"teachers": [first, *others]} if others else {}), **more}
        return keys.track_key(start(read_recipe({"task": "sit-chair", "track": track}), tmp_path)).digest

    ways = (["lie-bed", "sit-sofa"], first, second), (["sit-sofa", "lie-bed"], first, second)
    assert key(*ways[0]) != key(*ways[1])
    assert key(*ways[0]) == key(*ways[0])
    assert key(["lie-bed", "sit-sofa"]) != key(["sit-sofa", "lie-bed"]), "their order decides the random numbers"


def test_who_is_taught_by_others_is_another_tracker(tmp_path):
    def key(folder):
        tree = {"task": "sit-chair", "track": {"teachers": [str(folder)]}}
        return keys.track_key(start(read_recipe(tree), tmp_path)).digest

    first, second = (teacher_in(tmp_path / str(seed), LAYOUT, seed) for seed in (0, 1))
    assert key(first) != key(second)
    moved = first.rename(tmp_path / "moved")
    assert key(moved) == key(teacher_in(tmp_path / "again", LAYOUT, 0)), "where they lie does not matter"
