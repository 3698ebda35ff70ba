"""Signed distances and normals of objects."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mimicbench.core import rotations as rot
from mimicbench.objects.families.chair import make_chair
from mimicbench.objects.shape import SceneObject
from mimicbench.objects.surface import signed_distance


def cube(yaw: float = 0.0) -> SceneObject:
    return SceneObject(
        "cube",
        "box",
        "box",
        np.array([[0, 0, 0.5]]),
        rot.from_yaw(np.array([yaw])),
        np.array([[0.2, 0.3, 0.5]]),
        np.ones((1, 3)),
    )


def test_by_hand() -> None:
    points = np.array([[0.5, 0, 0.5], [0.15, 0, 0.5], [0, 0, 1.1], [0.6, 0.6, 0.5]])
    distance, normal = signed_distance(cube(), points)
    assert distance == pytest.approx([0.3, -0.05, 0.1, 0.5])
    assert normal == pytest.approx(np.array([[1, 0, 0], [1, 0, 0], [0, 0, 1], [0.8, 0.6, 0]]))
    turned, way = signed_distance(cube(np.pi / 2), np.array([[0.0, 0.5, 0.5]]))
    assert turned == pytest.approx([0.3]) and way == pytest.approx(np.array([[0.0, 1.0, 0.0]]))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 200), st.integers(0, 10**6))
def test_normal_is_the_gradient_and_agrees_with_the_unsigned_distance(index: int, seed: int) -> None:
    chair = make_chair(index, 0)
    points = np.random.default_rng(seed).uniform([-0.8, -0.8, 0.0], [0.8, 0.8, 1.2], (64, 3))
    distance, normal = signed_distance(chair, points)
    assert np.maximum(distance, 0) == pytest.approx(chair.distance(points), abs=1e-9)
    assert np.linalg.norm(normal, axis=-1) == pytest.approx(1)
    moved, _ = signed_distance(chair, points + 1e-6 * normal)
    assert (moved - distance) / 1e-6 == pytest.approx(1, abs=1e-3) or np.mean(
        np.abs((moved - distance) / 1e-6 - 1) < 1e-3
    ) > 0.9


def test_a_mattress_is_left_upwards() -> None:
    """A point just above the frame, deep in the mattress on it, is nearer to the frame than to the air."""
    pos, half = np.array([[0, 0, 0.1], [0, 0, 0.3]]), np.array([[1.0, 1, 0.1], [1.0, 1, 0.1]])
    bed = SceneObject("bed", "bed", "bed", pos, np.tile(rot.IDENTITY, (2, 1)), half, np.ones((2, 3)))
    distance, normal = signed_distance(bed, np.array([[0.0, 0, 0.25], [0.0, 0, 0.15], [0.95, 0, 0.25]]))
    assert distance == pytest.approx([-0.15, -1.0, -0.05])
    assert normal[0] == pytest.approx([0, 0, 1]) and normal[2] == pytest.approx([1, 0, 0])
