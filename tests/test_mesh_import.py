"""Own meshes: what they become is right by hand, and what they must not become is refused in one sentence, in
bounded time.
"""

import contextlib
import json
import struct
import subprocess
import sys
import time
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch
from scipy.spatial import ConvexHull

import shapes
import stool
from mimicbench.core import rotations as rot
from mimicbench.core.bounded import run_bounded
from mimicbench.core.errors import BadFile, BadObject, MimicbenchError
from mimicbench.objects.families.chair import make_chair
from mimicbench.objects.importing.convex import box_around, fewer_corners, split
from mimicbench.objects.importing.mend import close_holes
from mimicbench.objects.importing.mesh import MAX_BYTES, Mesh, check_bytes, checked, parse_bytes
from mimicbench.objects.importing.own import ImportConfig, import_mesh, import_objects, own_ids, tops
from mimicbench.objects.importing.placing import KINDS, Wishes, place
from mimicbench.objects.importing.planes import SIT, find_plane, surfaces
from mimicbench.objects.importing.topology import topology
from mimicbench.objects.registry import make_object
from mimicbench.objects.shape import SLOTS, load_object
from mimicbench.sim.native import NativePhysics
from mimicbench.sim.physics import PhysicsConfig
from mimicbench.sim.scene import MESH_NODES, build_model
from stool import H1, block, seated
from stool import place as put

FORMATS = ("obj", "ply", "stl", "glb")


def saved(mesh, path):
    """The mesh in the file's format, with what is usual there: y up in OBJ and GLB."""
    (shapes.y_up(mesh) if path.suffix in (".obj", ".glb") else mesh).export(path)
    return path


def as_mesh(found):
    return Mesh(np.asarray(found.vertices, float), np.asarray(found.faces, np.int64))


@pytest.mark.parametrize("kind", FORMATS)
def test_a_chair_of_boxes_comes_back_as_these_boxes(tmp_path, kind):
    obj, evidence = import_mesh(saved(shapes.chair(), tmp_path / f"Chair No. 1.{kind}"), "chair", ImportConfig())
    assert obj.id == "own-chair-no-1" and obj.family == "chair" and not obj.hulls
    sizes = sorted(tuple(np.round(2 * half, 6)) for half in obj.box_half)
    assert sizes == sorted([(0.44, 0.46, 0.04), (0.03, 0.46, 0.45), *[(0.04, 0.04, 0.41)] * 4])
    low, high = obj.bounds()
    np.testing.assert_allclose([*low, *high], [-0.22, -0.23, 0, 0.22, 0.23, 0.9], atol=1e-6)
    assert obj.box_pos[obj.box_pos[:, 2].argmax(), 0] < -0.15, "the back is behind"
    assert obj.seat_height == pytest.approx(0.45, abs=1e-6)
    # the seat but for the 3 cm below the back, to a cell of 2 cm
    np.testing.assert_allclose(
        [*obj.seat_polygon.min(0), *obj.seat_polygon.max(0)], [-0.19, -0.23, 0.22, 0.23], atol=0.011
    )
    assert evidence.seat_area == pytest.approx(0.41 * 0.46, rel=0.06)
    x, y = obj.seat_polygon.T
    assert (np.roll(y, -1) * x - np.roll(x, -1) * y).sum() > 0, "counter-clockwise"
    assert evidence.up == ("y+" if kind in ("obj", "glb") else "z+") and evidence.front == (
        "z-" if kind in ("obj", "glb") else "x+"
    )


@pytest.fixture(scope="module")
def sofa(tmp_path_factory):
    return import_mesh(saved(shapes.sofa(), tmp_path_factory.mktemp("sofa") / "sofa.glb"), "sofa", ImportConfig())


def test_a_sofa_is_split_into_convex_pieces_that_follow_it(sofa):
    obj, evidence = sofa
    assert 4 <= len(obj.hulls) <= SLOTS
    whole = shapes.sofa()
    volume = sum(ConvexHull(hull).volume for hull in obj.hulls)
    assert volume == pytest.approx(whole.volume, rel=0.08)
    assert obj.seat_height == pytest.approx(0.425, abs=0.012)
    assert evidence.mesh_seat_height == pytest.approx(0.425, abs=0.01)
    low, high = obj.seat_polygon.min(0), obj.seat_polygon.max(0)
    np.testing.assert_allclose([low[1], high[1]], [-0.78, 0.78], atol=0.02)
    assert -0.2 < low[0] < -0.1 and 0.34 < high[0] < 0.43, "between the back and the round front"
    # the pieces' top against the sofa's own section
    for hull, half, pos, quat in zip(obj.hulls, obj.box_half, obj.box_pos, obj.box_quat, strict=True):
        assert (np.abs(rot.rotate_inverse(quat, hull - pos)) <= half + 1e-9).all(), "a box encloses its piece"
    line = np.column_stack([np.linspace(-0.10, 0.30, 9), np.zeros(9)])
    np.testing.assert_allclose(tops(obj.hulls, line), 0.425, atol=0.015)


def test_saved_and_loaded_with_its_pieces(tmp_path, sofa):
    path = saved(shapes.sofa(), tmp_path / "sofa.glb")
    said = []
    stage, evidence = import_objects(tmp_path / "objects", "sit-sofa", "sofa", [path], ImportConfig(), said.append)
    assert stage.complete and stage.header["summary"]["count"] == 1 and "plane at 0.4" in said[0]
    assert stage.header["summary"]["test"] in (0, 1)
    again = load_object(tmp_path / "objects", "own-sofa")
    assert json.dumps(again.to_dict()) == json.dumps(sofa[0].to_dict()), "the same file gives the same object"
    assert json.loads((tmp_path / "objects" / "evidence" / "own-sofa.json").read_text())["sha256"] == evidence[0].sha256
    stamp = (tmp_path / "objects" / "own-sofa.json").stat().st_mtime_ns
    assert import_objects(tmp_path / "objects", "sit-sofa", "sofa", [path], ImportConfig(), said.append)[1] == evidence
    assert len(said) == 1
    assert (tmp_path / "objects" / "own-sofa.json").stat().st_mtime_ns == stamp
    with pytest.raises(MimicbenchError, match="another"):
        import_objects(tmp_path / "objects", "sit-sofa", "sofa", [path], ImportConfig(pieces="boxes"), said.append)


def test_a_shapenet_chair_gets_the_size_of_a_chair(tmp_path):
    mesh = shapes.y_up(shapes.chair())
    mesh.vertices /= np.linalg.norm(mesh.extents)
    mesh.export(tmp_path / "model_normalized.obj")
    obj, evidence = import_mesh(tmp_path / "model_normalized.obj", "chair", ImportConfig())
    assert evidence.up == "y+" and evidence.front == "z-" and "normalized" in evidence.reasons[0]
    assert np.exp(np.log(np.ptp(obj.bounds(), axis=0) / [0.54, 0.62, 0.81]).mean()) == pytest.approx(1, rel=0.01)
    obj, usual = import_mesh(tmp_path / "model_normalized.obj", "chair", ImportConfig(Wishes(height=0.9)))
    assert obj.seat_height == pytest.approx(0.45, abs=1e-4)
    _, high = import_mesh(tmp_path / "model_normalized.obj", "chair", ImportConfig(Wishes(height=1.2)))
    assert [any("if this is no chair" in one for one in found.reasons) for found in (usual, high)] == [False, True]


@pytest.mark.parametrize(("unit", "factor"), [("mm", 1000.0), ("cm", 100.0), ("in", 1 / 0.0254), ("m", 1.0)])
def test_units_are_told_by_the_size(unit, factor):
    mesh = shapes.chair()
    placed = place(Mesh(mesh.vertices * factor, mesh.faces), KINDS["chair"], "stl", Wishes())
    assert f"the unit is {unit}" in placed.reasons[0]
    assert placed.plane is not None and placed.plane.height == pytest.approx(0.45, abs=1e-6)


@pytest.mark.parametrize("up", ["x+", "x-", "y+", "y-", "z+", "z-"])
def test_axes_can_be_given(up):
    mesh = shapes.chair()
    front = "y+" if up[0] != "y" else "z-"
    x, z = (np.eye(3)["xyz".index(axis[0])] * (1 if axis[1] == "+" else -1) for axis in (front, up))
    turned = mesh.vertices @ np.stack([x, np.cross(z, x), z]) + [3.0, -2.0, 7.0]
    for wishes in (Wishes(up=up), Wishes(up=up, front=front)):
        placed = place(Mesh(turned, mesh.faces), KINDS["chair"], "ply", wishes)
        assert (placed.up, placed.front) == (up, front)
        np.testing.assert_allclose(np.sort(placed.mesh.vertices, 0), np.sort(mesh.vertices, 0), atol=1e-9)


def test_a_bed_has_its_head_at_the_headboard(tmp_path):
    bed = shapes.joined(
        [shapes.box((-1.0, 1.0), (-0.8, 0.8), (0.0, 0.5)), shapes.box((-1.06, -1.0), (-0.8, 0.8), (0.0, 1.0))]
    )
    bed.vertices = bed.vertices[:, [1, 0, 2]] * [1, -1, 1]  # the front to -y, as usual with z up
    bed.export(tmp_path / "bed.stl")
    obj, evidence = import_mesh(tmp_path / "bed.stl", "bed", ImportConfig())
    assert obj.seat_height == pytest.approx(0.5) and evidence.front == "y-"
    assert np.ptp(obj.seat_polygon[:, 0]) == pytest.approx(2.0, abs=0.03)
    np.testing.assert_allclose(obj.head_xy, [-0.97 + 0.25, 0], atol=0.03)


def test_a_table_can_be_touched_and_a_box_lifted(tmp_path):
    obj, _ = import_mesh(saved(shapes.table(), tmp_path / "table.ply"), "household", ImportConfig())
    assert len(obj.touch_points) >= 2 and obj.seat_height is None
    obj, _ = import_mesh(
        saved(shapes.box((0, 0.4), (0, 0.4), (0, 0.5)), tmp_path / "crate.stl"), "box", ImportConfig(mass=3.0)
    )
    assert obj.movable and build_model(H1, obj).body("object").mass[0] == pytest.approx(3.0)


# -- planes


def test_no_plane_where_there_is_no_headroom_or_a_slope():
    seat = shapes.box((-0.25, 0.25), (-0.25, 0.25), (0, 0.45))
    assert find_plane(surfaces(as_mesh(seat)), SIT) is not None
    shelf = shapes.joined([seat, shapes.box((-0.25, 0.25), (-0.25, 0.25), (0.8, 0.82))])
    assert find_plane(surfaces(as_mesh(shelf)), SIT) is None, "0.35 m below a shelf"
    tilted = seat.copy()
    tilted.vertices[:, 2] += 0.5 * tilted.vertices[:, 0]
    assert find_plane(surfaces(as_mesh(tilted)), SIT) is None, "27 degrees steep"
    assert find_plane(surfaces(as_mesh(shapes.table())), SIT) is None, "0.84 m high"


def test_the_largest_plane_wins_over_armrests():
    arms = [shapes.box((-0.25, 0.25), side, (0, 0.62)) for side in ((-0.40, -0.27), (0.27, 0.40))]
    found = find_plane(
        surfaces(as_mesh(shapes.joined([*arms, shapes.box((-0.25, 0.25), (-0.27, 0.27), (0, 0.42))]))), SIT
    )
    assert found is not None and found.height == pytest.approx(0.42)
    assert found.area == pytest.approx(0.5 * 0.54, rel=0.08)


# -- pieces


def test_boxes_that_touch_stay_apart_and_open_ones_are_closed():
    pair = shapes.joined([shapes.box((0, 1), (0, 1), (0, 1)), shapes.box((0, 1), (0, 1), (1, 2))])
    mesh = checked(pair.vertices, pair.faces, "pair")
    found = topology(mesh)
    assert len(found.closed) == 2 and found.closed.all()
    open_box = shapes.box((0, 1), (0, 1), (0, 1))
    open_box.update_faces(open_box.face_normals[:, 2] > -0.5)
    mesh = checked(open_box.vertices, open_box.faces, "open")
    assert not topology(mesh).closed.any()
    mended, found, notes = close_holes(mesh, topology(mesh))
    assert found.closed.all() and notes == ["1 holes were closed"]
    bin_ = shapes.box((0, 1), (0, 1), (0, 1))
    bin_.update_faces(bin_.face_normals[:, 2] < 0.5)
    mesh = checked(bin_.vertices, bin_.faces, "bin")
    assert not close_holes(mesh, topology(mesh))[1].closed.any(), "what opens upwards is no block"


def test_many_parts_are_joined_to_what_a_scene_has_room_for():
    slats = shapes.joined([shapes.box((0.1 * i, 0.1 * i + 0.05), (0, 0.5), (0, 0.02)) for i in range(30)])
    mesh = as_mesh(slats)
    pieces, notes = split(mesh, topology(mesh))
    assert len(pieces) == SLOTS and "30 pieces" in notes[-1]
    np.testing.assert_allclose(
        [np.concatenate(pieces).min(0), np.concatenate(pieces).max(0)], [slats.bounds[0], slats.bounds[1]]
    )


def test_fewer_corners_keep_the_shape_and_boxes_are_tight():
    random = np.random.default_rng(0)
    points = random.normal(size=(400, 3))
    ball = points / np.linalg.norm(points, axis=1, keepdims=True)
    few = fewer_corners(ball)
    assert len(few) == 24 and ConvexHull(few).volume > 0.6 * ConvexHull(ball).volume
    quat, half = rot.normalize(random.normal(size=4)), np.array([0.5, 0.2, 0.05])
    corners = rot.rotate(quat, half * np.stack(np.meshgrid(*[[-1, 1]] * 3), -1).reshape(8, 3)) + [1, 2, 3]
    pos, found, sides = box_around(corners)
    np.testing.assert_allclose(pos, [1, 2, 3], atol=1e-9)
    np.testing.assert_allclose(np.sort(sides), np.sort(half), atol=1e-9)
    assert (np.abs(rot.rotate_inverse(found, corners - pos)) <= sides + 1e-9).all()


# -- physics


def test_imported_and_made_objects_share_a_batch_bit_for_bit(sofa):
    """A batch takes models of meshes beside models of boxes, as long as all have trees of one size."""
    objects = [sofa[0], make_chair(0), block(), make_chair(1)]
    models = [build_model(H1, obj, meshes=True) for obj in objects]
    assert {model.nbvh for model in models} == {MESH_NODES + build_model(H1, block()).nbvh}
    types = [model.geom("object_0").type[0] for model in models]
    assert mujoco.mjtGeom.mjGEOM_MESH in types and mujoco.mjtGeom.mjGEOM_BOX in types
    pos, joints = seated(0.43)
    states = []
    for workers in (1, 2):
        physics = NativePhysics(H1, objects, workers=workers)
        put(physics, pos, joints)
        for _ in range(25):
            physics.step(torch.tensor(joints).expand(4, 19))
        states.append(physics.qpos().copy())
    assert states[0].tobytes() == states[1].tobytes()
    for env, model in enumerate(models):
        data = mujoco.MjData(model)
        data.qpos[:], data.ctrl[:] = [*pos, 1, 0, 0, 0, *joints], joints
        mujoco.mj_step(model, data, 100)
        assert data.qpos.tobytes() == states[0][env].tobytes()


def test_a_batch_without_room_says_so(sofa):
    physics = NativePhysics(H1, [block()], workers=1)
    with pytest.raises(MimicbenchError, match="meshes=True"):
        stool.exchange(physics, [sofa[0]])
    stool.exchange(NativePhysics(H1, [block()], PhysicsConfig(meshes=True), workers=1), [sofa[0]])


def test_rays_meet_the_imported_seat_where_its_label_says(sofa):
    obj = sofa[0]
    model = build_model(H1, obj)
    # rays straight down meet the seat where the label says it is
    data = mujoco.MjData(model)
    data.qpos[:3] = 5.0
    mujoco.mj_forward(model, data)
    groups, geom = np.array([0, 1, 0, 0, 0, 0], np.uint8), np.zeros(1, np.int32)
    low, high = obj.seat_polygon.min(0), obj.seat_polygon.max(0)
    for x in np.linspace(low[0] + 0.04, high[0] - 0.04, 5):
        for y in np.linspace(low[1] + 0.04, high[1] - 0.04, 5):
            depth = mujoco.mj_ray(model, data, np.array([x, y, 2.0]), np.array([0, 0, -1.0]), groups, 1, -1, geom, None)
            assert 2.0 - depth == pytest.approx(obj.seat_height, abs=0.02)


def test_a_robot_sits_on_the_imported_sofa(sofa):
    physics = NativePhysics(H1, [sofa[0]], workers=1)
    pos, joints = seated(sofa[0].seat_height)
    pos[0] = 0.1
    put(physics, pos, joints)
    for _ in range(100):
        physics.step(torch.tensor(joints)[None])
    height = physics.state().root_pos_w[0, 2].item() - sofa[0].seat_height
    assert 0.0 < height < 0.27 and not physics.diverged.any()


# -- ids


def test_ids_are_safe_and_unique(tmp_path):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "My Chair.obj").write_text(f"# {folder}")
    files = [
        tmp_path / "a" / "My Chair.obj",
        tmp_path / "b" / "My Chair.obj",
        tmp_path / "0-00042.stl",
        tmp_path / "...---.ply",
    ]
    ids = own_ids(files)
    assert len(set(ids)) == 4 and all(
        name.startswith("own-") and name.replace("-", "").isalnum() and name.isascii() for name in ids
    )
    assert own_ids(files[::-1]) == ids[::-1], "whatever their order"
    with pytest.raises(MimicbenchError):
        make_object(ids[2])
    with pytest.raises(MimicbenchError, match="twice"):
        own_ids([files[0], files[0]])


# -- bad input


def refusal(path, family="chair", **wishes):
    start = time.monotonic()
    with pytest.raises(MimicbenchError) as error:
        import_mesh(path, family, ImportConfig(Wishes(**wishes)))
    assert time.monotonic() - start < 8
    message = str(error.value)
    assert path.name in message and "\n" not in message and len(message) < 600
    return message


def write(path, data):
    path.write_bytes(data)
    return path


def glb(gltf, binary=b""):
    text = json.dumps(gltf).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I", len(text)) + b"JSON" + text
    if binary:
        chunks += struct.pack("<I", len(binary)) + b"BIN\0" + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def test_missing_empty_and_foreign_files(tmp_path):
    assert "does not exist" in refusal(tmp_path / "nowhere.obj")
    for kind in FORMATS:
        assert "is empty" in refusal(write(tmp_path / f"empty.{kind}", b" \n"))
        assert "no " in refusal(write(tmp_path / f"text.{kind}", b"Dear reader,\nthis is no mesh.\n"))
    assert "none of .obj" in refusal(write(tmp_path / "chair.fbx", b"Kaydara FBX"))
    assert ".glb" in refusal(write(tmp_path / "chair.gltf", b"{}"))
    assert "holds no faces" in refusal(write(tmp_path / "points.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"))


def test_packed_files_are_not_unpacked(tmp_path):
    for magic, name in (
        (b"PK\x03\x04", "zip"),
        (b"\x1f\x8b\x08", "gzip"),
        (b"BZh9", "bzip2"),
        (b"\xfd7zXZ\0", "xz"),
        (b"\x28\xb5\x2f\xfd", "zstd"),
    ):
        for kind in FORMATS:
            assert f"packed with {name}" in refusal(write(tmp_path / f"bomb.{kind}", magic + bytes(range(1, 99))))
    assert "draco" in refusal(
        write(
            tmp_path / "d.glb", glb({"asset": {"version": "2.0"}, "extensionsRequired": ["KHR_draco_mesh_compression"]})
        )
    )


def test_cut_off_files(tmp_path):
    for kind in FORMATS:
        whole = saved(shapes.chair(), tmp_path / f"whole.{kind}").read_bytes()
        refusal(write(tmp_path / f"cut.{kind}", whole[: len(whole) // 2]))


def test_too_many_faces_are_refused_unread(tmp_path):
    with open(tmp_path / "large.stl", "wb") as stream:
        stream.truncate(84 + 50 * 10_000_000)
    assert "more than" in refusal(tmp_path / "large.stl") and (tmp_path / "large.stl").stat().st_size > MAX_BYTES
    header = (
        b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty "
        b"float y\nproperty float z\nelement face 10000000\n"
    )
    header += b"property list uchar int vertex_indices\nend_header\n"
    assert "promises" in refusal(write(tmp_path / "liar.ply", header + bytes(36)))
    assert "10000000 faces" in refusal(write(tmp_path / "many.ply", header + bytes(11_000_000)))
    fan = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf" + b" 1 2 3" * 400_000 + b"\n"
    assert "more than 500000 faces" in refusal(write(tmp_path / "fan.obj", fan))
    accessor = {"count": 2_000_000_000, "componentType": 5126, "type": "VEC3"}
    mesh = {"primitives": [{"attributes": {"POSITION": 0}}]}
    gltf = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [mesh],
        "accessors": [accessor],
    }
    assert "more numbers" in refusal(write(tmp_path / "liar.glb", glb(gltf)))
    gltf["accessors"][0]["count"] = 300
    gltf["nodes"] = [{"children": [i + 1, i + 1]} for i in range(40)] + [{"mesh": 0}]
    assert "uses a node twice" in refusal(write(tmp_path / "laughs.glb", glb(gltf, bytes(4000))))


@pytest.mark.parametrize("value", ["nan", "1e30", "1e400"])
def test_numbers_that_cannot_be(tmp_path, value):
    text = saved(shapes.chair(), tmp_path / "chair.obj").read_text().splitlines()
    first = next(i for i, line in enumerate(text) if line.startswith("v "))
    text[first] = f"v {value} 0 0"
    message = refusal(write(tmp_path / "bad.obj", "\n".join(text).encode() + b"\n"))
    assert "finite" in message or "beyond" in message


def test_other_files_are_never_read(tmp_path):
    secret = tmp_path / "secret.bin"
    secret.write_bytes(bytes(36))
    base = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "accessors": [],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
    }
    for uri in (
        "secret.bin",
        "../secret.bin",
        f"file://{secret}",
        "http://127.0.0.1:9/x.bin",
    ):
        assert "refers to another file" in refusal(
            write(tmp_path / "outside.glb", glb({**base, "buffers": [{"uri": uri, "byteLength": 36}]}))
        )
    # an OBJ's materials and a PLY's texture are left alone, even where they name a directory or a device
    text = saved(shapes.chair(), tmp_path / "chair.obj").read_bytes()
    obj, _ = import_mesh(
        write(tmp_path / "material.obj", b"mtllib /dev/stdin\nmtllib ../../secret.bin\nusemtl a\n" + text),
        "chair",
        ImportConfig(),
    )
    assert len(obj.box_pos) == 6
    text = saved(shapes.chair(), tmp_path / "chair.ply").read_bytes()
    obj, _ = import_mesh(
        write(tmp_path / "texture.ply", text.replace(b"\nelement", b"\ncomment TextureFile /dev/zero\nelement", 1)),
        "chair",
        ImportConfig(),
    )
    assert len(obj.box_pos) == 6


def test_millimeters_taken_for_meters(tmp_path):
    mesh = shapes.chair()
    mesh.vertices *= 1000
    path = saved(mesh, tmp_path / "mm.stl")
    message = refusal(path, unit="m")
    assert "900 x" in message and "--unit mm" in message
    assert "only one of" in refusal(path, unit="mm", height=0.9)
    assert "same axis" in refusal(path, up="z+", front="z-")
    assert "positive" in refusal(path, height=-1.0)


def test_no_plane_to_sit_on(tmp_path):
    message = refusal(saved(shapes.table(), tmp_path / "table.ply"))
    assert "no level, free surface" in message and "0.25 to 0.75 m" in message
    ball = shapes.trimesh.creation.icosphere(radius=0.35)
    assert "no level" in refusal(saved(ball, tmp_path / "ball.stl"))
    line = b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"
    assert "no extent" in refusal(write(tmp_path / "line.obj", line))


def test_what_runs_apart_is_bounded():
    start = time.monotonic()
    with pytest.raises(BadFile, match="more than 1 s"):
        run_bounded(
            "multiprocessing.connection", "wait", {"object_list": np.zeros(0)}, 1.0, 2 << 30, "x: "
        )  # waits forever
    assert time.monotonic() - start < 5
    with pytest.raises(BadFile, match="MiB of memory"):
        run_bounded("numpy", "ones", {"shape": np.array(1 << 32)}, 20.0, 2 << 30, "x: ")
    with pytest.raises(BadFile, match="x: ValueError"):
        run_bounded("numpy", "ones", {"shape": np.array(-1)}, 20.0, 2 << 30, "x: ")
    with pytest.raises(BadFile, match="status -6"):
        run_bounded("os", "abort", {}, 20.0, 2 << 30, "x: ")


def test_a_command_makes_objects_and_repeats_for_free(tmp_path):
    saved(shapes.chair(), tmp_path / "chair.obj")

    def command(*arguments):
        return subprocess.run(
            [sys.executable, "-m", "mimicbench.cli", "objects", *arguments],
            capture_output=True,
            text=True,
            cwd=tmp_path,
            check=False,
        )

    first = command("import", "chair.obj", "--workdir", "w", "--json")
    found = json.loads(first.stdout)
    assert found["count"] == 1 and found["imported"][0]["seat_height"] == pytest.approx(0.45, abs=1e-6)
    assert command("import", "chair.obj", "--workdir", "w", "--json").stdout == first.stdout
    bad = command("import", "chair.obj", "missing.stl", "--workdir", "v")
    assert (
        bad.returncode == 2
        and bad.stderr.strip().splitlines()[-1] == "mimicbench: missing.stl does not exist or is no file"
        and not (tmp_path / "v").exists()
    )
    assert "give at least one file" in command("import").stderr
    assert json.loads(command("--count", "2", "--workdir", "u", "--json").stdout)["count"] == 2, (
        "the plain command still makes objects"
    )


# -- fuzzing, in a process with limits, since nothing may hang or take all memory


def mutated(data, random):
    data = bytearray(data)
    for _ in range(random.integers(1, 4)):
        n = max(len(data), 1)
        i = int(random.integers(n))
        j = min(n, i + int(random.integers(1, 40)))
        choice = random.integers(6)
        if choice == 0 and data:
            data[i] = int(random.integers(256))
        elif choice == 1:
            del data[i:j]
        elif choice == 2:
            data[i:i] = random.integers(0, 256, random.integers(1, 20), dtype=np.uint8).tobytes()
        elif choice == 3:
            data = data[:i]
        elif choice == 4:
            data[i:i] = data[i:j] * int(random.integers(1, 50))
        else:
            data[i:j] = random.choice(
                [b"nan", b"1e30", b"-1", b"9999999999", b"\xff\xff\xff\x7f", b"\n", b"{", b'"uri":"/etc/passwd"', b"0"]
            )
    return bytes(data)


def mutated_glb(data, random):
    """A GLB whose numbers in the JSON are others, and whose lengths are right."""
    length = int.from_bytes(data[12:16], "little")
    words = (
        data[20 : 20 + length]
        .decode()
        .replace(",", " , ")
        .replace("[", " [ ")
        .replace("]", " ] ")
        .replace("}", " } ")
        .replace(":", " : ")
        .split(" ")
    )
    numbers = [i for i, word in enumerate(words) if word.isdigit()]
    for i in random.choice(numbers, random.integers(1, 4)):
        words[i] = str(
            random.choice(
                ["-1", "0", "1", "3", "255", "1e30", "99999999999", "null", '"x"', "[]", "{}", "5121", "5126", "5125"]
            )
        )
    text = "".join(words).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    return b"glTF" + struct.pack("<III", 2, 20 + len(text) + len(rest), len(text)) + b"JSON" + text + rest


def fuzz(count, seed):
    import resource
    import warnings

    resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))
    warnings.simplefilter("ignore")
    random = np.random.default_rng(seed)
    mesh = shapes.chair()
    wholes = [(kind, mesh.export(file_type=kind)) for kind in FORMATS]
    wholes += [("stl", mesh.export(file_type="stl_ascii")), ("ply", mesh.export(file_type="ply", encoding="ascii"))]
    outcomes = {"read": 0, "refused": 0}
    slowest = 0.0
    for i in range(count):
        kind, whole = wholes[i % len(wholes)]
        whole = whole.encode() if isinstance(whole, str) else whole
        data = mutated_glb(whole, random) if kind == "glb" and i % 4 else mutated(whole, random)
        start = time.monotonic()
        try:
            check_bytes(data, kind, "file")
            found = parse_bytes(np.frombuffer(data, np.uint8), np.array(kind))
            mesh_ = checked(found["vertices"], found["faces"], "file")
            with contextlib.suppress(BadObject):
                place(mesh_, KINDS["chair"], kind, Wishes())
            outcomes["read"] += 1
        except BadFile:
            outcomes["refused"] += 1
        slowest = max(slowest, time.monotonic() - start)
    # not ru_maxrss, which a process has from the one that started it
    peak = int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])
    print(json.dumps({**outcomes, "slowest": slowest, "mebibytes": peak >> 10}))


def test_mutated_files_are_read_or_refused():
    done = subprocess.run(
        [sys.executable, __file__, "300", "7"], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["read"] + found["refused"] == 300 and found["read"] > 20
    assert found["slowest"] < 3 and found["mebibytes"] < 800


if __name__ == "__main__":
    fuzz(int(sys.argv[1]), int(sys.argv[2]))


def test_armrests_do_not_outweigh_a_thin_back(tmp_path):
    """An armchair whose armrests, and the posts before them, are as many cells as its back."""
    arms = [shapes.box((-0.26, 0.30), (y, y + 0.04), (0.60, 0.64)) for y in (-0.32, 0.28)]
    posts = [shapes.box((0.24, 0.30), (y, y + 0.04), (0.45, 0.60)) for y in (-0.32, 0.28)]
    seat = [
        shapes.box((-0.30, 0.30), (-0.32, 0.32), (0.39, 0.45)),
        shapes.box((-0.30, -0.28), (-0.32, 0.32), (0.45, 0.95)),
    ]
    legs = [shapes.box((x, x + 0.05), (y, y + 0.05), (0, 0.39)) for x in (-0.30, 0.25) for y in (-0.32, 0.27)]
    path = tmp_path / "armchair.stl"
    shapes.joined([*seat, *arms, *posts, *legs]).export(path)
    assert import_mesh(path, "chair", ImportConfig())[1].front == "x+"
    turned = shapes.joined([*seat, *arms, *posts, *legs])
    turned.apply_transform(np.diag([-1.0, -1.0, 1.0, 1.0]))
    turned.export(path)
    assert import_mesh(path, "chair", ImportConfig())[1].front == "x-"
