"""Sofas to sit and to lie on: what the paper's table says, free to sit or lie on, made from their id alone."""

import json
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from furniture_checks import ball_at_rest, check_plane, check_stands_in_one_piece, sizes
from mimicbench.core.errors import BadObject
from mimicbench.objects.families.couch import COUCHES, make_couch
from mimicbench.objects.families.joinery import GROOVE
from mimicbench.objects.families.sofa import SOFAS, make_sofa
from mimicbench.objects.families.sofa_shape import MIN_BETWEEN_ARMS, MIN_LYING_DEPTH, MIN_SEAT_DEPTH, SofaShape
from mimicbench.objects.families.upholstery import build_sofa
from mimicbench.objects.registry import make_object
from mimicbench.objects.shape import SceneObject

MAKERS = st.sampled_from([make_sofa, make_couch])


@pytest.fixture(scope="module")
def sofas():
    return [make_sofa(i) for i in range(1500)]


@pytest.fixture(scope="module")
def couches():
    return [make_couch(i) for i in range(1800)]


def test_sizes_are_those_of_the_papers_table(sofas, couches):
    # the table's length is the long side, y; its width is x
    for objects, mean, deviation in (
        (sofas, [1.311, 0.630, 0.573], [0.211, 0.217, 0.218]),
        (couches, [1.912, 0.867, 0.785], [0.283, 0.252, 0.257]),
    ):
        size = sizes(objects)[:, [1, 0, 2]]
        assert np.abs(size.mean(0) / mean - 1).max() < 0.02
        assert np.abs(size.std(0) / deviation - 1).max() < 0.05


def test_kinds_and_splits(sofas, couches):
    for objects, kinds in ((sofas, SOFAS), (couches, COUCHES)):
        assert {obj.kind for obj in objects} == set(kinds)
        assert sum(kind.share for kind in kinds.values()) == pytest.approx(1.0)
        assert abs(np.mean([obj.split == "test" for obj in objects]) - 0.25) < 0.04


def test_a_person_can_sit_on_every_sofa(sofas):
    heights = np.array([obj.seat_height for obj in sofas])
    assert heights.min() >= 0.35 and heights.max() <= 0.50
    assert all(obj.head_xy.shape == (0,) for obj in sofas)
    for obj in sofas:
        depth, between = np.ptp(obj.seat_polygon, axis=0)
        assert depth >= MIN_SEAT_DEPTH - 1e-9 and between >= MIN_BETWEEN_ARMS - 1e-9
        # the front edge of the seat is free: nothing before it but feet
        assert obj.seat_polygon[:, 0].max() == pytest.approx(obj.bounds()[1][0])


def test_a_person_can_lie_on_every_couch(couches):
    for obj in couches:
        depth, length = np.ptp(obj.seat_polygon, axis=0)
        assert depth >= MIN_LYING_DEPTH - 1e-9 and length >= 1.0
        assert 0.35 <= obj.seat_height <= 0.62
        low, high = obj.seat_polygon.min(0), obj.seat_polygon.max(0)
        assert (obj.head_xy > low).all() and (obj.head_xy < high).all()
        assert min(obj.head_xy[1] - low[1], high[1] - obj.head_xy[1]) == pytest.approx(0.16), "at one end"
        # ankles of who lies flat are some 0.1 m above the plane: more than half of the height
        assert obj.seat_height + 0.06 >= obj.bounds()[1][2] / 2
    assert np.median([np.ptp(obj.seat_polygon[:, 1]) for obj in couches]) > 1.6


@settings(max_examples=120, deadline=None)
@given(make=MAKERS, index=st.integers(0, 10**9), seed=st.integers(0, 10**6))
def test_stands_in_one_piece_with_a_free_plane(make, index, seed):
    obj = make(index, seed)
    check_stands_in_one_piece(obj)
    check_plane(obj, covered=0.9, drop=GROOVE, cushion=0.055, near_head=0.15)


@settings(max_examples=40, deadline=None)
@given(make=MAKERS, index=st.integers(0, 10**9), seed=st.integers(0, 10**6))
def test_made_again_from_its_id_alone(make, index, seed):
    obj = make(index, seed)
    text = json.dumps(obj.to_dict())
    assert json.dumps(make_object(obj.id).to_dict()) == text
    assert json.dumps(SceneObject.from_dict(json.loads(text)).to_dict()) == text


@pytest.mark.parametrize("make", [make_sofa, make_couch])
def test_a_ball_comes_to_rest_on_the_plane(make):
    for index in range(12):
        obj = make(index)
        middle = obj.seat_polygon.mean(0)
        end = ball_at_rest(obj, middle)
        assert end[2] == pytest.approx(obj.seat_height + 0.1, abs=0.004)
        np.testing.assert_allclose(end[:2], middle, atol=0.03)


def test_is_made_quickly():
    start = time.perf_counter()
    for index in range(100):
        make_sofa(index, 7)
        make_couch(index, 7)
    assert (time.perf_counter() - start) / 200 < 0.005


def test_a_seat_too_small_is_refused():
    with pytest.raises(BadObject, match="too small"):
        build_sofa("tiny", "sofa", SofaShape("ottoman", 0.5, 0.3, 0.4, 0.4, back="none"))


def test_most_sofas_have_a_back(sofas):
    rise = np.array([obj.bounds()[1][2] - obj.seat_height for obj in sofas])
    assert (rise > 0.08).mean() > 0.7 and 0.1 < (rise > 0.3).mean() < 0.4
