"""Makes scene objects of the user's own meshes: stage `objects` from files instead of from a seed."""

import hashlib
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull, Delaunay, QhullError

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadFile, BadObject, MimicbenchError
from mimicbench.core.files import write_record
from mimicbench.core.foreign.untrusted import is_file
from mimicbench.core.names import printable
from mimicbench.core.stage import Stage, StageKey, opened
from mimicbench.objects.importing.convex import box_around, split
from mimicbench.objects.importing.evidence import Evidence, read_evidence
from mimicbench.objects.importing.mend import close_holes
from mimicbench.objects.importing.mesh import MAX_BYTES, Mesh, read_mesh
from mimicbench.objects.importing.placing import ANYTHING, KINDS, LIE, Kind, Placed, Wishes, place
from mimicbench.objects.importing.planes import LevelPlane
from mimicbench.objects.importing.sheets import one_sheet
from mimicbench.objects.shape import SceneObject, save_object
from mimicbench.objects.touch import UPRIGHT, with_touch_points

TOLERANCE = 0.03
"""[m]; if the pieces' top is farther from the mesh's plane than this, it is said; if farther than three times this, the
object is refused."""
BOX_LIKE = 0.985
"""A piece that fills this share of its box is replaced by the box."""
LIFTED, MASS = "box", 2.0
"""The family of what is lifted, and its usual mass [kg]."""
COLORS = ((0.62, 0.55, 0.47), (0.56, 0.52, 0.49), (0.68, 0.61, 0.53), (0.50, 0.47, 0.44))

USUAL = {"chair": (0.36, 0.52), "sofa": (0.35, 0.48), "couch": (0.35, 0.59), "bed": (0.37, 0.64)}
"""Lowest and highest plane to sit or lie on [m] of 200 that are made of each family."""


@dataclass(frozen=True)
class ImportConfig:
    """How meshes become objects."""

    wishes: Wishes = Wishes()
    pieces: str = "convex"
    """`convex`, or `boxes` to replace every convex piece by the box around it."""
    mass: float | None = None
    """[kg], of objects to be lifted; MASS if nothing is said."""


def import_mesh(
    path: Path, family: str, config: ImportConfig, object_id: str | None = None
) -> tuple[SceneObject, Evidence]:
    """One object of one file. Raises BadFile or BadObject with the file's name in it."""
    mesh = read_mesh(path)
    try:
        _check_thick(mesh)
        return _make(mesh, path, family, config, object_id or own_id(path))
    except BadObject as error:
        raise BadObject(f"{path}: {error}") from None
    except QhullError:
        raise BadObject(f"{path}: a piece of it has no volume; mend or simplify the mesh") from None


def _make(mesh: Mesh, path: Path, family: str, config: ImportConfig, object_id: str) -> tuple[SceneObject, Evidence]:
    kind = KINDS.get(family, ANYTHING)
    check_mass(family, config.mass)
    mesh, pairs = one_sheet(mesh)
    placed = place(mesh, kind, path.suffix.lower()[1:], config.wishes)
    _check_plane(placed, kind)
    solid, found, mended = close_holes(placed.mesh, placed.topology)
    pieces, how = split(solid, found)
    sheets = [f"{pairs} faces come twice, once reversed: sheets, of use from both sides"] if pairs else []
    leans = [f"the plane leans by {placed.plane.tilt:.0f} degrees"] if placed.plane and placed.plane.tilt > 3 else []
    reasons = [*placed.reasons, *leans, *sheets, *mended, *how]
    boxes = [box_around(piece) for piece in pieces]
    volumes, filled = _volumes(pieces), np.array([8 * half.prod() for _, _, half in boxes])
    is_box = (volumes >= BOX_LIKE * filled) | (config.pieces == "boxes")
    hulls = tuple(_corners(box) if flat else piece for piece, box, flat in zip(pieces, boxes, is_box, strict=True))
    drop = min(float(hull[:, 2].min()) for hull in hulls)
    hulls = tuple(hull - np.array([0, 0, drop]) for hull in hulls)
    height, polygon = None, np.zeros((0, 2))
    if placed.plane is not None:
        polygon = placed.plane.polygon
        height, said = _carried(hulls, placed.plane)
        reasons += [said, *_unusual(family, height)]
    obj = SceneObject(
        object_id,
        family,
        "own",
        np.array([box[0] for box in boxes]) - np.array([0, 0, drop]),
        np.array([box[1] for box in boxes]),
        np.array([box[2] for box in boxes]),
        np.array([COLORS[i % len(COLORS)] for i in range(len(boxes))]),
        height,
        polygon,
        head_xy=_head(placed) if kind.needs is LIE else np.zeros(0),
        movable=family == LIFTED,
        mass=(config.mass or MASS) if family == LIFTED else None,
        hulls=() if is_box.all() else hulls,
    )
    if kind.touched:
        # touch points are made on boxes; only where a box is the piece itself are they on the surface
        obj = with_touch_points(obj, [(int(box), side) for box in np.flatnonzero(is_box) for side in UPRIGHT])
        reasons.append(f"{len(obj.touch_points)} touch points on the pieces that are boxes")
    length, width, tall = np.subtract(*obj.bounds()[::-1]).tolist()
    evidence = Evidence(
        object_id,
        printable(path.name),
        _sha256(path),
        placed.scale,
        placed.up,
        placed.front,
        (length, width, tall),
        len(pieces),
        int(is_box.sum()),
        float(volumes.sum() / filled.sum()),
        height,
        placed.plane.height if placed.plane else None,
        placed.plane.area if placed.plane else None,
        polygon.round(4).tolist(),
        tuple(reasons),
    )
    return obj, evidence


def _check_thick(mesh: Mesh) -> None:
    """A mesh has three sides. Raises BadObject."""
    size = np.subtract(*mesh.bounds()[::-1])
    if size.min() < 1e-6 * size.max():
        shape = " x ".join(f"{side:.3g}" for side in size)
        raise BadObject(f"it is flat, {shape} in the file's unit; give a mesh that has a thickness")


def _check_plane(placed: Placed, kind: Kind) -> None:
    """A mesh to sit or lie on has a plane for that. Raises BadObject."""
    if kind.needs is None or placed.plane is not None:
        return
    low, high = kind.needs.heights
    raise BadObject(
        f"no level, free surface of {kind.needs.size[0]:.2f} x {kind.needs.size[1]:.2f} m is "
        f"{low:.2f} to {high:.2f} m high "
        f"({'; '.join(placed.reasons)}); give --up, --unit or --height if that is wrong"
    )


def _carried(hulls: Sequence[np.ndarray], plane: LevelPlane) -> tuple[float, str]:
    """Height of the pieces' top within a plane's outline [m], and how near that is to the mesh, in words.

    Raises BadObject if they are far apart.
    """
    height, deviation = _top_of(hulls, plane)
    if deviation > 3 * TOLERANCE:
        raise BadObject(
            f"its {len(hulls)} pieces are {100 * deviation:.0f} cm off the plane at "
            f"{plane.height:.2f} m; mend or simplify the mesh"
        )
    note = ": too much to trust contacts there; look at the pieces" if deviation > TOLERANCE else ""
    return height, f"the pieces' top is within {1000 * deviation:.0f} mm of the mesh over 90 % of the plane{note}"


def _unusual(family: str, height: float) -> list[str]:
    """What to say of a plane as high [m] as none is that we make: a sofa taken for a chair becomes a toy."""
    low, high = USUAL.get(family, (0.0, np.inf))
    if low <= height <= high:
        return []
    kind = f"those that are made have it {low:.2f} to {high:.2f} m high"
    return [f"{kind}: if this is no {family}, give its --task, if it is larger or smaller, --height"]


def check_mass(family: str, mass: float | None) -> None:
    """A mass is of an object to be lifted, and can be. Raises BadObject."""
    if mass is not None and family != LIFTED:
        raise BadObject(f"--mass is of objects to be lifted; a {family} stays where it is: leave that out")
    if mass is not None and not 0 < mass < 1000:
        raise BadObject(f"a mass of {mass} kg cannot be; give --mass between 0 and 1000")


def import_objects(
    folder: Path, task: str, family: str, files: Sequence[Path], config: ImportConfig, say: Callable[[str], None]
) -> tuple[Stage, list[Evidence]]:
    """Stage `objects` made of files: `<id>.json` per object, and `evidence/<id>.json` beside them.

    All files are read before anything is written. Raises MimicbenchError at the first that cannot be used.
    """
    if not files:
        raise MimicbenchError("give at least one file: mimicbench objects import chair.obj")
    check_mass(family, config.mass)
    ids = own_ids(files)
    missing = next((path for path in files if not is_file(path)), None)
    if missing is not None:
        raise BadFile(f"{missing} does not exist or is no file")
    sources = {object_id: _sha256(path) for object_id, path in zip(ids, files, strict=True)}
    key = StageKey("objects", task, 0, {"imported": sources, "import": asdict(config)})
    with opened(folder, key) as stage:
        if stage.complete:
            return stage, [read_evidence(folder, object_id) for object_id in ids]
        made = []
        for path, object_id in zip(files, ids, strict=True):
            made.append(import_mesh(path, family, config, object_id))
            say(made[-1][1].text())
        for obj, evidence in made:
            save_object(folder, obj)
            write_record(folder / "evidence" / f"{obj.id}.json", asdict(evidence))
        summary = {"count": len(made), "test": sum(obj.split == "test" for obj, _ in made)}
        return stage.finish(**summary), [evidence for _, evidence in made]


def _sha256(path: Path) -> str:
    if path.stat().st_size > MAX_BYTES:
        raise BadFile(
            f"{path} has {path.stat().st_size >> 20} MiB, more than {MAX_BYTES >> 20}; reduce the "
            "mesh to some ten thousand faces first"
        )
    return hashlib.sha256(path.read_bytes()).hexdigest()


def own_id(path: Path) -> str:
    """`own-` and the file's name in small letters, digits and hyphens: safe as a file name, and no family's id."""
    name = re.sub(r"[^a-z0-9]+", "-", path.stem.lower()).strip("-")[:60].strip("-")
    return f"own-{name or 'object'}"


def own_ids(files: Sequence[Path]) -> list[str]:
    """One id per file; where two would be the same, a few digits of the files' content tell them apart, whatever
    their order.
    """
    names = [own_id(path) for path in files]
    ids = [
        f"{name}-{_sha256(path)[:8]}" if names.count(name) > 1 and is_file(path) else name
        for name, path in zip(names, files, strict=True)
    ]
    if len(set(ids)) < len(ids):
        raise MimicbenchError("the same file is given twice; give each once")
    return ids


def _volumes(pieces: Sequence[np.ndarray]) -> np.ndarray:
    return np.array([ConvexHull(piece).volume for piece in pieces])


def _corners(box: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    """(8, 3) corners of a box."""
    signs = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1], indexing="ij"), -1).reshape(8, 3)
    return box[0] + rot.rotate(box[1], signs * box[2])


def tops(hulls: Sequence[np.ndarray], points: np.ndarray) -> np.ndarray:
    """Height (N,) of the highest convex piece over points (N, 2) [m], -inf where there is none."""
    best = np.full(len(points), -np.inf)
    for hull in hulls:
        planes = ConvexHull(hull).equations
        a, b = planes[:, :2] @ points.T + planes[:, 3:], planes[:, 2:3]
        with np.errstate(divide="ignore", invalid="ignore"):
            bound = -a / b
        high = np.where(b > 1e-9, bound, np.inf).min(0)
        low = np.where(b < -1e-9, bound, -np.inf).max(0)
        beside = np.where(np.abs(b) <= 1e-9, a, -np.inf).max(0) > 1e-9
        best = np.where((high >= low) & ~beside & (high > best), high, best)
    return best


def _top_of(hulls: Sequence[np.ndarray], plane: LevelPlane) -> tuple[float, float]:
    """Median height of the pieces' top within a plane's outline, and how far 90 % of it is from the mesh's plane at
    most [m].
    """
    axes = [np.linspace(low, high, 25) for low, high in zip(plane.polygon.min(0), plane.polygon.max(0), strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 2)
    middle = plane.polygon.mean(0)
    inside = Delaunay(middle + 0.95 * (plane.polygon - middle)).find_simplex(grid) >= 0
    height = tops(hulls, grid[inside])
    off = np.maximum(np.abs(height - plane.height) - plane.spread, 0.0)
    return float(np.median(height)), float(np.quantile(np.nan_to_num(off, posinf=1e3), 0.9))


def _head(placed: Placed) -> np.ndarray:
    """Where the head goes (2,) [m]: at the end of the plane's longer side where more stands higher than it.

    0.25 m from that end.
    """
    assert placed.plane is not None
    polygon = placed.plane.polygon
    low, high = polygon.min(0), polygon.max(0)
    axis = int(np.argmax(high - low))
    above = placed.mesh.vertices[placed.mesh.vertices[:, 2] > placed.plane.height + 0.05]
    middle = (low + high) / 2
    side = -1.0
    if len(above):
        reach = [
            above[(above[:, axis] - middle[axis]) * sign > 0.3 * (high - low)[axis], 2].max(initial=0.0)
            for sign in (-1.0, 1.0)
        ]
        side = 1.0 if reach[1] > reach[0] + 0.02 else -1.0
    head = middle.copy()
    head[axis] += side * ((high - low)[axis] / 2 - 0.25)
    return head
