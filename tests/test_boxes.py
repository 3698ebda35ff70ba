"""Boxes to lift have the paper's sizes in every set of thirty, weigh what they should, and move as solid boxes."""

import json

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from joined import joined
from mimicbench.objects.families.box import (
    COUNT,
    FRICTION,
    KINDS,
    MADE_OF,
    MASS,
    SIZE_DEVIATION,
    SIZE_MEAN,
    kinds_of,
    make_box,
)
from mimicbench.objects.registry import make_object
from mimicbench.objects.surface import box_distance
from mimicbench.robots.registry import ROBOTS
from mimicbench.sim.scene import OBJECT_BODY, build_model


def size(obj):
    return np.subtract(*obj.bounds()[::-1])


@pytest.mark.parametrize("seed", [0, 1, 12345])
@pytest.mark.parametrize("first", [0, COUNT])
def test_thirty_boxes_have_the_tables_sizes(seed, first):
    boxes = [make_box(i, seed) for i in range(first, first + COUNT)]
    sizes = np.array([size(obj) for obj in boxes])
    assert np.abs(sizes.mean(0) / SIZE_MEAN - 1).max() < 0.005
    assert np.abs(sizes.std(0) / SIZE_DEVIATION - 1).max() < 0.01
    assert len(np.unique(sizes, axis=0)) == COUNT
    masses = np.array([obj.mass for obj in boxes])
    assert masses.min() >= MASS[0] and masses.max() <= MASS[1] and abs(masses.mean() - 2.5) < 0.01


def test_the_table_is_row_l():
    np.testing.assert_array_equal(SIZE_MEAN, [0.673, 0.434, 0.889])
    np.testing.assert_array_equal(SIZE_DEVIATION, [0.064, 0.062, 0.078])


@pytest.mark.parametrize("seed", [0, 7])
def test_boxes_are_of_what_is_as_light(seed):
    """What weighs less for its surface is of foam or cloth, what weighs more of plastic; nothing is of wood."""
    of = {kind: [] for kind in KINDS}
    for index in range(4 * COUNT):
        obj = make_box(index, seed)
        x, y, z = size(obj)
        per_area = obj.mass / (2 * (x * y + x * z + y * z))
        least, most = MADE_OF[obj.kind]
        assert least <= per_area * 1.02 and per_area * 0.98 < most
        of[obj.kind].append(per_area)
    means = [np.mean(of[kind]) for kind in KINDS]
    assert all(np.diff(means) > 0) and min(map(len, of.values())) >= 8


def test_every_weight_has_a_kind():
    for mass in np.linspace(*MASS, 31):
        assert kinds_of((0.673, 0.434, 0.889), float(mass))


def test_both_splits_have_some_and_all_kinds_occur():
    boxes = [make_box(i) for i in range(COUNT)]
    assert {obj.kind for obj in boxes} == set(KINDS)
    assert 4 <= sum(obj.split == "test" for obj in boxes) <= 12


@settings(max_examples=60, deadline=None)
@given(index=st.integers(0, 10**9), seed=st.integers(0, 10**6))
def test_every_box_can_be_clasped(index, seed):
    obj = make_box(index, seed)
    low, high = obj.bounds()
    assert low[2] == 0 and np.abs(low[:2] + high[:2]).max() < 1e-9
    assert obj.movable and obj.mass is not None and obj.friction == FRICTION
    assert joined(obj)
    assert np.abs(box_distance(obj, obj.touch_points)).max() < 1e-4
    assert (box_distance(obj, obj.touch_points + 0.05 * obj.touch_normals) > 0.04).all()
    share = obj.touch_points[:, 2] / high[2]
    assert share.min() >= 0.8 - 1e-3 and share.max() <= 0.9 + 1e-3
    left, right = np.split(obj.touch_points, 2)
    np.testing.assert_allclose(left * [1, -1, 1], right)
    assert (left[:, 1] < 0).all()
    # flat sides: nothing stands out of the body to the left and right
    assert abs(high[1] - obj.touch_points[:, 1].max()) < 1e-9
    assert json.dumps(obj.to_dict()) == json.dumps(make_object(obj.id).to_dict())


@pytest.mark.parametrize("index", range(4))
def test_it_moves_as_a_solid_box_of_its_mass(index):
    obj = make_box(index)
    model = build_model(ROBOTS.get("h1"), obj)
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, OBJECT_BODY)
    x, y, z = size(obj)
    assert model.body_mass[body] == pytest.approx(obj.mass)
    np.testing.assert_allclose(model.body_ipos[body], [0, 0, z / 2], atol=0.01)
    solid = obj.mass / 12 * np.array([y * y + z * z, x * x + z * z, x * x + y * y])
    np.testing.assert_allclose(np.sort(model.body_inertia[body]), np.sort(solid), rtol=0.02)
