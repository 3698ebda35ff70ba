"""Reads triangle meshes that anybody may have made: OBJ, PLY, STL and GLB, with bounded time and memory.

A file is checked and parsed in a process of its own that gets its bytes and nothing else, with limits on memory and
time. No other file is ever read: materials and textures are ignored.
"""

import functools
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mimicbench.core.bounded import run_bounded
from mimicbench.core.errors import BadFile
from mimicbench.core.foreign.untrusted import is_file, read_bytes
from mimicbench.objects.importing.formats import CHECKS, MAX_FACES, binary_stl
from mimicbench.objects.importing.obj import read_obj
from mimicbench.objects.importing.ply import read_ply

MAX_BYTES = 96 << 20
MAX_COORDINATE = 1e6
"""In the file's own unit; a bed is 2300 mm long."""
READ_SECONDS = 30.0
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
    """Read one file, its equal corners welded. Raises BadFile with one sentence that says what is wrong with it.

    A file that was just read is not read again.
    """
    kind = path.suffix.lower().removeprefix(".")
    if kind not in CHECKS:
        hint = "; save it as .glb, which is whole in one file" if kind == "gltf" else ""
        raise BadFile(f"{path} is none of .obj, .ply, .stl and .glb{hint}")
    if not is_file(path):
        raise BadFile(f"{path} does not exist or is no file")
    stat = path.stat()
    if stat.st_size > MAX_BYTES:
        raise BadFile(
            f"{path} has {stat.st_size >> 20} MiB, more than {MAX_BYTES >> 20}; reduce the mesh to some ten "
            "thousand faces first"
        )
    return _read(path, kind, (stat.st_size, stat.st_mtime_ns, stat.st_ino))


@functools.lru_cache(maxsize=4)
def _read(path: Path, kind: str, _: tuple[int, int, int]) -> Mesh:
    """The mesh of a file that has not changed since."""
    data = read_bytes(path, MAX_BYTES)
    # a GLB's JSON can be made to take much time and memory: it is looked at in the other process
    check_start(data, str(path))
    if kind != "glb":
        check_bytes(data, kind, str(path))
    arrays = run_bounded(
        "mimicbench.objects.importing.mesh",
        "parse_bytes",
        {"data": np.frombuffer(data, np.uint8), "kind": np.array(kind)},
        READ_SECONDS,
        READ_BYTES,
        f"{path} cannot be read as {kind.upper()}: ",
    )
    mesh = checked(arrays["vertices"], arrays["faces"], str(path))
    mesh.vertices.flags.writeable = mesh.faces.flags.writeable = False  # it is kept
    return mesh


def check_start(data: bytes, name: str) -> None:
    """Refuse what is empty or packed. Raises BadFile."""
    if not data.strip(b"\0 \t\r\n"):
        raise BadFile(f"{name} is empty")
    for magic, packer in _PACKED.items():
        if data.startswith(magic):
            raise BadFile(f"{name} is packed with {packer}; unpack it first")


def check_bytes(data: bytes, kind: str, name: str) -> None:
    """Refuse what is of another format, cut off, too large, or refers to other files. Raises BadFile."""
    faces = CHECKS[kind](data, name)
    if faces > MAX_FACES:
        raise BadFile(
            f"{name} has {faces} faces, more than {MAX_FACES}; reduce the mesh to some ten thousand faces first"
        )


def parse_bytes(data: np.ndarray, kind: np.ndarray) -> dict[str, np.ndarray]:
    """Parse a checked file's bytes (N,) into `vertices` (V, 3) and `faces` (F, 3). Runs in a process of its own.

    Raises BadFile.
    """
    form, raw = str(kind), data.tobytes()
    if form == "glb":
        check_bytes(raw, form, "it")
    try:
        read = {"ply": read_ply, "obj": read_obj}.get(form) or functools.partial(_with_trimesh, kind=form)
        vertices, faces = read(raw)
    except (MemoryError, BadFile):
        raise
    except Exception as error:  # a parser may trip over anything in a damaged file
        raise BadFile(
            f"it is cut off or damaged ({type(error).__name__}: {' '.join(str(error).split())[:80]})"
        ) from None
    return {
        "vertices": np.asarray(vertices, float).reshape(-1, 3),
        "faces": np.asarray(faces, np.int64).reshape(-1, 3),
    }


def _with_trimesh(data: bytes, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Corners and faces of STL and GLB."""
    import trimesh

    options: dict[str, Any] = {"skip_materials": True} if kind == "glb" else {}
    scene = trimesh.load_scene(
        io.BytesIO(_plain_text(data, kind)), file_type=kind, resolver=None, process=False, **options
    )
    mesh = scene.to_mesh()
    return mesh.vertices, mesh.faces


def _plain_text(data: bytes, kind: str) -> bytes:
    """The same with other than ASCII letters, which only stand in a solid's name, made question marks."""
    if kind == "glb" or (kind == "stl" and binary_stl(data)):
        return data
    return data.translate(bytes(range(128)) + b"?" * 128)


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
