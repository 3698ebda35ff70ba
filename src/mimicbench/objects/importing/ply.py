"""Reads the corners and faces of PLY files, text or binary of either byte order, with faces of any number of corners
and any further properties and elements, which are skipped.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mimicbench.core.errors import BadFile
from mimicbench.objects.importing.polygons import triangles

TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
MAX_CORNERS = 1000
"""Of one face."""


@dataclass(frozen=True)
class Property:
    """A number of an element, or a list of numbers."""

    name: str
    kind: str
    """NumPy's name of the type, without byte order."""
    count: str | None = None
    """That of a list's length; None if it is one number."""


@dataclass(frozen=True)
class Element:
    """What the header promises."""

    name: str
    count: int
    properties: tuple[Property, ...]


def read_ply(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Corners (V, 3) and triangles (F, 3) of a file. Raises BadFile."""
    form, elements, at = _header(data)
    rows = _text_rows(data[at:]) if form == "ascii" else None
    vertices = np.zeros((0, 3))
    faces: list | np.ndarray = []
    for element in elements:
        wanted = {"vertex": ("x", "y", "z"), "face": (_corners(element),)}.get(element.name, ())
        if rows is not None:
            columns = _read_text(rows, element, wanted)
        else:
            columns, at = _read_binary(data, at, element, wanted, ">" if "big" in form else "<")
        if element.name == "vertex":
            vertices = np.stack([np.asarray(columns[axis], float) for axis in "xyz"], -1).reshape(-1, 3)
        elif element.name == "face":
            faces = columns[_corners(element)]
    return vertices, _triangles(vertices, faces)


def _header(data: bytes) -> tuple[str, list[Element], int]:
    """The format, what there is, and where the numbers begin."""
    end = data.find(b"end_header")
    start = data.find(b"\n", end) + 1
    form, elements = "", []
    try:
        for line in data[: max(end, 0)].decode("ascii", "replace").splitlines():
            words = line.split()
            if words[:1] == ["format"]:
                form = words[1]
            elif words[:1] == ["element"]:
                elements.append(Element(words[1], int(words[2]), ()))
            elif words[:1] == ["property"]:
                last = elements[-1]
                found = (
                    Property(words[4], TYPES[words[3]], TYPES[words[2]])
                    if words[1] == "list"
                    else Property(words[2], TYPES[words[1]])
                )
                elements[-1] = Element(last.name, last.count, (*last.properties, found))
    except (IndexError, KeyError, ValueError):
        raise BadFile("it has a damaged PLY header") from None
    names = [element.name for element in elements]
    if end < 0 or not start or names.count("vertex") != 1 or names.count("face") != 1:
        raise BadFile("it holds no corners and faces: points alone, strips and splats are no mesh")
    found = {item.name for element in elements if element.name == "vertex" for item in element.properties}
    if not {"x", "y", "z"} <= found:
        raise BadFile("its corners have no x, y and z")
    return form, elements, start


def _corners(element: Element) -> str:
    """The name of the list of a face's corners."""
    lists = [item.name for item in element.properties if item.count is not None and item.kind[0] in "iu"]
    named = [name for name in lists if name in ("vertex_indices", "vertex_index")]
    if element.name == "face" and not named and len(lists) != 1:
        raise BadFile("its faces do not say which list is that of their corners (vertex_indices)")
    return (named or lists or [""])[0]


def _text_rows(data: bytes) -> Iterator[list[bytes]]:
    return (words for words in (line.split() for line in data.splitlines()) if words)


def _read_text(rows: Iterator[list[bytes]], element: Element, wanted: Sequence[str]) -> dict[str, list]:
    """The wanted properties of an element's rows."""
    found: dict[str, list] = {name: [] for name in wanted}
    for _ in range(element.count):
        row, at = next(rows, None), 0
        if row is None:
            raise BadFile("it is cut off: it has fewer rows than it promises")
        for item in element.properties:
            if item.count is None:
                values, at = row[at : at + 1], at + 1
            else:
                length = int(row[at]) if at < len(row) else 0
                values, at = row[at + 1 : at + 1 + max(length, 0)], at + 1 + max(length, 0)
            if at > len(row):
                raise BadFile("it is cut off or damaged: a row has fewer numbers than it promises")
            if item.name in found:
                found[item.name].append(float(values[0]) if item.count is None else [int(float(v)) for v in values])
    return found


def _read_binary(
    data: bytes, at: int, element: Element, wanted: Sequence[str], order: str
) -> tuple[dict[str, list | np.ndarray], int]:
    """The wanted properties of an element's rows, and where the next element begins.

    Rows are first taken to be as long as the first one, which is nearly always so and read at once.
    """
    cut = BadFile("it is cut off: it has fewer bytes than it promises")
    if not element.count:
        return {name: [] for name in wanted}, at
    lengths, fields, place = {}, [], at
    for number, item in enumerate(element.properties):
        if item.count is None:
            fields.append((f"{number}", order + item.kind))
        else:
            lengths[number] = _length(data, place, order + item.count)
            fields += [(f"n{number}", order + item.count), (f"{number}", order + item.kind, (lengths[number],))]
        place = at + np.dtype(fields).itemsize
    dtype = np.dtype(fields)
    if dtype.itemsize * element.count <= len(data) - at:
        table = np.frombuffer(data, dtype, element.count, at)
        if all((table[f"n{number}"] == length).all() for number, length in lengths.items()):
            columns = {item.name: table[f"{number}"] for number, item in enumerate(element.properties)}
            return {name: columns[name] for name in wanted}, at + dtype.itemsize * element.count
    elif not lengths:
        raise cut
    return _read_uneven(data, at, element, wanted, order)


def _read_uneven(
    data: bytes, at: int, element: Element, wanted: Sequence[str], order: str
) -> tuple[dict[str, list | np.ndarray], int]:
    """The same row by row, for lists of different lengths."""
    found: dict[str, list | np.ndarray] = {name: [] for name in wanted}
    sizes = {kind: np.dtype(kind).itemsize for item in element.properties for kind in (item.kind, item.count or "u1")}
    for _ in range(element.count):
        for item in element.properties:
            length = 1
            if item.count is not None:
                length, at = _length(data, at, order + item.count), at + sizes[item.count]
            size = length * sizes[item.kind]
            if at + size > len(data):
                raise BadFile("it is cut off: it has fewer bytes than it promises")
            rows = found.get(item.name)
            if isinstance(rows, list):
                values = np.frombuffer(data, order + item.kind, length, at)
                rows.append(values[0] if item.count is None else values)
            at += size
    return found, at


def _length(data: bytes, at: int, kind: str) -> int:
    """Of a list."""
    size = np.dtype(kind).itemsize
    length = np.frombuffer(data, kind, 1, at)[0] if at + size <= len(data) else -1
    if not 0 <= length <= MAX_CORNERS:
        raise BadFile("it is cut off or damaged: a list has an impossible length")
    return int(length)


def _triangles(vertices: np.ndarray, lists: list | np.ndarray) -> np.ndarray:
    """(F, 3) of faces with three corners or more."""
    if isinstance(lists, np.ndarray):
        return triangles(vertices, np.full(len(lists), lists.shape[1]), lists.reshape(-1).astype(np.int64))
    lengths = np.array([len(corners) for corners in lists], np.int64)
    return triangles(vertices, lengths, np.array([int(corner) for corners in lists for corner in corners], np.int64))
