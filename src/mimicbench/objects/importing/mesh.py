"""Reads triangle meshes that anybody may have made: OBJ, PLY, STL and GLB, with bounded time and memory.

What a file claims is checked before anything is built. It is then parsed in a process of its own that gets its bytes
and nothing else, with limits on memory and time. No other file is ever read: materials and textures are ignored.
"""

import io
import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mimicbench.core.bounded import run_bounded
from mimicbench.core.errors import BadFile

MAX_BYTES = 96 << 20
MAX_FACES = 500_000
MAX_COORDINATE = 1e6
"""In the file's own unit; a bed is 2300 mm long."""
READ_SECONDS = 60.0
READ_BYTES = 3 << 30
_PACKED = {
    b"PK\x03\x04": "zip",
    b"\x1f\x8b": "gzip",
    b"BZh": "bzip2",
    b"\xfd7zXZ": "xz",
    b"\x28\xb5\x2f\xfd": "zstd",
    b"7z\xbc\xaf": "7z",
    b"Rar!": "rar",
}
_PLY_FORMATS = (b"ascii", b"binary_little_endian", b"binary_big_endian")


@dataclass(frozen=True)
class Mesh:
    """Triangles, in the file's own unit and axes until they are placed."""

    vertices: np.ndarray
    """(V, 3)."""
    faces: np.ndarray
    """(F, 3) indices of vertices, counter-clockwise from outside if the file is right."""

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner (3,) of what the faces use."""
        used = self.vertices[np.unique(self.faces)]
        return used.min(0), used.max(0)


def read_mesh(path: Path) -> Mesh:
    """Read one file, its equal corners welded. Raises BadFile with one sentence that says what is wrong with it."""
    kind = path.suffix.lower().removeprefix(".")
    if kind not in _CHECKS:
        hint = "; save it as .glb, which is whole in one file" if kind == "gltf" else ""
        raise BadFile(f"{path} is none of .obj, .ply, .stl and .glb{hint}")
    if not path.is_file():
        raise BadFile(f"{path} does not exist or is no file")
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise BadFile(
            f"{path} has {size >> 20} MiB, more than {MAX_BYTES >> 20}; reduce the mesh to some ten "
            "thousand faces first"
        )
    data = path.read_bytes()
    check_bytes(data, kind, str(path))
    arrays = run_bounded(
        "mimicbench.objects.importing.mesh",
        "parse_bytes",
        {"data": np.frombuffer(data, np.uint8), "kind": np.array(kind)},
        READ_SECONDS,
        READ_BYTES,
        f"{path} cannot be read as {kind.upper()}: ",
    )
    return checked(arrays["vertices"], arrays["faces"], str(path))


def check_bytes(data: bytes, kind: str, name: str) -> None:
    """Refuse what is empty, packed, of another format, cut off, too large, or refers to other files. Raises BadFile."""
    if not data.strip(b"\0 \t\r\n"):
        raise BadFile(f"{name} is empty")
    for magic, packer in _PACKED.items():
        if data.startswith(magic):
            raise BadFile(f"{name} is packed with {packer}; unpack it first")
    faces = _CHECKS[kind](data, name)
    if faces > MAX_FACES:
        raise BadFile(
            f"{name} has {faces} faces, more than {MAX_FACES}; reduce the mesh to some ten thousand faces first"
        )


def parse_bytes(data: np.ndarray, kind: np.ndarray) -> dict[str, np.ndarray]:
    """Parse a checked file's bytes (N,) into `vertices` (V, 3) and `faces` (F, 3). Runs in a process of its own.

    Raises BadFile.
    """
    import trimesh

    options: dict[str, Any] = {"skip_materials": True} if str(kind) in ("obj", "glb") else {}
    try:
        scene = trimesh.load_scene(
            io.BytesIO(_plain_text(data.tobytes(), str(kind))),
            file_type=str(kind),
            resolver=None,
            process=False,
            **options,
        )
        mesh = scene.to_mesh()
    except MemoryError:
        raise
    except Exception as error:  # a parser may trip over anything in a damaged file
        raise BadFile(
            f"it is cut off or damaged ({type(error).__name__}: {' '.join(str(error).split())[:80]})"
        ) from None
    return {
        "vertices": np.asarray(mesh.vertices, float).reshape(-1, 3),
        "faces": np.asarray(mesh.faces, np.int64).reshape(-1, 3),
    }


def _plain_text(data: bytes, kind: str) -> bytes:
    """The same with other than ASCII letters, which only stand in names and comments, made question marks."""
    end = len(data)
    if kind == "glb" or (kind == "stl" and _binary_stl(data)):
        end = 0
    elif kind == "ply" and b"ascii" not in data[:200]:
        end = data.find(b"end_header")
    return data[:end].translate(bytes(range(128)) + b"?" * 128) + data[end:]


def checked(vertices: np.ndarray, faces: np.ndarray, name: str) -> Mesh:
    """A welded mesh of sane numbers. Raises BadFile."""
    if not len(faces) or not len(vertices):
        raise BadFile(f"{name} holds no faces; a mesh of triangles is needed, not points or lines")
    if len(faces) > MAX_FACES:
        raise BadFile(
            f"{name} has {len(faces)} faces, more than {MAX_FACES}; reduce the mesh to some ten thousand faces first"
        )
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise BadFile(f"{name} has a face with a corner that does not exist; it is cut off or damaged")
    used = vertices[np.unique(faces)]
    if not np.isfinite(used).all():
        raise BadFile(f"{name} has corners that are not finite numbers; it is damaged: export it again")
    if np.abs(used).max() > MAX_COORDINATE:
        raise BadFile(
            f"{name} has corners at {np.abs(used).max():.3g}, beyond {MAX_COORDINATE:.0e} of any "
            "unit; it is damaged or placed far from the origin"
        )
    extent = np.ptp(used, axis=0)
    if np.sort(extent)[1] <= 1e-5 * extent.max() or extent.max() < 1e-6:
        raise BadFile(f"{name} has no extent: its bounding box is {' x '.join(f'{side:.3g}' for side in extent)}")
    mesh = weld(Mesh(vertices, faces), 1e-6 * float(extent.max()))
    if not len(mesh.faces):
        raise BadFile(f"{name} has faces of no area only")
    return mesh


def weld(mesh: Mesh, tolerance: float) -> Mesh:
    """Make one corner of those that fall into one cell of a grid; faces without area and copies go."""
    used, faces = np.unique(mesh.faces, return_inverse=True)
    vertices = mesh.vertices[used]
    _, first, same = np.unique(
        np.round(vertices / tolerance).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    faces = same.reshape(-1)[faces.reshape(-1, 3)]
    vertices = vertices[first]
    corners = vertices[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    distinct = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    faces = faces[distinct & (area > 0)]
    # a copy has the same side outside; faces back to back stay two, as where two boxes touch
    turned = (faces.argmin(1)[:, None] + np.arange(3)) % 3
    _, keep = np.unique(np.take_along_axis(faces, turned, 1), axis=0, return_index=True)
    return Mesh(vertices, faces[np.sort(keep)])


def _binary_stl(data: bytes) -> bool:
    """Whether the length is what the count of faces in a binary header says.

    Many such headers begin with "solid" too.
    """
    return len(data) >= 84 and len(data) - 84 == 50 * int.from_bytes(data[80:84], "little")


def _check_stl(data: bytes, name: str) -> int:
    if _binary_stl(data):
        return (len(data) - 84) // 50
    if data.lstrip()[:5].lower() != b"solid" or b"\0" in data:
        raise BadFile(f"{name} is no STL file, or is cut off")
    lower = data.lower()
    if b"endsolid" not in lower:
        raise BadFile(f"{name} is cut off: it does not end with endsolid")
    return lower.count(b"endfacet")


def _check_ply(data: bytes, name: str) -> int:
    end = data.find(b"end_header", 0, 1 << 16)
    header = data[: max(end, 0)].split(b"\n")
    if (
        header[0].strip() != b"ply"
        or end < 0
        or not any(
            line.split()[:1] == [b"format"] and line.split()[1:2][0:1] and line.split()[1] in _PLY_FORMATS
            for line in header
        )
    ):
        raise BadFile(f"{name} is no PLY file, or is cut off")
    counts: dict[bytes, int] = {}
    for line in header:
        words = line.split()
        if words[:1] == [b"element"]:
            if len(words) != 3 or not re.fullmatch(rb"\d{1,12}", words[2]):
                raise BadFile(f"{name} has a damaged PLY header")
            counts[words[1]] = int(words[2])
    if sum(counts.values()) > len(data):
        raise BadFile(f"{name} promises {sum(counts.values())} elements in {len(data)} bytes; it is cut off or damaged")
    return max(counts.get(b"face", 0), counts.get(b"tristrips", 0))


def _check_obj(data: bytes, name: str) -> int:
    if b"\0" in data or not re.search(rb"(?m)^\s*v\s", data):
        raise BadFile(f"{name} is no OBJ file: it has no lines of corners (v)")
    if not data.endswith(b"\n") and re.search(rb"(?m)^\s*(f\s+\S+|v(\s+\S+){0,2})\s*\Z", data):
        raise BadFile(f"{name} is cut off within its last line")
    # a face of n corners becomes n - 2 triangles
    count = 0
    for line in re.finditer(rb"(?m)^[ \t]*f[ \t].*$", data):
        count += max(1, len(line[0].split()) - 3)
        if count > MAX_FACES:
            raise BadFile(f"{name} has more than {MAX_FACES} faces; reduce the mesh to some ten thousand faces first")
    return count


def _check_glb(data: bytes, name: str) -> int:
    length, kind = int.from_bytes(data[12:16], "little"), data[16:20]
    if data[:4] != b"glTF" or data[4:8] != b"\2\0\0\0" or kind != b"JSON":
        raise BadFile(f"{name} is no GLB file of version 2")
    if int.from_bytes(data[8:12], "little") != len(data) or 20 + length > len(data):
        raise BadFile(
            f"{name} is cut off: it should have {int.from_bytes(data[8:12], 'little')} bytes and has {len(data)}"
        )
    try:
        gltf = json.loads(data[20 : 20 + length])
        return _check_gltf(gltf, len(data), name)
    except BadFile:
        raise
    except (ValueError, TypeError, KeyError, IndexError, AttributeError, RecursionError):
        raise BadFile(f"{name} has a damaged JSON part") from None


def _check_gltf(gltf: dict, size: int, name: str) -> int:
    """Faces over all uses of all meshes, after refusing outside files, packed data and nodes that are used twice."""
    for part in ("buffers", "images"):
        for entry in gltf.get(part, []):
            uri = entry.get("uri")
            if uri is not None and (part == "buffers" or not str(uri).startswith("data:")):
                raise BadFile(
                    f"{name} refers to another file ({str(uri)[:40]!r}); save it as one .glb with everything inside"
                )
    packed = {str(e) for e in [*gltf.get("extensionsRequired", []), *gltf.get("extensionsUsed", [])]} & {
        "KHR_draco_mesh_compression",
        "EXT_meshopt_compression",
    }
    if packed:
        raise BadFile(f"{name} is packed with {' and '.join(sorted(packed))}; export it without compression")
    accessors, nodes, meshes = gltf.get("accessors", []), gltf.get("nodes", []), gltf.get("meshes", [])
    if any(not 0 <= int(entry["count"]) <= size for entry in accessors):
        raise BadFile(f"{name} promises more numbers than it has bytes; it is cut off or damaged")
    children = [int(child) for node in nodes for child in node.get("children", [])]
    if len(children) != len(set(children)) or any(not 0 <= child < len(nodes) for child in children):
        raise BadFile(f"{name} uses a node twice, or one that does not exist")
    sizes = []
    for mesh in meshes:
        counts = [
            accessors[p["indices"] if p.get("indices") is not None else p["attributes"]["POSITION"]]["count"]
            for p in mesh["primitives"]
        ]
        sizes.append(sum(max(1, int(count) // 3) for count in counts))
    return sum(sizes[int(node["mesh"])] for node in nodes if node.get("mesh") is not None)


_CHECKS: dict[str, Callable[[bytes, str], int]] = {
    "obj": _check_obj,
    "ply": _check_ply,
    "stl": _check_stl,
    "glb": _check_glb,
}
