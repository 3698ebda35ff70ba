"""Chairs can be sat on, are what the paper's table says, and follow from their id alone."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadObject, UnknownName
from mimicbench.objects.families.chair import KINDS, build_chair, make_chair
from mimicbench.objects.families.chair_parts import MIN_BETWEEN_ARMS, MIN_SEAT_DEPTH, MIN_SEAT_WIDTH, ChairShape
from mimicbench.objects.registry import make_object
from mimicbench.objects.shape import SLOTS, SceneObject, load_object, save_object


@pytest.fixture(scope="module")
def family():
    return [make_chair(i) for i in range(4600)]


def covers(obj, points, height, depth=0.02):
    """Whether one box of the object holds each of the points (N, 2), just below the given height."""
    points = np.column_stack([points, np.full(len(points), height - depth)])
    local = rot.rotate_inverse(obj.box_quat[:, None], points[None] - obj.box_pos[:, None])
    return (np.abs(local) <= obj.box_half[:, None] + 1e-9).all(-1).any(0)


def test_sizes_are_those_of_the_papers_table(family):
    size = np.array([np.subtract(*obj.bounds()[::-1]) for obj in family])
    assert np.abs(size.mean(0) / [0.578, 0.556, 0.806] - 1).max() < 0.05
    assert np.abs(size.std(0) / [0.149, 0.151, 0.176] - 1).max() < 0.05


def test_kinds_and_seat_heights_vary(family):
    assert {obj.kind for obj in family} == set(KINDS)
    heights = np.array([obj.seat_height for obj in family])
    assert heights.min() >= 0.36 and heights.max() <= 0.54
    assert np.quantile(heights, 0.25) > 0.40 and np.quantile(heights, 0.75) < 0.48


def test_three_quarters_are_for_training(family):
    assert abs(np.mean([obj.split == "test" for obj in family]) - 0.25) < 0.03
    # fixed by the id: these never change
    assert [make_chair(i).split for i in range(8)] == [family[i].split for i in range(8)]


@settings(max_examples=80, deadline=None)
@given(index=st.integers(0, 10**9), seed=st.integers(0, 10**6))
def test_every_chair_can_be_sat_on(index, seed):
    obj = make_chair(index, seed)
    low, high = obj.bounds()
    assert len(obj.box_pos) <= SLOTS
    assert abs(low[2]) < 1e-9, "it stands on the floor"
    np.testing.assert_allclose(low[:2], -high[:2], atol=1e-9)
    polygon = obj.seat_polygon
    assert (polygon >= low[:2] - 1e-9).all() and (polygon <= high[:2] + 1e-9).all()
    depth, width = np.ptp(polygon, axis=0)
    assert depth >= MIN_SEAT_DEPTH - 1e-9 and width >= MIN_SEAT_WIDTH - 1e-9
    if obj.kind in ("armchair", "easy"):
        assert width >= MIN_BETWEEN_ARMS - 1e-9
    x, y = polygon.T
    assert (np.roll(y, -1) * x - np.roll(x, -1) * y).sum() > 0, "counter-clockwise"
    grid = np.stack(
        np.meshgrid(
            *[np.linspace(a + 0.005, b - 0.005, 9) for a, b in zip(polygon.min(0), polygon.max(0), strict=True)]
        ),
        -1,
    ).reshape(-1, 2)
    assert covers(obj, grid, obj.seat_height).all(), "a solid seat under the whole polygon"
    assert not covers(obj, grid[grid[:, 0] > polygon[:, 0].min() + 0.03], obj.seat_height, -0.03).any(), (
        "nothing in the way above it"
    )


@settings(max_examples=30, deadline=None)
@given(index=st.integers(0, 10**9), seed=st.integers(0, 10**6))
def test_made_again_from_its_id_alone(index, seed):
    obj = make_chair(index, seed)
    again = make_object(obj.id)
    assert json.dumps(obj.to_dict()) == json.dumps(again.to_dict())


def test_saved_and_loaded(tmp_path, family):
    for obj in family[:20]:
        save_object(tmp_path, obj)
        assert load_object(tmp_path, obj.id).to_dict() == obj.to_dict()
        assert SceneObject.from_dict(json.loads(json.dumps(obj.to_dict()))).to_dict() == obj.to_dict()


@pytest.mark.parametrize(
    "wrong",
    [
        "",
        "chair",
        "chair-0",
        "chair-0-1",
        "chair-0-00001x",
        "../chair-0-00001",
        "fitted-armchair-0",
        "chair--1-00001",
        "chair-0-000001",
    ],
)
def test_an_id_of_no_family_is_refused(wrong):
    with pytest.raises(BadObject):
        make_object(wrong)


def test_an_unknown_family_lists_the_known(family):
    with pytest.raises(UnknownName, match="chair"):
        make_object("throne-0-00001")


def test_a_seat_too_small_is_refused():
    with pytest.raises(BadObject, match="too small"):
        build_chair("tiny", ChairShape("stool", 0.3, 0.3, 0.45, 0.45))
