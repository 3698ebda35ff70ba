"""Splits a mesh into at most SLOTS convex pieces, and each piece's box around it.

Parts that hang together are taken one by one: a convex part is a piece as it is, flat sheets get a thickness, and the
others are split by coacd, in a process of its own with limits. If there are too many pieces, those are joined that add
the least volume.
"""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from mimicbench.core import rotations as rot
from mimicbench.core.bounded import run_bounded
from mimicbench.core.errors import BadFile, BadObject
from mimicbench.objects.importing.mesh import Mesh, weld
from mimicbench.objects.importing.topology import Topology, topology
from mimicbench.objects.shape import SLOTS

CORNERS = 24
"""Most corners of a convex piece."""
NEEDLE = 1e-4
"""[m] Parts and pieces that are thinner than this in two directions are left out: nothing could touch them."""
SHEET = 0.01
"""[m]; what is thinner than half of this gets this thickness, as physics needs one."""
MAX_PARTS = 96
"""Of more parts than this, the small ones are left to coacd together with the others."""
SPLIT_FACES = 12_000
"""coacd gets a coarser mesh if there are more."""
SPLIT_SECONDS = 30.0
SPLIT_BYTES = 4 << 30
FINENESS = (
    {"threshold": 0.05, "preprocess_resolution": 40, "resolution": 400, "mcts_nodes": 8, "mcts_iterations": 15},
    {"threshold": 0.1, "preprocess_resolution": 30, "resolution": 300, "mcts_nodes": 6, "mcts_iterations": 8},
)
"""How coacd looks for cuts, at first and if that takes too long; of a part that is as large as the whole."""
COARSEST, CONVEX = 12, 0.8
"""Least resolution of a small part, and largest threshold."""


def split(mesh: Mesh, found: Topology, limit: int = SLOTS) -> tuple[list[np.ndarray], list[str]]:
    """Convex pieces (V, 3) of at most CORNERS corners each, at most `limit` of them, and what was done, in words.

    Raises BadObject if coacd takes too long or finds nothing.
    """
    pieces: list[np.ndarray] = []
    rest: list[int] = []
    parts = np.bincount(found.part, minlength=len(found.closed))
    big = np.argsort(-parts, kind="stable")[:MAX_PARTS]
    rest += sorted(set(range(len(parts))) - set(big.tolist()))
    needles = 0
    for part in sorted(big.tolist()):
        corners = mesh.vertices[np.unique(mesh.faces[found.part == part])]
        if _needle(corners):
            needles += 1
            continue
        piece = _whole(Mesh(mesh.vertices, mesh.faces[found.part == part]), corners, bool(found.closed[part]))
        if piece is None:
            rest.append(part)
        else:
            pieces.append(piece)
    notes = [f"{len(pieces)} of {len(parts)} parts are convex as they are"]
    if needles:
        notes.append(f"{needles} parts are thinner than {1000 * NEEDLE:g} mm in two directions and were left out")
    if rest:
        concave = np.isin(found.part, rest)
        part = np.where(np.isin(found.part, big), found.part, -1)  # crumbs are one part
        cut = _coacd(Mesh(mesh.vertices, mesh.faces[concave]), part[concave], max(limit - len(pieces), limit // 2))
        pieces += cut
        notes.append(f"coacd split the other {len(rest)} into {len(cut)} pieces")
    if not pieces:
        raise BadObject("nothing of it has a volume")
    if len(pieces) > limit:
        notes.append(f"of {len(pieces)} pieces, those were joined that add the least volume")
        pieces = _join(pieces, limit)
    return [fewer_corners(piece) for piece in pieces], notes


def _needle(corners: np.ndarray) -> bool:
    """Whether a piece is thin in two directions."""
    spread = corners - corners.mean(0)
    axes = np.linalg.svd(spread, full_matrices=False)[2]
    return len(axes) < 2 or bool(np.ptp(spread @ axes[1]) < NEEDLE)


def _whole(part: Mesh, corners: np.ndarray, closed: bool) -> np.ndarray | None:
    """The corners of a part that is a convex piece already, None if it is not."""
    spread = corners - corners.mean(0)
    _, sides, axes = np.linalg.svd(spread, full_matrices=False)
    thin = np.ptp(spread @ axes[-1])
    if len(corners) < 4 or thin < SHEET / 2:
        return _thickened(corners, axes[-1], thin) if not _hollow(part, corners, axes) else None
    if not closed:
        return None
    try:
        hull = ConvexHull(corners)
    except QhullError:
        return None
    a, b, c = (part.vertices[part.faces[:, i]] - corners.mean(0) for i in range(3))
    volume = abs(float((a * np.cross(b, c)).sum() / 6))
    return corners[hull.vertices] if volume > 0.97 * hull.volume else None


def _hollow(part: Mesh, corners: np.ndarray, axes: np.ndarray) -> bool:
    """Whether a flat part's outline takes in much that it does not cover, as a frame does."""
    a, b, c = (part.vertices[part.faces[:, i]] for i in range(3))
    area = 0.5 * np.abs(np.cross(b - a, c - a) @ axes[-1]).sum()
    try:
        outline = ConvexHull(corners @ axes[:2].T)
    except QhullError:
        return False
    return bool(area < 0.9 * outline.volume)


def _thickened(corners: np.ndarray, normal: np.ndarray, thin: float) -> np.ndarray:
    """A sheet with a thickness, added below where it is level, so that its upper side stays."""
    normal = normal * (1 if normal[2] >= 0 else -1)
    more = SHEET - thin
    return (
        np.concatenate([corners, corners - more * normal])
        if normal[2] > 0.5
        else np.concatenate([corners + more / 2 * normal, corners - more / 2 * normal])
    )


def _coacd(mesh: Mesh, part: np.ndarray, limit: int) -> list[np.ndarray]:
    """Convex pieces of a mesh. Two attempts: a fine one, then a coarse one."""
    low, high = mesh.bounds()
    cell = 0.002
    while len(mesh.faces) > SPLIT_FACES:
        mesh, part = weld(mesh, cell), np.zeros(0, int)
        cell *= 1.5
    part = part if len(part) else topology(mesh).part
    reason = ""
    for fineness in range(len(FINENESS)):
        arrays = {
            "vertices": mesh.vertices,
            "faces": mesh.faces,
            "part": part,
            "limit": np.array(limit),
            "fineness": np.array(fineness),
        }
        try:
            found = run_bounded(
                "mimicbench.objects.importing.convex",
                "coacd_pieces",
                arrays,
                SPLIT_SECONDS,
                SPLIT_BYTES,
                "it cannot be split into convex pieces: ",
            )
        except BadFile as error:
            reason = str(error)
            continue
        pieces = np.split(found["corners"], np.cumsum(found["counts"])[:-1]) if len(found["counts"]) else []
        large = [piece for piece in pieces if np.ptp(piece, axis=0).max() > 0.01 * (high - low).max()]
        return [_solid(piece) for piece in large if not _needle(piece)]
    raise BadObject(f"{reason}; reduce the mesh, or mend its holes first")


def _solid(piece: np.ndarray) -> np.ndarray:
    """A piece of coacd, thickened if it is flat."""
    spread = piece - piece.mean(0)
    axes = np.linalg.svd(spread, full_matrices=False)[2]
    thin = np.ptp(spread @ axes[-1])
    return _thickened(piece, axes[-1], thin) if thin < SHEET / 2 else piece


def coacd_pieces(
    vertices: np.ndarray, faces: np.ndarray, part: np.ndarray, limit: np.ndarray, fineness: np.ndarray
) -> dict[str, np.ndarray]:
    """What runs in a process of its own: corners of all pieces one after the other, and how many each has.

    Parts (F,) are split one by one: small ones as coarsely, measured in meters, as large ones.
    """
    import coacd

    coacd.set_log_level("off")
    options = FINENESS[int(fineness)]
    extent = float(np.linalg.norm(np.ptp(vertices[np.unique(faces)], axis=0)))
    corners: list[np.ndarray] = []
    for name in np.unique(part):
        used, own = np.unique(faces[part == name], return_inverse=True)
        share = max(float(np.linalg.norm(np.ptp(vertices[used], axis=0))) / extent, 1e-3)
        scaled = {
            "threshold": min(options["threshold"] / share, CONVEX),
            "preprocess_resolution": max(round(options["preprocess_resolution"] * share), COARSEST),
        }
        mesh = coacd.Mesh(vertices[used], own.reshape(-1, 3).astype(np.int32))
        found = coacd.run_coacd(mesh, max_convex_hull=int(limit), mcts_max_depth=2, seed=0, **{**options, **scaled})
        corners += [np.asarray(piece[0], float) for piece in found]
    return {
        "corners": np.concatenate(corners) if corners else np.zeros((0, 3)),
        "counts": np.array([len(piece) for piece in corners], np.int64),
    }


def _join(pieces: list[np.ndarray], limit: int) -> list[np.ndarray]:
    """Join pairs of pieces, each time the pair that adds the least volume."""
    pieces = [fewer_corners(piece) for piece in pieces]
    volumes = [ConvexHull(piece).volume for piece in pieces]
    cost = np.full((len(pieces),) * 2, np.inf)

    def added(i: int, j: int) -> float:
        return ConvexHull(np.concatenate([pieces[i], pieces[j]])).volume - volumes[i] - volumes[j]

    for i in range(len(pieces)):
        for j in range(i):
            cost[i, j] = added(i, j)
    for _ in range(len(pieces) - limit):
        i, j = (int(k) for k in np.unravel_index(np.argmin(cost), cost.shape))
        joined = np.concatenate([pieces[i], pieces[j]])
        hull = ConvexHull(joined)
        pieces[j], volumes[j] = fewer_corners(joined[hull.vertices]), hull.volume
        pieces[i] = np.zeros((0, 3))
        cost[i, :] = cost[:, i] = np.inf
        for k, piece in enumerate(pieces):
            if k != j and len(piece):
                cost[max(j, k), min(j, k)] = added(j, k)
    return [piece for piece in pieces if len(piece)]


def fewer_corners(piece: np.ndarray, limit: int = CORNERS) -> np.ndarray:
    """At most `limit` of a piece's corners: the outermost, then again and again the one farthest outside of what is
    chosen.
    """
    corners = piece[ConvexHull(piece).vertices]
    if len(corners) <= limit:
        return corners
    directions = np.concatenate([np.eye(3), -np.eye(3)])
    chosen = sorted({int(i) for i in (corners @ directions.T).argmax(0)})
    farthest = np.linalg.norm(corners - corners[chosen].mean(0), axis=1)
    while len(chosen) < limit:
        try:
            planes = ConvexHull(corners[chosen]).equations
            farthest = (corners @ planes[:, :3].T + planes[:, 3]).max(1)
        except QhullError:
            farthest = np.linalg.norm(corners[:, None] - corners[chosen][None], axis=-1).min(1)
        farthest[chosen] = -1
        if farthest.max() < 1e-4:
            break
        chosen.append(int(farthest.argmax()))
    return corners[sorted(chosen)]


def box_around(piece: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centre (3,), orientation (4,) and half sizes (3,) of the smallest box around a piece that lies flat on one of
    its faces.

    The upright box along the axes is preferred unless another is 5 % smaller.
    """
    hull = ConvexHull(piece)
    normals = hull.equations[np.unique(np.round(hull.equations[:, :3], 6), axis=0, return_index=True)[1], :3]
    best, size = np.eye(3), float(np.ptp(piece, axis=0).prod()) * 0.95
    for normal in np.concatenate([[[0.0, 0.0, 1.0]], normals]):
        across = np.cross(normal, [1.0, 0, 0] if abs(normal[0]) < 0.8 else [0, 1.0, 0])
        across /= np.linalg.norm(across)
        plane = np.stack([across, np.cross(normal, across)])
        flat = piece @ plane.T
        try:
            outline = flat[ConvexHull(flat).vertices]
        except QhullError:
            continue
        edges = np.roll(outline, -1, 0) - outline
        for edge in edges / np.linalg.norm(edges, axis=1, keepdims=True):
            along = edge @ plane
            axes = np.stack([along, np.cross(normal, along), normal])
            volume = float(np.ptp(piece @ axes.T, axis=0).prod())
            if volume < size * (1 - 1e-6):
                best, size = axes, volume
    low, high = (piece @ best.T).min(0), (piece @ best.T).max(0)
    return (low + high) / 2 @ best, _upright(best), (high - low) / 2


def _upright(axes: np.ndarray) -> np.ndarray:
    """The orientation (4,) of a box whose axes are rows (3, 3), right-handed."""
    matrix = axes.T
    return rot.from_matrix(matrix if np.linalg.det(matrix) > 0 else matrix * np.array([1.0, 1.0, -1.0]))
