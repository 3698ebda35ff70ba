"""Which faces of a mesh hang together, and whether they close a body."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from mimicbench.objects.importing.mesh import Mesh

CROWDED = 20_000
"""Edges of more than two faces that are looked at."""


@dataclass(frozen=True)
class Topology:
    """What a mesh hangs together by."""

    part: np.ndarray
    """(F,) the part that each face belongs to."""
    closed: np.ndarray
    """(parts,) whether every edge of a part has two faces of it, in opposite directions."""


def topology(mesh: Mesh) -> Topology:
    """Parts are faces joined by edges that two of them share; bodies that merely touch stay apart."""
    edges = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    face = np.repeat(np.arange(len(mesh.faces)), 3)
    ordered = np.sort(edges, axis=1)
    key = ordered[:, 0] * len(mesh.vertices) + ordered[:, 1]
    _, name, count = np.unique(key, return_inverse=True, return_counts=True)
    order = np.argsort(name, kind="stable")
    pairs = order[(count[name] == 2)[order]].reshape(-1, 2)
    forward = edges[:, 0] < edges[:, 1]
    ends = np.cumsum(count)
    crowded = [
        order[ends[edge] - count[edge] : ends[edge]] for edge in np.flatnonzero((count > 2) & (count < 100))[:CROWDED]
    ]
    pairs = np.concatenate(
        [pairs, *(_around(mesh, ordered[uses[0]], uses, face[uses], forward[uses]) for uses in crowded)]
    )
    graph = coo_matrix((np.ones(len(pairs)), (face[pairs[:, 0]], face[pairs[:, 1]])), shape=(len(mesh.faces),) * 2)
    parts, part = connected_components(graph, directed=False)
    # within its part, an edge must be passed once in either direction
    within = name * parts + part[face]
    _, own = np.unique(within, return_inverse=True)
    balance = np.bincount(own, np.where(forward, 1, -1))
    uses = np.bincount(own)
    open_edge = (balance != 0) | (uses % 2 != 0)
    closed = np.ones(parts, bool)
    closed[part[face[open_edge[own]]]] = False
    return Topology(part, closed)


def _around(mesh: Mesh, edge: np.ndarray, uses: np.ndarray, face: np.ndarray, forward: np.ndarray) -> np.ndarray:
    """Pairs (n, 2) of an edge's uses that have the inside of one body between them, for an edge that several bodies
    share.

    Seen along the edge, the inside of a face that passes it forward lies clockwise of the face, up to the next face
    that passes it backward.
    """
    start, end = mesh.vertices[edge]
    along = (end - start) / np.linalg.norm(end - start)
    third = mesh.vertices[(mesh.faces[face].sum(1) - edge.sum())] - start
    first = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    angle = np.arctan2(third @ np.cross(along, first), third @ first)
    back = np.flatnonzero(~forward)
    if not len(back):
        return np.zeros((0, 2), int)
    clockwise = (angle[forward, None] - angle[None, back] - 1e-6) % (2 * np.pi)
    return np.stack([uses[forward], uses[back[clockwise.argmin(1)]]], -1)


def outward(mesh: Mesh, found: Topology) -> Mesh:
    """The same with the closed parts turned inside in where they were inside out."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] - mesh.vertices.mean(0) for i in range(3))
    volume = np.bincount(found.part, (a * np.cross(b, c)).sum(1) / 6, len(found.closed))
    flip = (found.closed & (volume < 0))[found.part]
    return Mesh(mesh.vertices, np.where(flip[:, None], mesh.faces[:, ::-1], mesh.faces))
