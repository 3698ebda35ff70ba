"""Height maps: boxes at known places, and what turning and moving the robot does to a map."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from mimicbench.core import rotations as rot
from mimicbench.objects.heights import surface_height
from mimicbench.objects.shape import SceneObject
from mimicbench.sensors.heightmap import ObjectMaps, box_heightmap, cell_centers


def boxes(*items):
    """An object of (center, half, quat) boxes."""
    pos, half, quat = (np.array(values, float) for values in zip(*items, strict=True))
    return SceneObject("thing-0-00000", "thing", "boxes", pos, quat, half, np.full((len(pos), 3), 0.5))


UPRIGHT = (1.0, 0.0, 0.0, 0.0)
# no edge lies on a cell's center
BLOCK = boxes(((0, 0, 0.2), (0.11, 0.31, 0.2), UPRIGHT))
ELL = boxes(((0, 0, 0.2), (0.21, 0.31, 0.2), UPRIGHT), ((-0.3, 0.1, 0.5), (0.1, 0.2, 0.5), UPRIGHT))


def test_box_in_front_of_the_robot():
    # the robot at x = -1 looks along +x: the block's cells are 0.89..1.11 ahead and 0.31 to either side
    found = box_heightmap(BLOCK, np.array([-1.0, 0.0, 1.0]), 0.0)
    x = cell_centers()
    inside = (abs(x - 1) <= 0.11)[:, None] & (abs(x) <= 0.31)[None, :]
    assert inside.sum() == 6 * 16
    np.testing.assert_allclose(found, np.where(inside, 0.4 - 1.0, -1.0), atol=1e-12)


def test_rows_are_forward_and_columns_left():
    # the robot at x = +1 facing +y has the block on its left: same rows as itself, columns beyond the middle
    rows, columns = np.nonzero(box_heightmap(BLOCK, np.array([1.0, 0.0, 1.0]), np.pi / 2) > -0.9)
    assert abs(cell_centers()[rows].mean()) < 1e-9
    assert cell_centers()[columns].mean() == pytest.approx(1.0, abs=0.02)


def test_tilted_box_is_a_ramp():
    # a plate pitched by 0.3 rad about y: the surface falls by tan(0.3) toward +x
    plate = boxes(((0, 0, 0.5), (0.4, 0.4, 0.01), (np.cos(0.15), 0, np.sin(0.15), 0)))
    x = np.linspace(-0.3, 0.3, 7)
    expected = 0.5 + 0.01 / np.cos(0.3) - x * np.tan(0.3)
    np.testing.assert_allclose(surface_height(plate, np.stack([x, 0 * x], -1)), expected, atol=1e-12)


def test_highest_box_wins():
    assert surface_height(ELL, np.array([[-0.25, 0.1], [0.0, 0.0], [1.0, 0.0]])).tolist() == [1.0, 0.4, 0.0]


@settings(max_examples=20, deadline=None)
@given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.sampled_from([1, 2, 3]))
def test_quarter_turn_of_the_robot_turns_the_map(x, y, turns):
    pos = np.array([x, y, 1.0])
    still, turned = box_heightmap(ELL, pos, 0.1), box_heightmap(ELL, pos, 0.1 + turns * np.pi / 2)
    assert (abs(turned - np.rot90(still, -turns)) > 1e-9).mean() < 1e-3


@settings(max_examples=10, deadline=None)
@given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.floats(-3, 3))
def test_moving_robot_and_object_together_changes_nothing(x, y, yaw):
    quat = rot.from_yaw(np.array(yaw))
    turned = SceneObject(
        "t",
        "thing",
        "boxes",
        rot.rotate(quat, ELL.box_pos),
        rot.multiply(quat, ELL.box_quat),
        ELL.box_half,
        ELL.box_rgb,
    )
    pos = np.array([x, y, 0.9])
    moved = box_heightmap(turned, rot.rotate(quat, pos), 0.3 + yaw)
    assert (abs(moved - box_heightmap(ELL, pos, 0.3)) > 1e-9).mean() < 1e-3


def test_sampled_maps_agree_with_exact_ones():
    random = np.random.default_rng(0)
    objects = [BLOCK, ELL]
    index, yaw = random.integers(0, 2, 12), random.uniform(-3, 3, 12)
    pos = np.concatenate([random.uniform(-2, 2, (12, 2)), random.uniform(0.7, 1.1, (12, 1))], -1)
    maps = ObjectMaps(objects).sample(torch.tensor(index), torch.tensor(pos), torch.tensor(yaw)).numpy()
    exact = np.stack([box_heightmap(objects[i], pos[k], yaw[k]) for k, i in enumerate(index)])
    raised = (exact > -pos[:, 2, None, None] + 0.01).sum()
    # they differ at most by cells whose center is within half a centimetre of an edge
    assert (abs(maps - exact) > 1e-4).sum() < 0.1 * raised


def test_what_is_behind_a_wall_is_not_seen():
    # seen from -x, the wall at x = -0.3 hides the low block behind it; from +x it does not
    scene = boxes(((0, 0, 0.1), (0.11, 0.11, 0.1), UPRIGHT), ((-0.3, 0, 0.6), (0.05, 0.6, 0.6), UPRIGHT))
    pos = torch.tensor([[-1.0, 0.0, 1.0], [1.0, 0.0, 1.0]])
    maps = ObjectMaps([scene]).sample(torch.tensor([0, 0]), pos, torch.tensor([0.0, torch.pi]), occlusion=True)
    block = abs(maps + 0.8) < 1e-4
    wall = abs(maps - 0.2) < 1e-4
    assert not block[0].any() and block[1].sum() == 36
    assert wall[0].any() and wall[1].any()
