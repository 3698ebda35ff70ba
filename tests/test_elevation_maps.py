"""Elevation maps of many robots at once: the same bytes in any company, on any number of threads."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from mimicbench.core import rotations as rot
from mimicbench.objects.families.bed import make_bed
from mimicbench.objects.families.box import make_box
from mimicbench.objects.families.chair import make_chair
from mimicbench.robots.rigs import HEAD_RIG, PELVIS_RIG
from mimicbench.sensors.elevation import ElevationMaps, camera_map, down_map
from mimicbench.sensors.elevation_cpu import RANGE, Poses, maps_by_cameras, maps_by_rays
from mimicbench.sensors.elevation_torch import TorchMaps
from mimicbench.sensors.heightmap import CELL, CELLS, MapView
from mimicbench.sensors.sight import surfaces
from mimicbench.sim.native import NativePhysics
from stool import H1, block

WEDGE = np.array([(x, y, z) for y in (-0.3, 0.3) for x, z in ((-0.3, 0.0), (0.3, 0.0), (0.3, 0.6))])


KINDS = [make_chair(1), make_bed(2), make_box(3), replace(block(), hulls=(WEDGE,)), block()]
VIEWS = [MapView(), MapView(None), MapView(HEAD_RIG, 0.01, (90, 120))]


def crowd(count, seed=0, kinds=KINDS):
    """Robots anywhere around and over objects of all kinds, some of which have moved."""
    random = np.random.default_rng(seed)
    objects = [kinds[k % len(kinds)] for k in range(count)]
    moved = np.array([obj.movable for obj in objects])[:, None]
    lean = rot.from_rotvec(random.normal(size=(count, 3)) * [0.1, 0.2, 0.0])
    return [surfaces.faces_of(obj) for obj in objects], Poses(
        np.column_stack([random.uniform(-1.5, 1.5, (count, 2)), random.uniform(0.5, 1.1, count)]),
        rot.multiply(rot.from_yaw(random.uniform(-np.pi, np.pi, count)), lean),
        moved * random.normal(size=(count, 3)) * 0.2,
        rot.normalize(rot.IDENTITY + moved * random.normal(size=(count, 4)) * 0.3),
    )


def by_cameras(faces, poses, workers=0):
    return maps_by_cameras(faces, poses, PELVIS_RIG, (90, 120), CELL, workers)


def by_rays(faces, poses, workers=0):
    return maps_by_rays(faces, poses, CELL, workers)


@pytest.mark.parametrize("make", [by_cameras, by_rays])
def test_threads_and_company_change_no_byte(make):
    faces, poses = crowd(37)
    alone = make(faces, poses, 1)
    for workers in (2, 3, 16):
        assert make(faces, poses, workers).tobytes() == alone.tobytes()
    for first, last in ((0, 1), (5, 23), (36, 37)):
        some = slice(first, last)
        assert make(faces[some], poses.part(some), 2).tobytes() == alone[some].tobytes()
    assert make([], poses.part(slice(0)), 2).shape == (0, CELLS, CELLS)


def one_by_one(faces, poses, rig, size, cell):
    """The map of one robot, each of its pixels against each face: what `maps_by_cameras` is to give, to the bit."""
    rows, columns = np.arange(size[0]), np.arange(size[1])
    turn, object_turn = rot.to_matrix(poses.root_quat_w[0]), rot.to_matrix(poses.object_quat_w[0])
    tilt = rot.to_matrix(rot.multiply(rot.from_yaw(-rot.yaw_of(poses.root_quat_w[0])), poses.root_quat_w[0]))
    tilt, found = tilt.astype(np.float32), np.full((CELLS, CELLS), -poses.root_pos_w[0, 2], np.float32)
    for origin, sights in zip(rig.origins(), rig.sights(*size), strict=True):
        eye = (poses.root_pos_w[0] - poses.object_pos_w[0] + turn @ origin) @ object_turn
        look, inverse = object_turn.T @ turn @ sights, np.zeros(size, np.float32)
        for planes, limits in zip(faces.normals, faces.offsets, strict=True):
            if planes[0] @ eye - limits[0] <= 1e-9:
                continue
            across, room = planes @ look, limits - planes @ eye
            value = across[0] / room[0]
            begin, end = np.zeros(size[0]), np.full(size[0], size[1] - 1.0)
            for base, down, along in room[1:, None] * value - across[1:]:
                cut = -(base / along) - (down / along) * rows
                if along > 0:
                    begin = np.maximum(begin, cut - 1e-6)
                else:
                    end = np.minimum(end, cut + 1e-6)
            begin = np.ceil(begin)
            first = (value[0] + value[1] * rows + value[2] * begin).astype(np.float32)
            seen = (columns - begin[:, None]).astype(np.float32) * np.float32(value[2]) + first[:, None]
            there = (columns >= begin[:, None]) & (columns <= np.floor(end)[:, None])
            inverse = np.where(there, np.maximum(inverse, seen), inverse)
        row, column = np.nonzero(inverse >= np.float32(1 / RANGE))
        look, depth = tilt @ sights.astype(np.float32), 1 / inverse[row, column]
        x, y, z = (
            at + depth * (form[0] + form[1] * row.astype(np.float32) + form[2] * column.astype(np.float32))
            for at, form in zip(tilt @ origin.astype(np.float32), look, strict=True)
        )
        i, j = (np.floor(along / np.float32(cell)).astype(int) + CELLS // 2 for along in (x, y))
        inside = (i >= 0) & (i < CELLS) & (j >= 0) & (j < CELLS)
        np.maximum.at(found, (i[inside], j[inside]), z[inside])
    return found


@pytest.mark.parametrize(("rig", "cell"), [(PELVIS_RIG, CELL), (HEAD_RIG, 0.01)])
def test_maps_are_those_of_all_pixels_one_by_one(rig, cell):
    """What shipped policies see stays what it is: nothing that makes maps faster may leave a pixel out, or add one."""
    faces, poses = crowd(20, seed=1)
    found = maps_by_cameras(faces, poses, rig, (90, 120), cell, 1)
    floor = -poses.root_pos_w[:, 2].astype(np.float32)[:, None, None]
    assert ((found > floor + 0.01).any((1, 2))).sum() > 5
    for n, face in enumerate(faces):
        expected = one_by_one(face, poses.part(slice(n, n + 1)), rig, (90, 120), cell)
        assert abs(found[n] - expected).max() <= 1e-6


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("make", [by_cameras, by_rays])
@pytest.mark.parametrize("broken", [np.nan, np.inf, 1e30])
def test_a_broken_scene_leaves_the_others_alone(make, broken):
    faces, poses = crowd(5)
    whole = make(faces, poses)
    for name in ("root_pos_w", "root_quat_w"):
        array = getattr(poses, name).copy()
        array[2] = broken
        maps = make(faces, replace(poses, **{name: array}))
        np.testing.assert_array_equal(np.delete(maps, 2, 0), np.delete(whole, 2, 0))


def test_memory_is_bounded_however_many_objects_come_by():
    poses = crowd(1)[1]
    for k in range(surfaces._KEPT + 50):
        by_rays([surfaces.faces_of(replace(block(), id=f"block-{k}"))], poses, 1)
    assert surfaces._of_boxes.cache_info().currsize == surfaces._KEPT


def test_an_object_that_shares_its_name_with_another_is_not_taken_for_it():
    poses, low = crowd(1)[1], block()
    high = replace(low, box_half=low.box_half * [1, 1, 1.5])
    assert (
        low.id == high.id
        and by_rays([surfaces.faces_of(high)], poses).max() > by_rays([surfaces.faces_of(low)], poses).max() + 0.1
    )


def tensors(poses, kind=torch.float64):
    return tuple(torch.from_numpy(pose).to(kind) for pose in vars(poses).values())


@pytest.mark.parametrize("kinds", [[make_chair(1), make_bed(2)], [make_box(3), make_box(4)]])
@pytest.mark.parametrize("view", VIEWS)
def test_an_environments_maps_are_those_of_its_physics(view, kinds):
    """Objects are exchanged, and have moved since; some robots' maps are those of all."""
    poses, objects = crowd(8, seed=2, kinds=kinds)[1], kinds * 4
    physics = NativePhysics(H1, objects, workers=1)
    for env, obj in enumerate(objects):
        if obj.movable:
            physics.qpos()[env, -7:] = np.concatenate([poses.object_pos_w[env], poses.object_quat_w[env]])
    physics.qpos()[:, :7] = np.concatenate([poses.root_pos_w, poses.root_quat_w], 1)
    old = camera_map(physics, None, *view.pixels, view.rig, view.cell) if view.rig else down_map(physics)
    maps = ElevationMaps([block()] * 8, view, workers=2)
    before = maps.sample(*tensors(poses))
    maps.set_objects(objects[:4], np.arange(4))
    maps.set_objects(objects[4:], np.arange(4, 8))
    found = maps.sample(*tensors(poses))
    assert found.dtype == torch.float32 and torch.equal(found, old) and not torch.equal(found, before)
    some = torch.tensor([6, 1])
    assert torch.equal(maps.sample(*(pose[some] for pose in tensors(poses)), some), found[some])
    single = maps.sample(*tensors(poses, torch.float32))
    assert (abs(single - found) > 1e-5).float().mean() < 1e-3


def test_objects_are_at_the_origin_unless_told():
    faces, poses = crowd(3)
    maps = ElevationMaps(KINDS[:3])
    still = Poses(poses.root_pos_w, poses.root_quat_w, 0 * poses.object_pos_w, np.tile(rot.IDENTITY, (3, 1)))
    assert maps.sample(*tensors(poses)[:2]).numpy().tobytes() == by_cameras(faces, still).tobytes()


@pytest.mark.parametrize("view", VIEWS)
def test_a_device_makes_the_same_maps(view):
    """Within 1e-6 m in every cell, and a broken scene leaves the others alone."""
    faces, poses = crowd(20, seed=4)
    poses.root_pos_w[3], poses.root_quat_w[4] = np.nan, np.inf
    if view.rig is None:
        expected = maps_by_rays(faces, poses, view.cell)
    else:
        expected = maps_by_cameras(faces, poses, view.rig, view.pixels, view.cell)
    there = TorchMaps(faces[:7] + faces[:13], view, "cpu")
    there.put(faces[7:], np.arange(7, 20))
    found = there.sample(torch.arange(20), Poses(*tensors(poses))).numpy()
    whole = np.delete(np.arange(20), [3, 4])
    assert abs(found - expected)[whole].max() <= 1e-6
    some = torch.tensor([11, 2])
    part = Poses(*(pose[some] for pose in tensors(poses)))
    np.testing.assert_array_equal(there.sample(some, part).numpy(), found[[11, 2]])


@pytest.mark.parametrize("view", VIEWS)
def test_nothing_is_copied_from_a_device(view):
    """On torch's device without memory there is nothing to copy, nor to decide anything by."""
    poses = crowd(5)[1]
    maps = ElevationMaps(KINDS, view, "meta")
    maps.set_objects(KINDS[:1], np.array([3]))
    found = maps.sample(*(pose.to("meta") for pose in tensors(poses, torch.float32)))
    assert found.shape == (5, CELLS, CELLS) and found.device.type == "meta" and found.dtype == torch.float32
