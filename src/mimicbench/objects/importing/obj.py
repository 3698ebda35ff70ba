"""Reads the corners and faces of OBJ files, with faces of any number of corners; all else in them is skipped."""

import numpy as np

from mimicbench.core.errors import BadFile
from mimicbench.objects.importing.polygons import triangles


def read_obj(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Corners (V, 3) and triangles (F, 3) of a file. Raises BadFile, or ValueError of words that are no numbers."""
    vertices: list[list[bytes]] = []
    lengths: list[int] = []
    flat: list[int] = []
    for line in data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").splitlines():
        words = line.split(b"#", 1)[0].split()
        if words[:1] == [b"v"]:
            if len(words) < 4:
                raise BadFile("a corner has fewer than three numbers; it is cut off or damaged")
            vertices.append(words[1:4])
        elif words[:1] == [b"f"]:
            lengths.append(len(words) - 1)
            for word in words[1:]:
                number = int(word.split(b"/", 1)[0])
                # counted from 1, or back from the last corner so far
                flat.append(number - 1 if number > 0 else len(vertices) + number)
                if number == 0:
                    raise BadFile("a face has corner 0, but they are counted from 1; it is damaged")
    corners = np.array(vertices, float).reshape(-1, 3)
    return corners, triangles(corners, np.array(lengths, np.int64), np.array(flat, np.int64))
