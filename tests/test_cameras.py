"""Cameras: points that land on pixels worked out by hand, what OpenGL draws there, and targets in pictures and maps."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import stool
from mimicbench.core import rotations as rot
from mimicbench.core.errors import MimicbenchError
from mimicbench.drawing.opengl import NoPictures
from mimicbench.robots.rigs import HEAD_RIG, PELVIS_RIG
from mimicbench.sensors.rays import FARTHEST, ray_depth
from mimicbench.sensors.render import FLOOR, NOTHING, OBJECT, ROBOT, RigCameras
from mimicbench.sensors.targets import TARGET_CELL, mark_targets, target_map
from mimicbench.sim.native import NativePhysics
from mimicbench.sim.scene import build_model
from mimicbench.tasks.registry import TASKS
from stool import H1, block

FOCAL = 138.5641
"""[px] 240 / tan 60 degrees."""
COS35, SIN35, COS55, SIN55 = 0.819152, 0.573576, 0.573576, 0.819152


def positions(x=0.0, y=0.0, z=1.0, quat=rot.IDENTITY):
    """Of a robot at rest with its root there."""
    return np.array([x, y, z, *quat, *H1.rest_pose])


@pytest.fixture(scope="module")
def opengl():
    try:
        RigCameras(build_model(H1, block()), HEAD_RIG, 8, 8).close()
    except NoPictures as error:
        pytest.skip(str(error))


@pytest.fixture
def look(opengl):
    """Look at a scene once."""

    def pictures(obj, rig, qpos, height=360, width=480, robot=True, visuals=False, **wanted):
        with RigCameras(build_model(H1, obj, visuals=visuals), rig, height, width, robot) as cameras:
            return cameras.look(qpos, **wanted)

    return pictures


def test_rigs_are_the_papers():
    # appendix C.2
    assert [mount.name for mount in PELVIS_RIG.mounts] == ["right front", "left front", "left back", "right back"]
    np.testing.assert_allclose([np.rad2deg(mount.bearing) for mount in PELVIS_RIG.mounts], [-45, 45, 135, -135])
    np.testing.assert_allclose([np.rad2deg(mount.pitch) for mount in PELVIS_RIG.mounts], 35)
    np.testing.assert_allclose(
        PELVIS_RIG.origins(), 0.0707107 * np.array([[1, -1, 0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0]]), atol=1e-7
    )
    (head,) = HEAD_RIG.mounts
    assert head.height == 0.55 and head.bearing == 0 and np.rad2deg(head.pitch) == pytest.approx(55)
    for slug in TASKS:
        task = TASKS.get(slug)
        assert task.rig is (HEAD_RIG if slug in ("touch-points", "lift-box") else PELVIS_RIG)
        assert task.map_cell == (0.01 if slug == "touch-points" else 0.04)


@pytest.mark.parametrize("camera", range(4))
def test_where_cameras_look(camera):
    middle = PELVIS_RIG.rays(3, 3)[camera, 1, 1]
    yaw, pitch = np.deg2rad([-45, 45, 135, -135])[camera], np.deg2rad(35)
    np.testing.assert_allclose(
        middle, [np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), -np.sin(pitch)], atol=1e-12
    )


def test_pictures_are_upright_and_120_degrees_wide():
    rays = PELVIS_RIG.rays(90, 120)
    for camera, turn in enumerate(PELVIS_RIG.turns()):
        local = rot.rotate_inverse(turn, rays[camera])
        np.testing.assert_allclose(local[..., 0], 1, atol=1e-12)  # one meter along the axis
        assert (np.diff(local[:, 60, 2]) < 0).all(), "rows go down"
        assert (np.diff(local[45, :, 1]) < 0).all(), "columns go right"
        # the outer edges of the outer pixels are 120 degrees apart, and 104.8 from top to bottom
        np.testing.assert_allclose(np.rad2deg(np.arctan(abs(local[45, [0, -1], 1]) * 120 / 119)), 60, atol=1e-9)
        np.testing.assert_allclose(2 * np.rad2deg(np.arctan(abs(local[[0, -1], 60, 2]) * 90 / 89)), 104.82, atol=0.01)


def test_points_land_on_pixels():
    # 1 m along the axis of the head camera is in the middle; from there 0.2 m to the left and 0.1 m up at 2 m
    axis, up = np.array([COS55, 0, -SIN55]), np.array([SIN55, 0, COS55])
    eye = np.array([0.15, 0.0, 0.55])
    pixels, depth = HEAD_RIG.project(np.array([eye + axis, eye + 2 * axis + [0, 0.2, 0] + 0.1 * up, eye - axis]))
    np.testing.assert_allclose(pixels[0, :2], [[180, 240], [180 - FOCAL * 0.05, 240 - FOCAL * 0.1]], atol=1e-3)
    np.testing.assert_allclose(depth[0], [1, 2, -1], atol=1e-5)
    # a place 1.41421 m ahead of the left front camera and 1 m below it: depth 1.41421 cos 35 + sin 35 = 1.73203,
    # height in its picture 1.41421 sin 35 - cos 35 = -0.00800, so 0.64 pixels under the middle
    pixels, depth = PELVIS_RIG.project(np.array([[1.0707107, 1.0707107, -1.0]]))
    assert depth[1, 0] == pytest.approx(1.73203, abs=1e-4)
    np.testing.assert_allclose(pixels[1, 0], [180.640, 240], atol=2e-3)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 3), st.integers(0, 29), st.integers(0, 39), st.floats(0.05, 20))
def test_projection_undoes_rays(camera, row, column, depth):
    point = PELVIS_RIG.origins()[camera] + depth * PELVIS_RIG.rays(30, 40)[camera, row, column]
    pixels, found = PELVIS_RIG.project(point[None], 30, 40)
    np.testing.assert_allclose(pixels[camera, 0], [row + 0.5, column + 0.5], atol=1e-6)
    assert found[camera, 0] == pytest.approx(depth)


def cube(x, y):
    """A cube of 10 cm on the floor."""
    return replace(
        block(), box_pos=np.array([[x, y, 0.05]]), box_half=np.full((1, 3), 0.05), box_rgb=np.array([[0.9, 0.1, 0.1]])
    )


def test_a_cube_is_drawn_where_it_is(look):
    # The head camera is at (-0.85, 0, 1.55). The cube's middle is 1 m ahead of it and 1.5 m below: depth cos 55 + 1.5
    # sin 55 =
    # 1.80231, height in the picture sin 55 - 1.5 cos 55 = -0.04121, so 3.17 px under the middle. The line of sight
    # through
    # the middle of pixel (183, 240) falls by sin 55 + 3.5 / 138.564 cos 55 = 0.83364 m for each of depth, and meets the
    # cube's top 1.45 m below the camera at depth 1.73936.
    views = look(cube(0.15, 0.0), HEAD_RIG, positions(x=-1.0), robot=False)
    assert views.color.shape == (1, 360, 480, 3) and views.depth.shape == views.labels.shape == (1, 360, 480)
    rows, columns = np.nonzero(views.labels[0] == OBJECT)
    assert rows.mean() + 0.5 == pytest.approx(183.2, abs=1.0) and columns.mean() + 0.5 == pytest.approx(240, abs=0.1)
    assert views.labels[0, 183, 240] == OBJECT and views.depth[0, 183, 240] == pytest.approx(1.73936, abs=1e-4)
    # its top, 0.1 m wide at depth 1.77 or so, is 7.8 px wide
    assert np.ptp(columns[rows == 183]) + 1 == pytest.approx(8, abs=1)
    red, green, blue = views.color[0, 183, 240].astype(int)
    assert red > 3 * green and red > 3 * blue


def test_left_is_left_and_right_is_right(look):
    for side in (1, -1):
        views = look(cube(0.0, 0.8 * side), PELVIS_RIG, positions(), 90, 120, color=False, robot=False)
        seen = (views.labels == OBJECT).sum((1, 2))
        # right front, left front, left back, right back
        assert ((seen > 0) == ([False, True, True, False] if side == 1 else [True, False, False, True])).all()
        ahead = views.labels[1 if side == 1 else 0] == OBJECT
        columns = np.nonzero(ahead)[1]
        assert (columns < 60).all() if side == 1 else (columns >= 60).all()


def test_pixels_at_any_size_are_those_of_the_rays(look):
    leaning = rot.multiply(rot.from_yaw(np.array(0.7)), rot.from_rotvec(np.array([0.1, 0.2, 0.0])))
    for rig, size in ((PELVIS_RIG, (45, 60)), (PELVIS_RIG, (33, 20)), (HEAD_RIG, (120, 160))):
        qpos = positions(-1.0, 0.3, 1.0, leaning)
        views = look(block(), rig, qpos, *size, color=False, robot=False)
        assert views.color.shape == (0, *size, 3)
        offset = rig.origins()[:, None, None] + rig.rays(*size) * views.depth[..., None]
        points = qpos[:3] + rot.rotate(leaning, offset)
        floor = (views.labels == FLOOR) & (views.depth < 6)
        assert floor.any() and abs(points[floor][:, 2]).max() < 1e-4
        seen = (views.labels == OBJECT) & (views.depth < 6)
        low, high = block().bounds()
        assert seen.any() and (points[seen] > low - 1e-4).all() and (points[seen] < high + 1e-4).all()


@pytest.mark.parametrize("robot", [True, False])
@pytest.mark.parametrize("rig", [PELVIS_RIG, HEAD_RIG], ids=["pelvis", "head"])
def test_depth_by_rays_is_the_depth_that_is_drawn(look, rig, robot):
    physics = NativePhysics(H1, [block(), block()], workers=1)
    leaning = rot.multiply(rot.from_yaw(np.array(0.7)), rot.from_rotvec(np.array([0.1, 0.2, 0.0])))
    qpos = np.array([positions(-1.0, 0.3), positions(0.6, 0.5, 1.0, leaning)])
    stool.put(physics, np.arange(2), qpos[:, :3], qpos[:, 3:7], qpos[:, 7:])
    traced = ray_depth(physics, None, 60, 80, rig, robot)
    assert traced.shape == (2, len(rig.mounts), 60, 80) and traced.max() <= FARTHEST
    for env in range(2):
        drawn = look(block(), rig, qpos[env], 60, 80, robot, color=False, labels=False).depth
        near = np.minimum(traced[env], drawn) < 6
        # round shapes are drawn with flat faces
        assert near.any() and (abs(traced[env] - drawn)[near] < 0.01).mean() > (0.97 if robot else 0.999)
    np.testing.assert_array_equal(ray_depth(physics, np.array([1]), 60, 80, rig, robot)[0], traced[1])


def test_depth_ends_at_50_meters_and_labels_name_links(look):
    qpos = positions(-1.0, z=1.05)
    views = look(block(), PELVIS_RIG, qpos, 90, 120)
    # the horizon is 35 degrees above the middle: 24.25 of 34.64 px focal length
    assert (views.labels[:, :20] != FLOOR).all() and (views.depth[views.labels == NOTHING] == FARTHEST).all()
    assert views.depth.max() == FARTHEST and (views.labels == NOTHING).any()
    links = set(np.unique(views.labels[views.labels >= ROBOT]) - ROBOT)
    assert links <= set(range(20)) and {"left_elbow_link", "right_elbow_link"} <= {
        H1.link_names[link] for link in links
    }
    assert not (look(block(), PELVIS_RIG, qpos, 90, 120, robot=False).labels >= ROBOT).any()


def test_hands_are_in_the_head_cameras_picture(look):
    labels = look(
        block(movable=True, mass=1.0),
        HEAD_RIG,
        np.concatenate([positions(-1.0, z=1.05), [0, 0, 0, 1, 0, 0, 0]]),
        180,
        240,
    ).labels[0]
    names = [H1.link_names[link - ROBOT] for link in np.unique(labels) if link >= ROBOT]
    assert {"left_elbow_link", "right_elbow_link"} <= set(names)
    left, right = (
        np.nonzero(labels == ROBOT + H1.link_names.index(f"{side}_elbow_link"))[1].mean() for side in ("left", "right")
    )
    assert left < 120 < right


def test_pictures_with_shells_and_light_have_the_same_scene(look):
    plain, fine = (
        look(block(), PELVIS_RIG, positions(-1.0), 90, 120, robot=False, visuals=visuals) for visuals in (False, True)
    )
    np.testing.assert_array_equal(plain.labels, fine.labels)
    np.testing.assert_allclose(plain.depth, fine.depth, rtol=1e-3)
    assert (look(block(), HEAD_RIG, positions(-1.0), 90, 120, visuals=True).labels >= ROBOT).any()


def test_without_opengl_there_is_one_clear_error(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "off")
    with pytest.raises(NoPictures, match="install libegl1"):
        RigCameras(build_model(H1, block()), HEAD_RIG)


def test_sizes_are_bounded():
    with pytest.raises(MimicbenchError, match="rows and columns"):
        RigCameras(build_model(H1, block()), HEAD_RIG, 100_000, 4)


def test_targets_are_red_pixels():
    root, quat = np.array([2.0, -1.0, 1.0]), rot.from_yaw(np.array(np.pi / 2))
    # in the root frame: 1 m along the head camera's axis; behind it; far out to the left
    in_root = np.array([[0.15 + COS55, 0, 0.55 - SIN55], [-1, 0, 1.0], [0.5, 30, 0]])
    color = np.full((1, 36, 48, 3), 7, np.uint8)
    marked = mark_targets(color, HEAD_RIG, root, quat, root + rot.rotate(quat, in_root + [0, -1e-6, -1e-6]))
    assert (color == 7).all()
    assert np.argwhere((marked != 7).any(-1)).tolist() == [[0, 18, 24]] and marked[0, 18, 24].tolist() == [255, 0, 0]
    wide = mark_targets(color, HEAD_RIG, root, quat, root + rot.rotate(quat, in_root[:1] + [0, -1e-6, -1e-6]), radius=2)
    assert (wide[0, 16:21, 22:27] == [255, 0, 0]).all() and (wide != 7).any(-1).sum() == 25


def test_target_map_by_hand():
    # The robot at (1, 2, 1) faces +y. (0.895, 2.304, 1.2) is 30.4 cm ahead and 10.5 cm to the left: row 64 + 30, column
    # 64 + 10.
    quat = rot.from_yaw(np.array([np.pi / 2]))
    targets = np.array([[[0.895, 2.304, 1.2], [1.0, 3.5, 1.0]]])
    found = target_map(np.array([[1.0, 2.0, 1.0]]), quat, targets)[0].numpy()
    assert found[94, 74] == pytest.approx(0.2) and (found == -1).sum() == 128 * 128 - 1, (
        "the other is 1.5 m away, out of the map"
    )
    assert (target_map(np.array([[1.0, 2.0, 1.0]]), quat, np.full((1, 2, 3), np.nan)).numpy() == -1).all()
    both = np.array([[[1.0051, 2.0051, 0.9], [1.0052, 2.0052, 0.8]]])
    assert target_map(np.array([[1.0, 2.0, 1.0]]), quat, both).max() == pytest.approx(-0.1)


@settings(max_examples=20, deadline=None)
@given(st.floats(-3, 3), st.floats(-2, 2), st.floats(-2, 2), st.sampled_from([1, 2, 3]))
def test_target_map_goes_with_the_robot(yaw, x, y, turns):
    root, quat = np.array([[0.0, 0.0, 1.0]]), rot.from_yaw(np.zeros(1))
    cells = np.array([[20, 100], [90, 3]])
    targets = np.concatenate([(cells + 0.5 - 64) * TARGET_CELL, [[1.1], [0.7]]], -1)[None]
    still = target_map(root, quat, targets)
    turn = rot.from_yaw(np.array([yaw]))
    moved = target_map(root + [x, y, 0], turn, rot.rotate(turn[:, None], targets) + [x, y, 0])
    np.testing.assert_allclose(moved, still, atol=1e-6)
    turned = target_map(root, rot.from_yaw(np.array([turns * np.pi / 2])), targets)[0]
    np.testing.assert_allclose(turned, np.rot90(still[0].numpy(), -turns), atol=1e-6)
