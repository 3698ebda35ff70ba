"""Makes one sheet of faces that come twice, once reversed, and lets neighboring faces agree on which side is outside.

Many models of furniture (ShapeNet's, ROAM's) have every face twice, so that it is seen from both sides. Such a pair has
no inside; where two closed bodies touch, they have a common face twice too, and stay as they are.
"""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from mimicbench.objects.importing.mesh import Mesh


def one_sheet(mesh: Mesh) -> tuple[Mesh, int]:
    """The mesh with one face of every such pair, and how many pairs there were."""
    ordered = np.sort(mesh.faces, axis=1)
    _, name, count = np.unique(ordered, axis=0, return_inverse=True, return_counts=True)
    name = name.reshape(-1)
    order = np.argsort(name, kind="stable")
    first = order[np.cumsum(count) - count]  # of every set of equal corners
    pairs = np.flatnonzero(count == 2)
    if not len(pairs):
        return Mesh(mesh.vertices, agreed(mesh.faces)), 0
    joint = _where_bodies_touch(mesh.faces[first[pairs]], mesh.faces[(count != 2)[name]])
    once = pairs[~joint]
    if not len(once):
        return mesh, 0
    keep = np.ones(len(mesh.faces), bool)
    keep[order[np.cumsum(count)[once] - 1]] = False
    return Mesh(mesh.vertices, agreed(mesh.faces[keep])), len(once)


def _where_bodies_touch(pairs: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(P,) whether a pair, given by one face (P, 3), is where two bodies touch: all around the pairs that hang together
    there are other faces (F, 3) at their edge.
    """
    edges, face = _edges(pairs)
    key, name, uses = np.unique(edges, axis=0, return_inverse=True, return_counts=True)
    name = name.reshape(-1)
    part = _parts(name, face, len(pairs))
    rim = uses[name] == 1
    known = {tuple(edge) for edge in np.unique(_edges(others)[0], axis=0).tolist()} if len(others) else set()
    met = np.array([tuple(edge) in known for edge in key.tolist()])[name]
    touched = np.ones(part.max() + 1, bool)
    touched[part[face[rim & ~met]]] = False
    has_rim = np.zeros(part.max() + 1, bool)
    has_rim[part[face[rim]]] = True
    return (touched & has_rim)[part]


def agreed(faces: np.ndarray) -> np.ndarray:
    """Faces (F, 3) of which as few as possible are turned over so that neighbors pass their common edge in opposite
    directions; edges of more than two faces say nothing.
    """
    edges, face = _edges(faces)
    raw = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    forward = raw[:, 0] < raw[:, 1]
    _, name, uses = np.unique(edges, axis=0, return_inverse=True, return_counts=True)
    name = name.reshape(-1)
    order = np.argsort(name, kind="stable")
    one, other = order[(uses[name] == 2)[order]].reshape(-1, 2).T
    same = forward[one] == forward[other]
    # every face twice, as it is and turned over; what agrees hangs together
    count = len(faces)
    a, b = face[one], face[other]
    rows = np.concatenate([a, a + count])
    columns = np.concatenate([np.where(same, b + count, b), np.where(same, b, b + count)])
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(2 * count,) * 2)
    label = connected_components(graph, directed=False)[1]
    kept = np.bincount(label[:count], minlength=label.max() + 1)
    as_is, turned = label[:count], label[count:]
    flip = (kept[turned] > kept[as_is]) | ((kept[turned] == kept[as_is]) & (turned < as_is))
    return np.where(flip[:, None], faces[:, ::-1], faces)


def _edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges (3 F, 2) with the smaller corner first, and the face (3 F,) of each."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return edges, np.repeat(np.arange(len(faces)), 3)


def _parts(name: np.ndarray, face: np.ndarray, count: int) -> np.ndarray:
    """(F,) which faces hang together by the edges that they name."""
    order = np.argsort(name, kind="stable")
    together = name[order][1:] == name[order][:-1]
    a, b = face[order][:-1][together], face[order][1:][together]
    graph = coo_matrix((np.ones(len(a)), (a, b)), shape=(count,) * 2)
    return connected_components(graph, directed=False)[1]
