"""Beds: what the paper's table says, long and free enough to lie on, made from their id alone."""

import json
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from furniture_checks import ball_at_rest, check_plane, check_stands_in_one_piece, sizes
from mimicbench.core.errors import BadObject
from mimicbench.objects.families.bed import BEDS, PILLOW_DEPTH, build_bed, make_bed
from mimicbench.objects.families.bed_frames import MIN_MATTRESS, BedShape
from mimicbench.objects.registry import make_object
from mimicbench.objects.shape import SceneObject

MEAN, DEVIATION = np.array([2.273, 1.777, 0.857]), np.array([0.427, 0.394, 0.270])


@pytest.fixture(scope="module")
def beds():
    return [make_bed(i) for i in range(350)]


def test_sizes_are_those_of_the_papers_table(beds):
    size = sizes(beds)
    assert np.abs(size.mean(0) / MEAN - 1).max() < 0.03
    assert np.abs(size.std(0) / DEVIATION - 1).max() < 0.05


def test_sizes_hang_on_no_seed():
    size = sizes([make_bed(i, seed) for seed in range(1, 9) for i in range(350)])
    assert np.abs(size.mean(0) / MEAN - 1).max() < 0.03
    assert np.abs(size.std(0) / DEVIATION - 1).max() < 0.04


def test_kinds_have_their_shares(beds):
    for kind, drawn in BEDS.items():
        assert abs(np.mean([obj.kind == kind for obj in beds]) - drawn.share) < 0.01
    assert sum(kind.share for kind in BEDS.values()) == pytest.approx(1.0)
    assert abs(np.mean([obj.split == "test" for obj in beds]) - 0.25) < 0.08


def test_a_person_can_lie_on_every_bed(beds):
    for obj in beds:
        length, width = np.ptp(obj.seat_polygon, axis=0)
        assert length >= MIN_MATTRESS[0] - 1e-9 and width >= MIN_MATTRESS[1] - 1e-9
        assert 0.35 <= obj.seat_height <= 0.65
        low, high = obj.seat_polygon.min(0), obj.seat_polygon.max(0)
        assert obj.head_xy[0] - low[0] == pytest.approx(0.04 + PILLOW_DEPTH / 2), "at the headboard"
        nearer = min(obj.head_xy[1] - low[1], high[1] - obj.head_xy[1])
        assert 0.3 < nearer <= 0.65, "not far from the side that one gets in at"


@settings(max_examples=100, deadline=None)
@given(index=st.integers(0, 10**9), seed=st.integers(0, 10**6))
def test_stands_in_one_piece_with_a_free_plane(index, seed):
    obj = make_bed(index, seed)
    check_stands_in_one_piece(obj)
    check_plane(obj, covered=1.0, drop=0.0, cushion=0.055, near_head=PILLOW_DEPTH / 2 + 1e-3)


@settings(max_examples=30, deadline=None)
@given(index=st.integers(0, 10**9), seed=st.integers(0, 10**6))
def test_made_again_from_its_id_alone(index, seed):
    obj = make_bed(index, seed)
    text = json.dumps(obj.to_dict())
    assert json.dumps(make_object(obj.id).to_dict()) == text
    assert json.dumps(SceneObject.from_dict(json.loads(text)).to_dict()) == text


def test_a_ball_comes_to_rest_on_the_plane(beds):
    for obj in beds[:12]:
        middle = obj.seat_polygon.mean(0)
        end = ball_at_rest(obj, middle)
        assert end[2] == pytest.approx(obj.seat_height + 0.1, abs=0.004)
        np.testing.assert_allclose(end[:2], middle, atol=0.03)


def test_is_made_quickly():
    start = time.perf_counter()
    for index in range(100):
        make_bed(index, 7)
    assert (time.perf_counter() - start) / 100 < 0.005


def test_a_bed_too_short_is_refused():
    with pytest.raises(BadObject, match="too small"):
        build_bed("cot", BedShape("headboard", 1.2, 0.7, 0.8, 0.45))
