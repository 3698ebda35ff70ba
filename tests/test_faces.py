"""Faces in closed form: each pixel gets what a ray through its center meets."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mimicbench.core import rotations as rot
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.rigs import HEAD_RIG, PELVIS_RIG
from mimicbench.sensors.sight.surfaces import Surfaces, faces_of
from mimicbench.sim.native import NativePhysics
from stool import H1, block

HEIGHT, WIDTH = 24, 32


def inverse_depth(obj, eye, quat, rig=HEAD_RIG):
    """(C, height, width) of cameras of a rig whose root is at `eye` (3,) and turned by `quat`."""
    turn = rot.to_matrix(quat)
    eyes, looks = (eye + rig.origins() @ turn.T)[None], (turn @ rig.sights(HEIGHT, WIDTH))[None]
    return filled(Surfaces.of([faces_of(obj)]).seen_from(eyes, looks, HEIGHT, WIDTH), len(rig.mounts))


def filled(faces, count):
    """(count, height, width) pictures of faces."""
    rows = np.zeros((count * HEIGHT, WIDTH), np.float32)
    faces.fill(rows, np.arange(count) * HEIGHT)
    return rows.reshape(count, HEIGHT, WIDTH)


def by_slabs(obj, eye, quat, rig=HEAD_RIG):
    """The same with each ray against each box, 0 where it meets none; boxes around a camera are left out."""
    turn = rot.to_matrix(quat)
    found = np.zeros((len(rig.mounts), HEIGHT, WIDTH))
    for camera, (origin, rays) in enumerate(zip(rig.origins(), rig.rays(HEIGHT, WIDTH), strict=True)):
        for pos, axes, half in zip(obj.box_pos, rot.to_matrix(obj.box_quat), obj.box_half, strict=True):
            start, along = (eye + turn @ origin - pos) @ axes, rays @ turn.T @ axes
            enter, leave = (-np.sign(along) * start - half) / abs(along), (-np.sign(along) * start + half) / abs(along)
            hit = (enter.max(-1) <= leave.min(-1)) & (enter.max(-1) > 0)
            found[camera][hit] = np.maximum(found[camera][hit], 1 / enter.max(-1)[hit])
    return found


def heap(seed):
    """Three boxes, turned anyhow, one on the other."""
    random = np.random.default_rng(seed)
    return SceneObject(
        "heap",
        "chair",
        "heap",
        random.uniform(-0.4, 0.4, (3, 3)),
        rot.normalize(random.normal(size=(3, 4))),
        random.uniform(0.02, 0.4, (3, 3)),
        np.ones((3, 3)),
    )


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_pixels_are_what_rays_meet(seed):
    random = np.random.default_rng(seed)
    obj, eye, quat = heap(seed), random.uniform(-1.5, 1.5, 3), rot.normalize(random.normal(size=4))
    found, expected = (look(obj, eye, quat, PELVIS_RIG) for look in (inverse_depth, by_slabs))
    # but for centers of pixels on an edge
    assert (abs(found - expected) > 1e-4 * (1 + expected)).sum() <= 2


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.booleans())
def test_faces_are_nowhere_but_in_their_rows(seed, near):
    """Near to the cameras faces reach behind them, and their corners no longer tell where they are."""
    random = np.random.default_rng(seed)
    quat = rot.normalize(random.normal(size=4))
    eye, turn = random.uniform(-1, 1, 3) * (0.5 if near else 2.0), rot.to_matrix(quat)
    eyes, looks = (eye + PELVIS_RIG.origins() @ turn.T)[None], (turn @ PELVIS_RIG.sights(HEIGHT, WIDTH))[None]
    faces = Surfaces.of([faces_of(heap(seed))]).seen_from(eyes, looks, HEIGHT, WIDTH)
    everywhere = replace(faces, first=0 * faces.first, last=0 * faces.last + HEIGHT - 1)
    np.testing.assert_array_equal(filled(faces, 4), filled(everywhere, 4))


def test_what_is_inside_of_the_camera_is_not_seen():
    around = replace(block(), box_half=np.full((1, 3), 2.0))
    assert (inverse_depth(around, np.zeros(3), rot.IDENTITY) == 0).all()


def test_nothing_behind_the_camera_is_seen():
    assert (inverse_depth(block(), np.array([0.6, 0.0, 0.0]), rot.IDENTITY) == 0).all()
    assert (inverse_depth(block(), np.array([-0.9, 0.0, 0.2]), rot.IDENTITY) > 0).any()


@pytest.mark.parametrize("seed", range(3))
def test_convex_pieces_are_those_of_the_physics(seed):
    random = np.random.default_rng(seed)
    hulls = tuple(random.uniform(-0.3, 0.3, (12, 3)) + shift for shift in ([0, 0, 0.4], [0.4, 0.2, 0.4]))
    obj = replace(
        block(),
        box_pos=np.array([[0, 0, 0.4], [0.4, 0.2, 0.4]]),
        box_quat=np.tile(rot.IDENTITY, (2, 1)),
        box_half=np.full((2, 3), 0.3),
        box_rgb=np.ones((2, 3)),
        hulls=hulls,
    )
    physics, eye = NativePhysics(H1, [obj], workers=1), np.array([-0.7, 0.1, 0.4])
    rays = HEAD_RIG.rays(HEIGHT, WIDTH).reshape(1, -1, 3)
    depth = physics.ray(np.broadcast_to(eye + HEAD_RIG.origins(), rays.shape), rays, (1,)).reshape(HEIGHT, WIDTH)
    found = inverse_depth(obj, eye, rot.IDENTITY)[0]
    assert (depth > 0).sum() > 30
    assert (abs(found - np.where(depth > 0, 1 / depth, 0)) > 1e-4).sum() <= 1


def test_boxes_and_convex_pieces_share_a_scene_list():
    corners = np.array([(x, y, z) for x in (-0.25, 0.25) for y in (-0.25, 0.25) for z in (0, 0.42)])
    both = Surfaces.of([faces_of(block()), faces_of(replace(block(), hulls=(corners,)))])
    eyes = np.tile(np.array([-1.0, 0.1, 0.5]) + HEAD_RIG.origins(), (2, 1, 1))
    pictures = filled(both.seen_from(eyes, np.tile(HEAD_RIG.sights(HEIGHT, WIDTH), (2, 1, 1, 1)), HEIGHT, WIDTH), 2)
    assert (pictures[0] > 0).sum() > 15
    np.testing.assert_allclose(pictures[0], pictures[1], atol=1e-5)
