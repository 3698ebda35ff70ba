"""Closes the holes of meshes, as far as that is harmless."""

import numpy as np

from mimicbench.objects.importing.mesh import Mesh
from mimicbench.objects.importing.topology import Topology, outward, topology

SMALL = 0.25
"""[m]; a hole within this is closed whatever its shape."""
MAX_LOOP = 2000
"""Corners of a hole's edge that is looked at."""


def close_holes(mesh: Mesh, found: Topology) -> tuple[Mesh, Topology, list[str]]:
    """Put a lid on every small hole, and on every flat one such as the missing underside of a cushion; z is up.

    Large holes that open upwards stay: a bin is no block. Returns the mesh, its parts, and what was done, in words.
    """
    if found.closed.all():
        return mesh, found, []
    vertices, faces, lids = [mesh.vertices], [mesh.faces], 0
    count = len(mesh.vertices)
    for loop in _loops(mesh, found):
        corners = mesh.vertices[loop]
        middle = corners.mean(0)
        # the lid's faces pass the edge the other way, so this points out of the part
        area = -0.5 * np.cross(corners - middle, np.roll(corners, -1, 0) - middle).sum(0)
        size = np.linalg.norm(area)
        small = np.ptp(corners, axis=0).max() < SMALL
        bent = size < 1e-10 or np.abs((corners - middle) @ area / size).max() > 0.02 * np.sqrt(size) + 0.002
        if not small and (bent or area[2] > 0.5 * size):
            continue
        vertices.append(middle[None])
        faces.append(np.stack([np.roll(loop, -1), loop, np.full(len(loop), count)], -1))
        count += 1
        lids += 1
    whole = Mesh(np.concatenate(vertices), np.concatenate(faces))
    after = topology(whole)
    whole = outward(whole, after)
    left = int((~after.closed).sum())
    notes = [f"{lids} holes were closed"] if lids else []
    if left:
        notes.append(
            f"{left} of {len(after.closed)} parts are not watertight; their pieces follow the surface, look at them"
        )
    return whole, after, notes


def _loops(mesh: Mesh, found: Topology) -> list[np.ndarray]:
    """Edges of holes as loops of vertices, in the direction in which the faces beside them pass them."""
    edges = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    part = np.repeat(found.part, 3)
    ordered = np.sort(edges, axis=1)
    _, name, uses = np.unique(np.column_stack([ordered, part]), axis=0, return_inverse=True, return_counts=True)
    single = uses[name.reshape(-1)] == 1
    follow: dict[tuple[int, int], list[int]] = {}
    for (start, end), owner in zip(edges[single].tolist(), part[single].tolist(), strict=True):
        follow.setdefault((owner, start), []).append(end)
    loops = []
    while follow:
        owner, start = next(iter(follow))
        loop, at = [start], start
        while len(loop) <= MAX_LOOP:
            ends = follow.get((owner, at))
            if not ends:
                break
            step = ends.pop()
            if not ends:
                del follow[(owner, at)]
            if step == start:
                loops.append(np.array(loop))
                break
            loop.append(step)
            at = step
        else:
            continue
    return [loop for loop in loops if len(loop) >= 3]
