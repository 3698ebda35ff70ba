"""Cloners that also say where their goal is, that go on from other weights, and that learn in bfloat16."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from mimicbench.core.errors import MimicbenchError
from mimicbench.core.settings import BadSetting
from mimicbench.imitate.learned import load_learner, take_over
from mimicbench.imitate.registry import LEARNERS
from mimicbench.imitate.train import Course, train
from mimicbench.tasks.registry import TASKS
from test_imitate import H1, INPUTS, SHORT, SIT_CHAIR, chairs, demos, frames, kinds, tiny  # noqa: F401

FINDERS = [kind for kind in kinds() if type(LEARNERS.get(kind).config().network).may_find_goals]


def finder(kind):
    """The network of a learner that also says where its goal is."""
    return replace(tiny(kind, INPUTS["paper"]), goal_weight=2.0).of(H1, SIT_CHAIR)


def test_who_can_find_goals():
    assert {"act", "bc"} <= set(FINDERS)
    with pytest.raises(BadSetting, match="see in every frame"):
        replace(tiny("act", INPUTS["blind"]), goal_weight=1.0)
    with pytest.raises(BadSetting, match="lift-box moves its own"):
        replace(tiny("act", INPUTS["paper"]), goal_weight=1.0).of(H1, TASKS.get("lift-box"))


@pytest.mark.parametrize("kind", FINDERS)
def test_where_the_goal_is_is_learned_from_what_is_seen(kind, demos, chairs):  # noqa: F811
    config = finder(kind)
    data = frames(demos, chairs, config)
    batch = data.batch(torch.tensor([0, 7, 21]))
    # sit-chair's goal, by hand: the seat's middle in the heading frame of the root
    for row, frame in enumerate([0, 7, 21]):
        episode = int(data.episode[frame])
        seat = torch.tensor(SIT_CHAIR.goal.describe(chairs[demos.object_ids[episode]])).float()
        away = seat[:2] - data.root_pos[frame, :2]
        yaw = float(data.root_yaw[frame])
        x = math.cos(yaw) * away[0] + math.sin(yaw) * away[1]
        y = math.cos(yaw) * away[1] - math.sin(yaw) * away[0]
        middle, spread = SIT_CHAIR.goal.middle_and_spread()
        torch.testing.assert_close((batch.goal[row] * spread + middle)[:2], torch.stack([x, y]), atol=1e-5, rtol=1e-5)
    torch.manual_seed(0)
    learner = config.build()
    parts = learner.loss(batch, torch.Generator().manual_seed(0))
    torch.testing.assert_close(
        parts["loss"] - 2.0 * parts["goal"], replaced(learner, batch)["loss"], msg="its error counts twice"
    )
    parts["goal"].backward()
    seen = sum(float(weight.grad.abs().sum()) for weight in learner.map_encoder.parameters())
    assert seen > 0 and all(weight.grad is None for name, weight in learner.named_parameters() if "head" in name)


def replaced(learner, batch):
    """The loss of the same batch without goals."""
    return learner.loss(replace(batch, goal=None), torch.Generator().manual_seed(0))


@pytest.mark.parametrize("kind", FINDERS)
def test_learning_goes_on_from_a_network_that_lacks_a_head(kind, demos, chairs, tmp_path):  # noqa: F811
    before = tiny(kind, INPUTS["paper"])
    train(before, frames(demos, chairs, before), SHORT, tmp_path / "before", quiet=True)
    begun, _ = load_learner(tmp_path / "before", H1, type(before))
    config, still = finder(kind), Course(steps=1, batch=8, learning_rate=0.0, weight_decay=0.0, average=0.0)
    after = train(config, frames(demos, chairs, config), still, tmp_path / "after", quiet=True, begin_from=begun)
    given, found = begun.state_dict(), after.state_dict()
    assert all((found[name] == value).all() for name, value in given.items())
    assert {name.partition(".")[0] for name in set(found) - set(given)} == {"finds"}
    other = tiny(kind, INPUTS["history"])
    with pytest.raises(MimicbenchError, match="same sizes and inputs"):
        train(other, frames(demos, chairs, other), still, tmp_path / "other", quiet=True, begin_from=begun)


@pytest.mark.parametrize("kind", FINDERS)
def test_of_a_network_that_found_other_goals_all_is_taken_but_what_found_them(kind):
    given = finder(kind).build()
    own = replace(finder(kind), goal_size=given.config.goal_size + 2).build()
    fresh = {name: value.clone() for name, value in own.state_dict().items()}
    take_over(own, given)
    for name, value in own.state_dict().items():
        assert torch.equal(value, fresh[name] if name.startswith("finds.") else given.state_dict()[name]), name


@pytest.mark.parametrize("kind", kinds())
def test_in_bfloat16_about_the_same_is_learned(kind, demos, chairs, tmp_path):  # noqa: F811
    config = tiny(kind, INPUTS["paper"])
    data, course = frames(demos, chairs, config), replace(SHORT, average=0.0)
    exact = train(config, data, course, tmp_path / "exact", quiet=True)
    rough = train(config, data, replace(course, precision="bfloat16"), tmp_path / "rough", quiet=True)
    again = train(config, data, replace(course, precision="bfloat16"), tmp_path / "again", quiet=True)
    batch = data.batch(torch.arange(10))
    with torch.no_grad():
        first, second = exact.predict(batch.vector, batch.picture), rough.predict(batch.vector, batch.picture)
    assert second.dtype == torch.float32 and (first != second).any()
    torch.testing.assert_close(first, second, atol=0.1, rtol=0.0)
    assert all((value == again.state_dict()[name]).all() for name, value in rough.state_dict().items())


def test_half_precision_decides_the_same_to_a_thousandth(demos, chairs, tmp_path, monkeypatch):  # noqa: F811
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "scripts"))
    import halve

    config = tiny("bc", INPUTS["paper"])
    data = frames(demos, chairs, config)
    whole = train(config, data, SHORT, tmp_path / "whole", quiet=True)
    assert halve.halve(tmp_path / "whole", tmp_path / "half") < 1e-3
    sizes = [(tmp_path / name / "model.safetensors").stat().st_size for name in ("whole", "half")]
    assert sizes[1] < 0.6 * sizes[0]
    half, notes = load_learner(tmp_path / "half", H1, type(config))
    assert notes["arrays"] == "float16" and next(half.parameters()).dtype == torch.float32
    batch = data.batch(torch.tensor([0, 7, 21]))
    torch.testing.assert_close(
        half.predict(batch.vector, batch.picture), whole.predict(batch.vector, batch.picture), atol=5e-3, rtol=0
    )
