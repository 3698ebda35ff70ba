"""What files of triangle meshes claim, checked before anything is built: OBJ, PLY, STL and GLB.

No check opens another file. Patterns look within one line, so that none takes longer than the file is long.
"""

import json
import re
from collections.abc import Callable

from mimicbench.core.errors import BadFile

MAX_FACES = 500_000
MAX_JSON = 16 << 20
"""Bytes of a GLB's JSON."""
_PLY_FORMATS = (b"ascii", b"binary_little_endian", b"binary_big_endian")


def binary_stl(data: bytes) -> bool:
    """Whether the length is what the count of faces in a binary header says.

    Many such headers begin with "solid" too.
    """
    return len(data) >= 84 and len(data) - 84 == 50 * int.from_bytes(data[80:84], "little")


def _check_stl(data: bytes, name: str) -> int:
    if binary_stl(data):
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
    if b"\0" in data or not re.search(rb"(?m)^[ \t]*v[ \t]", data):
        raise BadFile(f"{name} is no OBJ file: it has no lines of corners (v)")
    last = data[data.rfind(b"\n") + 1 :].split(maxsplit=5)
    if (last[:1] == [b"v"] and len(last) < 4) or (last[:1] == [b"f"] and len(last) < 3):
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
    if length > MAX_JSON:
        raise BadFile(f"{name} has a JSON part of {length >> 20} MiB, more than any mesh needs; export it again")
    try:
        gltf = json.loads(data[20 : 20 + length])
        return _check_gltf(gltf, len(data), name)
    except BadFile:
        raise
    except (ValueError, TypeError, KeyError, IndexError, AttributeError, RecursionError, OverflowError):
        raise BadFile(f"{name} has a damaged JSON part") from None


def _check_gltf(gltf: dict, size: int, name: str) -> int:
    """Faces over all uses of all meshes, after refusing outside files, packed data and nodes that are used twice."""
    for part in ("buffers", "images"):
        for entry in gltf.get(part, []):
            uri = entry.get("uri")
            if uri is not None and not str(uri).startswith("data:"):
                raise BadFile(
                    f"{name} refers to another file ({str(uri)[:40]!r}); save it as one .glb with everything inside"
                )
            if part == "buffers" and uri is not None and ";base64," not in str(uri)[:100]:
                raise BadFile(f"{name} has a buffer in its JSON that is not base64; export it again")
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
    sizes = [sum(_faces(accessors, primitive, name) for primitive in mesh["primitives"]) for mesh in meshes]
    return sum(sizes[int(node["mesh"])] for node in nodes if node.get("mesh") is not None)


def _faces(accessors: list, primitive: dict, name: str) -> int:
    """Most faces of a part of a mesh, by its count of corners or of indices."""
    used = [accessors[primitive["attributes"]["POSITION"]]]
    if primitive.get("indices") is not None:
        used.append(accessors[primitive["indices"]])
    if any("sparse" in entry for entry in used):
        raise BadFile(f"{name} stores its corners sparsely (sparse accessors), which is not read; export it without")
    return max(1, int(used[-1]["count"]) // 3)


CHECKS: dict[str, Callable[[bytes, str], int]] = {
    "obj": _check_obj,
    "ply": _check_ply,
    "stl": _check_stl,
    "glb": _check_glb,
}
"""By ending: what refuses a file's bytes, raising BadFile with its name, and returns its number of faces at most."""
