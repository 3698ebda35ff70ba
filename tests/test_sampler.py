"""Which frames a batch is of."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from mimicbench.imitate.lerobot import Demos
from mimicbench.imitate.stored.sampler import FARTHEST, Sampler


def demos(driven: list[list[float]]) -> Demos:
    """One demonstration of ten frames, and an episode for each list, driven with that error in each frame [rad]."""
    lengths = [10, *map(len, driven)]
    frames, joints = sum(lengths), 2
    off = np.concatenate([np.zeros(10), *map(np.asarray, driven)])
    return Demos(
        robot="h1",
        task="sit-chair",
        fps=50.0,
        joint_names=("a", "b"),
        starts=np.concatenate([[0], np.cumsum(lengths)]),
        state=None,
        action=np.zeros((frames, joints), np.float32),
        executed_action=(off[:, None] * np.array([1.0, -1.0])).astype(np.float32),
        qpos=np.zeros((frames, 9)),
        qvel=np.zeros((frames, 8)),
        object_ids=("o",) * len(lengths),
        reference_ids=("r",) * len(lengths),
        success=np.arange(len(lengths)) == 0,
    )


def counts(sampler: Sampler, count: int, driven: float, wrong: float, frames: int) -> np.ndarray:
    """How often each frame is drawn."""
    drawn = sampler.draw(count, 0.0, driven, wrong, torch.Generator().manual_seed(0))
    return np.bincount(drawn.numpy(), minlength=frames)


def test_who_was_wrong_is_drawn_by_how_far() -> None:
    # frames 10 to 13: right, 0.05 off, 0.1 off, and tumbling
    sampler = Sampler(demos([[0.0, 0.05, 0.1, 1.0]]), torch.arange(14))
    found = counts(sampler, 120_000, 0.5, 0.5, 14)
    assert found[:10].sum() == 60_000
    by_chance, by_wrong = 30_000 / 4, 30_000 / (0.05 + 0.1 + FARTHEST)
    wanted = by_chance + by_wrong * np.array([0.0, 0.05, 0.1, FARTHEST])
    np.testing.assert_allclose(found[10:], wanted, rtol=0.05)


def test_frames_that_are_kept_apart_are_never_drawn() -> None:
    sampler = Sampler(demos([[0.1] * 5, [0.2] * 5]), torch.cat([torch.arange(8), torch.arange(15, 20)]))
    found = counts(sampler, 10_000, 0.5, 0.5, 20)
    assert not found[8:15].any() and found[15:].all()


def test_where_nobody_was_wrong_all_frames_are_alike() -> None:
    found = counts(Sampler(demos([[0.0, 0.0]]), torch.arange(12)), 4000, 0.5, 1.0, 12)
    np.testing.assert_allclose(found[10:], 1000, rtol=0.1)


def test_without_wrong_draws_are_what_they_were() -> None:
    sampler = Sampler(demos([[0.1, 0.2]]), torch.arange(12))
    random, again = torch.Generator().manual_seed(3), torch.Generator().manual_seed(3)
    drawn = sampler.draw(8, 0.0, 0.25, 0.0, random)
    first = torch.randint(10, (6,), generator=again)
    assert torch.equal(drawn, torch.cat([first, 10 + torch.randint(2, (2,), generator=again)]))


@given(st.integers(1, 300), st.floats(0, 1), st.floats(0, 1))
def test_as_many_as_were_asked_for(count: int, driven: float, wrong: float) -> None:
    found = counts(Sampler(demos([[0.1, 0.0, 0.3]]), torch.arange(13)), count, driven, wrong, 13)
    assert found.sum() == count
    if driven:
        assert found[10:].sum() == round(driven * count)


def test_wrong_alone_takes_as_much_of_what_was_driven_as_there_is() -> None:
    found = counts(Sampler(demos([[0.0, 0.0, 0.0, 0.1, 0.0]]), torch.arange(15)), 3000, 0.0, 1.0, 15)
    assert found[10:].sum() == 1000 and found[13] > 990


def test_demonstrations_alone() -> None:
    found = counts(Sampler(demos([]), torch.arange(10)), 50, 0.5, 0.5, 10)
    assert found.sum() == 50


def test_a_part_is_of_the_first_second() -> None:
    sampler = Sampler(demos([[0.1] * 200, [0.1] * 60]), torch.arange(270))
    found = np.bincount(sampler.draw(100_000, 0.5, 0.0, 0.0, torch.Generator().manual_seed(0)).numpy(), minlength=270)
    soon = np.r_[0:10, 10:60, 210:260]
    assert found[soon].sum() == pytest.approx(50_000 + 50_000 * 110 / 270, rel=0.02)
    assert (found > 0).all()
