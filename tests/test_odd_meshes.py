"""Meshes as people really have them: every face twice, curved and tufted seats, toys, odd PLY, GLB by the letter."""

import base64
import json
import struct

import numpy as np
import pytest
import trimesh

import shapes
from mimicbench.core.errors import BadFile, BadObject
from mimicbench.objects.importing import mesh as reading
from mimicbench.objects.importing.mesh import Mesh, read_mesh
from mimicbench.objects.importing.own import ImportConfig, import_mesh
from mimicbench.objects.importing.placing import KINDS, Wishes, place
from mimicbench.objects.importing.planes import SIT, find_plane, surfaces
from mimicbench.objects.importing.ply import read_ply
from mimicbench.objects.importing.polygons import triangles
from mimicbench.objects.importing.sheets import agreed, one_sheet
from mimicbench.objects.importing.topology import topology
from mimicbench.robots.registry import ROBOTS
from mimicbench.sim.scene import build_model


def as_mesh(found):
    return Mesh(np.asarray(found.vertices, float), np.asarray(found.faces, np.int64))


def both_sides(found):
    return trimesh.Trimesh(found.vertices, np.concatenate([found.faces, found.faces[:, ::-1]]), process=False)


# -- sheets


def test_faces_that_come_twice_are_one_sheet():
    chair = as_mesh(shapes.chair())
    doubled = as_mesh(both_sides(shapes.chair()))
    once, pairs = one_sheet(doubled)
    assert pairs == len(chair.faces) == len(once.faces)
    assert topology(once).closed.all(), "boxes are closed again, and not inside out here and there"
    found = find_plane(surfaces(Mesh(once.vertices, once.faces)), SIT)
    assert found is not None and found.height == pytest.approx(0.45)


@pytest.mark.parametrize("wishes", [Wishes(), Wishes(height=0.45), Wishes(up="z+", height=0.45)])
def test_a_flat_mesh_is_no_object_however_high_it_is_to_be(tmp_path, wishes):
    (tmp_path / "sheet.obj").write_text("v 0 0 0.4\nv 0.5 0 0.4\nv 0.5 0.5 0.4\nv 0 0.5 0.4\nf 1 2 3 4\n")
    with pytest.raises(BadObject, match=r"sheet\.obj: it is flat, 0\.5 x 0\.5 x 0 in the file's unit; give a mesh"):
        import_mesh(tmp_path / "sheet.obj", "chair", ImportConfig(wishes))


def test_where_two_boxes_touch_both_keep_their_face():
    pair = shapes.joined([shapes.box((0, 1), (0, 1), (0, 1)), shapes.box((0, 1), (0, 1), (1, 2))])
    mesh = reading.checked(pair.vertices, pair.faces, "pair")
    same, pairs = one_sheet(mesh)
    assert pairs == 0 and len(same.faces) == 24 and topology(same).closed.all()


def test_neighbors_agree_on_the_outside():
    ball = as_mesh(trimesh.creation.icosphere(2))
    mixed = ball.faces.copy()
    flipped = np.random.default_rng(0).uniform(size=len(mixed)) < 0.4
    mixed[flipped] = mixed[flipped][:, ::-1]
    assert not topology(Mesh(ball.vertices, mixed)).closed.all()
    assert topology(Mesh(ball.vertices, agreed(mixed))).closed.all()


def test_a_chair_of_sheets_seen_from_both_sides_is_imported(tmp_path):
    """ROAM's and ShapeNet's are like this: thin sheets, each face also reversed."""
    parts = [
        shapes.box((-0.25, 0.25), (-0.25, 0.25), (0.44, 0.44 + 1e-5)),
        shapes.box((-0.25, -0.25 + 1e-5), (-0.25, 0.25), (0.44, 0.95)),
        *(shapes.box((x, x + 1e-5), (-0.25, 0.25), (0.0, 0.44)) for x in (-0.24, 0.24)),
    ]
    tops = [part.faces[part.face_normals[:, axis] > 0.5] for part, axis in zip(parts, (2, 0, 0, 0), strict=True)]
    sheets = shapes.joined([trimesh.Trimesh(p.vertices, f, process=True) for p, f in zip(parts, tops, strict=True)])
    chair = shapes.y_up(both_sides(sheets))
    chair.export(tmp_path / "chair.obj")
    obj, evidence = import_mesh(tmp_path / "chair.obj", "chair", ImportConfig())
    assert obj.seat_height == pytest.approx(0.44, abs=0.01) and evidence.front == "z-"
    assert any("come twice, once reversed" in reason for reason in evidence.reasons)


@pytest.mark.parametrize("width", [1e-15, 1e-9, 1e-5])
def test_a_needle_beside_a_chair_is_left_out(width, tmp_path):
    """No physics could take a piece of it, nor could anybody touch it."""
    needle = trimesh.Trimesh([[0, 0, 1.0], [0.3, 0, 1.0], [0.15, width, 1.0]], [[0, 1, 2]], process=False)
    trimesh.util.concatenate([shapes.chair(), needle]).export(tmp_path / "chair.obj", digits=17)
    obj, evidence = import_mesh(tmp_path / "chair.obj", "chair", ImportConfig(Wishes(unit="m", up="z+")))
    assert len(obj.box_pos) == 6 and any("in two directions" in reason for reason in evidence.reasons)
    assert build_model(ROBOTS.get("h1"), obj).nbody > 1


# -- seats


def cushion(height, size=0.5, step=0.02):
    """A block whose top is height(x, y)."""
    grid = np.arange(-size / 2, size / 2 + step / 2, step)
    x, y = np.meshgrid(grid, grid, indexing="ij")
    n = len(grid)
    corner = np.arange(n * n).reshape(n, n)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    top = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    vertices = np.stack([x, y, height(x, y)], -1).reshape(-1, 3)
    base = vertices * [1, 1, 0]
    rim = np.concatenate([corner[:, 0], corner[-1, 1:], corner[-2::-1, -1], corner[0, -2:0:-1]])
    after = np.roll(rim, -1)
    walls = np.concatenate([np.stack([rim + n * n, after + n * n, after], -1), np.stack([rim + n * n, after, rim], -1)])
    return Mesh(np.concatenate([vertices, base]), np.concatenate([top, top[:, ::-1] + n * n, walls]))


def test_a_tufted_seat_is_a_plane():
    """Buttons make most of its facets steeper than 20 degrees."""
    tufted = cushion(lambda x, y: 0.45 + 0.014 * np.sin(70 * x) * np.sin(70 * y), step=0.01)
    found = find_plane(surfaces(tufted), SIT)
    assert found is not None and found.height == pytest.approx(0.45, abs=0.01)
    assert found.area == pytest.approx(0.25, rel=0.15)


def test_a_seat_that_leans_back_is_a_plane_as_a_whole():
    found = find_plane(surfaces(cushion(lambda x, y: 0.45 + np.tan(np.radians(10)) * x)), SIT)
    assert found is not None and found.area == pytest.approx(0.25, rel=0.1), "not a strip of it"
    assert found.tilt == pytest.approx(10, abs=0.3) and found.height == pytest.approx(0.45, abs=0.01)
    assert find_plane(surfaces(cushion(lambda x, y: 0.45 + np.tan(np.radians(27)) * x)), SIT) is None


def test_a_curved_seat_is_a_plane():
    found = find_plane(surfaces(cushion(lambda x, y: 0.43 + 0.6 * x**2)), SIT)
    assert found is not None and found.area > 0.2


def test_a_seam_between_cushions_divides_no_sofa():
    cushions = [shapes.box((-0.35, 0.35), side, (0.0, 0.42)) for side in ((-0.8, -0.012), (0.012, 0.8))]
    found = find_plane(surfaces(as_mesh(shapes.joined(cushions))), SIT)
    assert found is not None and found.rectangle[1] == pytest.approx(1.6, abs=0.05)
    rail = shapes.box((-0.35, 0.35), (-0.01, 0.01), (0.0, 0.60))
    found = find_plane(surfaces(as_mesh(shapes.joined([*cushions, rail]))), SIT)
    assert found is not None and found.rectangle[1] < 0.85, "what stands up between two is no seam"


# -- which way up


def curved_lounge_chair():
    """With z up, front to +x: a shell without a level seat, whose back would make a plane if it lay on it."""
    return shapes.joined(
        [
            shapes.box((-0.40, -0.10), (-0.30, 0.30), (0.0, 0.75)),
            trimesh.creation.icosphere(3, 0.28),
            shapes.box((-0.40, 0.45), (-0.40, -0.30), (0.0, 0.12)),
        ]
    )


@pytest.mark.parametrize("normalized", [False, True])
def test_glb_and_normalized_meshes_are_never_laid_on_a_side(tmp_path, normalized):
    mesh = shapes.y_up(curved_lounge_chair())
    if normalized:
        mesh.vertices /= np.linalg.norm(mesh.extents)
    for kind in ("chair", "sofa"):
        try:
            placed = place(as_mesh(mesh), KINDS[kind], "obj" if normalized else "glb", Wishes())
        except BadObject:
            continue
        assert placed.up == "y+"


def test_a_glb_is_z_up_only_where_nothing_else_makes_sense():
    """A plain chair that somebody wrote with z up: nothing like a seat is there with y up."""
    placed = place(as_mesh(shapes.chair(height=1.0)), KINDS["chair"], "glb", Wishes())
    assert placed.up == "z+" and placed.plane is not None
    assert place(as_mesh(shapes.y_up(shapes.chair())), KINDS["chair"], "glb", Wishes()).up == "y+"
    assert all(place(as_mesh(shapes.chair()), KINDS["chair"], kind, Wishes()).up != "x+" for kind in ("obj", "stl"))


def test_an_armrest_at_one_end_is_no_back():
    chaise = shapes.joined(
        [shapes.box((-0.35, 0.35), (-0.8, 0.8), (0, 0.42)), shapes.box((-0.35, 0.35), (0.8, 0.92), (0, 0.65))]
    )
    placed = place(as_mesh(chaise), KINDS["sofa"], "stl", Wishes())
    assert placed.front[0] == "x"


def test_small_furniture_of_games_gets_the_usual_size():
    small = shapes.chair()
    small.vertices *= 0.5
    placed = place(as_mesh(shapes.y_up(small)), KINDS["chair"], "glb", Wishes())
    assert placed.plane is not None and "usual size" in placed.reasons[0]
    assert place(as_mesh(shapes.y_up(small)), KINDS["chair"], "glb", Wishes(unit="m")).plane is None


def test_a_unit_of_nobodys_gives_the_usual_size():
    """5.4 units high, 3.1 deep: no chair in m, cm, mm or in; a chair all the same. Who names a unit is believed."""
    odd = shapes.chair()
    odd.vertices *= 6.0
    placed = place(as_mesh(shapes.y_up(odd)), KINDS["chair"], "obj", Wishes())
    assert placed.plane is not None and "no likely size" in placed.reasons[0]
    logs = np.log(np.sort(np.ptp(placed.mesh.vertices, axis=0)) / np.sort(KINDS["chair"].size))
    assert logs.sum() == pytest.approx(0.0, abs=1e-6), "as large as a chair in the mean of its sides"
    with pytest.raises(BadObject, match="not the size of such an object"):
        place(as_mesh(shapes.y_up(odd)), KINDS["chair"], "obj", Wishes(unit="m"))
    odd.vertices *= [1.0, 1.0, 6.0]
    with pytest.raises(BadObject, match="not the size of such an object"):
        place(as_mesh(shapes.y_up(odd)), KINDS["chair"], "obj", Wishes())


# -- files


def ply_bytes(mesh, order="<", count="uchar", index="int", quad=False, before=b"", after=b""):
    codes = {"uchar": "B", "ushort": "H", "int": "i", "uint": "I", "float": "f"}
    vertices, faces = mesh.vertices, [list(face) for face in mesh.faces]
    if quad:  # the first two triangles are one rectangle
        first, second = faces[:2]
        (new,) = set(second) - set(first)
        at = next(k for k in range(3) if {first[k], first[(k + 1) % 3]} <= set(second))
        faces = [[*first[: at + 1], new, *first[at + 1 :]], *faces[2:]]
    form = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    lines = [f"ply\nformat {form} 1.0\nelement vertex {len(vertices)}"]
    lines += [f"property float {axis}" for axis in "xyz"] + [f"element face {len(faces)}"]
    lines += [before.decode()] if before else []
    lines += [f"property list {count} {index} vertex_indices"]
    lines += [after.decode()] if after else []
    data = ("\n".join(lines) + "\nend_header\n").encode()
    data += b"".join(struct.pack(f"{order}3f", *vertex) for vertex in vertices)
    for face in faces:
        data += b"\7" if before else b""
        data += struct.pack(f"{order}{codes[count]}{len(face)}{codes[index]}", len(face), *face)
        data += struct.pack(f"{order}B2f", 2, 0.5, 0.5) if after else b""
    return data


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"quad": True},
        {"count": "int", "index": "uint"},
        {"count": "ushort", "index": "ushort", "quad": True},
        {"before": b"property uchar flags", "after": b"property list uchar float uv"},
        {"quad": True, "after": b"property list uchar float uv"},
    ],
)
def test_ply_of_either_byte_order_and_any_lists(order, options):
    chair = shapes.chair()
    vertices, faces = read_ply(ply_bytes(chair, order, **options))
    found = trimesh.Trimesh(vertices, faces, process=False)
    assert found.volume == pytest.approx(chair.volume, rel=1e-5)
    np.testing.assert_allclose(found.bounds, chair.bounds, atol=1e-6)


def test_ply_of_text_with_faces_of_many_corners():
    text = b"ply\nformat ascii 1.0\ncomment \xc3\xa4\nelement vertex 5\nproperty float x\nproperty float y\n"
    text += b"property uchar red\nproperty float z\nelement face 2\nproperty list uchar int vertex_index\nend_header\n"
    text += b"0 0 9 0\n1 0 9 0\n1 1 9 0\n0 1 9 0\n0.5 0.5 9 1\n4 0 1 2 3\n3 0 1 4\n"
    vertices, faces = read_ply(text)
    np.testing.assert_array_equal(vertices[4], [0.5, 0.5, 1.0])
    assert sorted(map(tuple, faces.tolist())) == [(0, 1, 2), (0, 1, 4), (0, 2, 3)]


@pytest.mark.parametrize("cut", [0.5, 0.9, 0.99])
def test_cut_ply_is_called_so(cut):
    data = ply_bytes(shapes.chair(), quad=True)
    with pytest.raises(BadFile, match="cut off"):
        read_ply(data[: int(len(data) * cut)])


def glb_bytes(gltf, binary=b""):
    text = json.dumps(gltf).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I", len(text)) + b"JSON" + text
    if binary:
        chunks += struct.pack("<I", len(binary)) + b"BIN\0" + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def gltf_of(mesh, uri=None, sparse=False):
    """A GLB's JSON and binary part, with the numbers in a data: URI if that is wanted."""
    corners, faces = np.asarray(mesh.vertices, "<f4").tobytes(), np.asarray(mesh.faces, "<u4").tobytes()
    whole = corners + faces
    gltf = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(whole)}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": len(corners)},
            {"buffer": 0, "byteOffset": len(corners), "byteLength": len(faces)},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(mesh.vertices), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": mesh.faces.size, "type": "SCALAR"},
        ],
    }
    if uri:
        gltf["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{base64.b64encode(whole).decode()}"
    if sparse:
        gltf["accessors"][0]["sparse"] = {"count": 1}
    return glb_bytes(gltf, b"" if uri else whole)


def test_buffers_within_the_json_are_read_and_sparse_ones_refused(tmp_path):
    chair = shapes.y_up(shapes.chair())
    (tmp_path / "data.glb").write_bytes(gltf_of(chair, uri=True))
    (tmp_path / "plain.glb").write_bytes(gltf_of(chair))
    np.testing.assert_array_equal(read_mesh(tmp_path / "data.glb").vertices, read_mesh(tmp_path / "plain.glb").vertices)
    (tmp_path / "sparse.glb").write_bytes(gltf_of(chair, sparse=True))
    with pytest.raises(BadFile, match="sparse accessors"):
        read_mesh(tmp_path / "sparse.glb")


def test_a_mesh_is_read_once(tmp_path, monkeypatch):
    path = tmp_path / "chair.stl"
    shapes.chair().export(path)
    first = read_mesh(path)

    def never(*_, **__):
        raise AssertionError("read again")

    with monkeypatch.context() as patch:
        patch.setattr(reading, "run_bounded", never)
        assert read_mesh(path) is first
    shapes.chair(height=1.2).export(path)
    assert read_mesh(path).bounds()[1][2] == pytest.approx(1.2), "another file of that name is another mesh"


BOX = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]


def obj_box(at, relative):
    corners = [(x + at, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    faces = [[i - 9 if relative else i for i in face] for face in BOX]
    return "".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "".join(f"f {a} {b} {c} {d}\n" for a, b, c, d in faces)


def test_obj_corners_that_are_counted_back_are_those_before(tmp_path):
    path = tmp_path / "two.obj"
    path.write_text(obj_box(0, relative=True) + obj_box(3, relative=True))
    found = read_mesh(path)
    assert len(found.faces) == 24
    assert trimesh.Trimesh(found.vertices, found.faces, process=False).volume == pytest.approx(2.0)
    np.testing.assert_allclose(found.bounds(), [[0, 0, 0], [4, 1, 1]])


@pytest.mark.parametrize("words", ["f 0 1 2", "f -9 1 2", "f 1 2 9", "f 1 x 2", "v 1 2"])
def test_obj_lines_that_make_no_sense_are_refused(tmp_path, words):
    path = tmp_path / "odd.obj"
    path.write_text(obj_box(0, relative=False) + words + "\n" + "f 1 2 3 # a note\n")
    with pytest.raises(BadFile, match="damaged"):
        read_mesh(path)


U = [(-0.6, -0.6), (0.6, -0.6), (0.6, -0.2), (-0.2, -0.2), (-0.2, 0.2), (0.6, 0.2), (0.6, 0.6), (-0.6, 0.6)]
STAR = [(np.cos(a) * r, np.sin(a) * r) for a, r in zip(np.arange(10) * np.pi / 5, [1.0, 0.4] * 5, strict=True)]
RING = [(0, 0), (3, 0), (3, 3), (0, 3), (0, 0), (1, 1), (1, 2), (2, 2), (2, 1), (1, 1)]  # a hole and the bridge to it


@pytest.mark.parametrize(("outline", "area"), [(U, 1.12), (STAR, 10 * 0.5 * 0.4 * np.sin(np.pi / 5)), (RING, 8.0)])
@pytest.mark.parametrize("first", range(5))
@pytest.mark.parametrize("backward", [False, True])
def test_a_face_that_is_not_convex_keeps_its_notches(outline, area, first, backward):
    corners = np.roll(np.array(outline, float), -first, axis=0)[:: -1 if backward else 1]
    tilted = corners @ np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0]]) + [5.0, 0.0, 1.0]
    found = tilted[triangles(tilted, np.array([len(tilted)]), np.arange(len(tilted)))]
    normals = np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0]) / 2
    assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(area)
    assert np.linalg.norm(normals.sum(0)) == pytest.approx(area), "all face alike"


def test_a_huge_face_that_is_not_convex_is_refused():
    turn = np.linspace(0, 2 * np.pi, 3001)[:-1]
    gear = np.stack([np.cos(turn), np.sin(turn), 0 * turn], -1)
    assert len(triangles(gear, np.array([3000]), np.arange(3000))) == 2998, "a convex one is not"
    gear[::2] *= 0.9
    with pytest.raises(BadFile, match="not convex"):
        triangles(gear, np.array([3000]), np.arange(3000))
