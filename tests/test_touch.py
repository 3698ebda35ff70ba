"""Touch points on shapes whose answers are known, and what a pair of them promises."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadObject
from mimicbench.objects.families.household import make_household
from mimicbench.objects.shape import SceneObject
from mimicbench.objects.surface import box_distance
from mimicbench.objects.touch import (
    APART,
    ARM,
    ARM_CLEAR,
    HAND_CLEAR,
    SHOULDER,
    STAND_OFF,
    WRIST_OFF,
    find_pairs,
    stance_before,
    touch_pair,
    with_touch_points,
)


def blocks(*sizes):
    """Boxes (center, half size), upright."""
    pos, half = np.array([size[0] for size in sizes], float), np.array([size[1] for size in sizes], float)
    return SceneObject(
        "blocks", "household", "block", pos, np.tile(rot.IDENTITY, (len(pos), 1)), half, np.full((len(pos), 3), 0.5)
    )


CUBE = blocks(((0, 0, 0.3), (0.25, 0.2, 0.3)))


def test_distance_to_a_cube():
    points = np.array([[0.35, 0, 0.3], [0.25, 0, 0.3], [0.24, 0, 0.3], [0.28, 0.24, 0.3], [0, 0, 0.7], [0, 0, 0.3]])
    np.testing.assert_allclose(box_distance(CUBE, points), [0.1, 0, -0.01, 0.05, 0.1, -0.2], atol=1e-12)
    assert box_distance(CUBE, points.reshape(2, 3, 3)).shape == (2, 3)


def test_distance_to_turned_boxes_is_that_in_their_frames():
    turned = SceneObject(
        "x",
        "household",
        "x",
        np.zeros((1, 3)),
        rot.from_yaw(np.array([np.pi / 4])),
        np.array([[0.1, 0.2, 0.3]]),
        np.full((1, 3), 0.5),
    )
    np.testing.assert_allclose(box_distance(turned, np.array([[1.0, 1.0, 0.0]]) / np.sqrt(2)), [0.9])
    np.testing.assert_allclose(box_distance(turned, np.array([[-1.0, 1.0, 0.0]]) / np.sqrt(2)), [0.8])


def test_a_cube_is_touched_at_its_front_top_and_sides():
    obj = with_touch_points(CUBE)
    normals = {tuple(normal) for normal in obj.touch_normals}
    assert normals <= {(1, 0, 0), (0, 0, 1), (0, 1, 0), (0, -1, 0)}
    assert {(0, 1, 0), (0, -1, 0), (0, 0, 1)} <= normals
    np.testing.assert_allclose(box_distance(obj, obj.touch_points), 0, atol=1e-9)


def test_only_the_faces_asked_for():
    obj = with_touch_points(CUBE, [(0, "top")])
    assert (obj.touch_normals == [0, 0, 1]).all() and (obj.touch_points[:, 2] == 0.6).all()


def test_a_face_behind_another_box_is_not_free():
    # a board 5 cm before the front leaves no room for a hand
    obj = blocks(((0, 0, 0.3), (0.25, 0.2, 0.3)), ((0.31, 0, 0.3), (0.01, 0.2, 0.3)))
    with pytest.raises(BadObject, match="two hands"):
        with_touch_points(obj, [(0, "front")])


@pytest.mark.parametrize("height", [0.1, 1.6])
def test_too_low_or_too_high_is_refused(height):
    with pytest.raises(BadObject, match="two hands"):
        with_touch_points(blocks(((0, 0, height / 2), (0.25, 0.2, height / 2))), [(0, "top")])


def test_a_pair_needs_two_hands_width():
    pole = blocks(((0, 0, 0.4), (0.02, 0.02, 0.4)))
    with pytest.raises(BadObject, match="two hands"):
        with_touch_points(pole)
    with pytest.raises(BadObject, match="with_touch_points"):
        touch_pair(pole, np.random.default_rng(0))


def test_far_inside_a_large_top_is_out_of_reach():
    obj = with_touch_points(blocks(((0, 0, 0.35), (1.0, 0.6, 0.35))), [(0, "top"), (0, "left"), (0, "right")])
    assert obj.touch_points[:, 0].min() > 0.3


@settings(max_examples=40, deadline=None)
@given(index=st.integers(0, 10**9))
def test_what_a_pair_promises(index):
    obj = make_household(index)
    pairs = find_pairs(obj)
    points, wrists = obj.touch_points[pairs.points], (obj.touch_points + WRIST_OFF * obj.touch_normals)[pairs.points]
    gap = points[:, 1] - points[:, 0]
    assert (gap[:, 1] > 0).all(), "the left hand of somebody who looks to -x is at the smaller y"
    apart = np.linalg.norm(gap, axis=1)
    assert apart.min() >= APART[0] - 1e-9 and apart.max() <= APART[1] + 1e-9
    assert np.linalg.norm(wrists - pairs.shoulders, axis=-1).max() <= ARM + 1e-9
    assert (box_distance(obj, wrists) >= HAND_CLEAR - 1e-9).all()
    np.testing.assert_allclose(pairs.shoulders[:, 1, 1] - pairs.shoulders[:, 0, 1], 2 * SHOULDER)
    for share in np.linspace(0, 1, 7):
        assert (box_distance(obj, wrists + share * (pairs.shoulders - wrists)) >= ARM_CLEAR - 1e-9).all()
    assert (pairs.stance[:, 0] >= obj.bounds()[1][0] + STAND_OFF - 1e-9).all()
    left, right = touch_pair(obj, np.random.default_rng(index))
    again = touch_pair(obj, np.random.default_rng(index))
    np.testing.assert_array_equal([left, right], again)
    assert np.abs(wrists - np.stack([left, right])).max((1, 2)).min() == 0
    np.testing.assert_allclose(
        stance_before(obj, left, right), [obj.bounds()[1][0] + STAND_OFF, (left[1] + right[1]) / 2, np.pi], atol=0.07
    )


def test_pairs_are_those_of_the_shape_whatever_its_name():
    # pairs are searched once for each shape: one of the same name and another size has its own
    small, large = with_touch_points(CUBE), with_touch_points(blocks(((0, 0, 0.4), (0.25, 0.25, 0.4))))
    assert small.id == large.id
    for obj in (small, large, small):
        left, right = touch_pair(obj, np.random.default_rng(0))
        assert 0 < box_distance(obj, np.stack([left, right])).max() <= WRIST_OFF + 1e-9
    draws = {tuple(touch_pair(small, np.random.default_rng(seed))[0]) for seed in range(50)}
    wrists = small.touch_points + WRIST_OFF * small.touch_normals
    assert draws <= {tuple(wrists[left]) for left, _ in find_pairs(small).points} and len(draws) > 1
