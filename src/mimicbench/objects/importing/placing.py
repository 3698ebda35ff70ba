"""Stands a mesh of unknown unit and axes on the floor: which unit, which way up, which side is the front, and why.

Every guess comes with its reason, and every one can be overruled.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mimicbench.core.errors import BadObject
from mimicbench.objects.importing.axes import Axis, rotation, usual_front
from mimicbench.objects.importing.mesh import Mesh
from mimicbench.objects.importing.planes import LIE, SIT, LevelPlane, PlaneNeeds, find_plane, surfaces
from mimicbench.objects.importing.topology import Topology, outward, topology

Unit = Literal["m", "cm", "mm", "in", "normalized"]
METERS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}


@dataclass(frozen=True)
class Kind:
    """What is known of a family of objects before one is seen."""

    size: tuple[float, float, float]
    """Longer and shorter side on the floor, and height, as they are on average [m]."""
    needs: PlaneNeeds | None = None
    """What its plane must have, if it is for sitting or lying."""
    front: Literal["long", "short", "any"] = "any"
    """Which side of its outline people come to: a sofa's long one, a bed's short one."""
    touched: bool = False
    """Whether it needs places for two hands."""


KINDS = {
    "chair": Kind((0.62, 0.54, 0.81), SIT),
    "sofa": Kind((1.50, 0.75, 0.70), SIT, "long"),
    "couch": Kind((1.91, 0.87, 0.79), LIE, "long"),
    "bed": Kind((2.27, 1.78, 0.86), LIE, "short"),
    "household": Kind((0.62, 0.50, 0.60), touched=True),
    "box": Kind((0.60, 0.43, 0.60)),
}
"""By family. Sizes are near the paper's table of objects; of other families nothing is expected."""
ANYTHING = Kind((0.65, 0.5, 0.6))
TOO_FAR = np.log(3.0)
"""A side may differ from the average by this factor, three, before the size is refused; six if it is not for sitting or
lying."""
_PRIOR = {
    "glb": {"y+": 0.0, "z+": -1.5},
    "obj": {"y+": 0.0, "z+": -0.4},
    "ply": {"y+": -0.3, "z+": 0.0},
    "stl": {"y+": -0.6, "z+": 0.0},
}
"""What is usual in a format: GLB has y up by its definition, ShapeNet's OBJ files too; what goes to a printer has z up.
Nobody has x up."""
LENIENT = {
    SIT: PlaneNeeds((0.15, 0.90), 0.3, (0.24, 0.24)),
    LIE: PlaneNeeds((0.12, 1.00), 0.3, (0.40, 1.20)),
}
"""What could be meant for a plane to sit or lie on, though it does not do."""
TOY = 0.25
"""Meshes that are so much smaller than usual, as the mean logarithm, and have no plane as they are, are tried in the
usual size: furniture of games."""


@dataclass(frozen=True)
class Wishes:
    """What the user says of a mesh; None: to be guessed."""

    unit: Unit | None = None
    """Unit of the file's numbers; `normalized` if it has none."""
    up: Axis | None = None
    """The file's axis that points up."""
    front: Axis | None = None
    """The file's axis that points to the front, where people come from."""
    height: float | None = None
    """Height that it shall have [m], instead of a unit."""
    scale: float | None = None
    """Meters per unit of the file, instead of a unit."""


@dataclass(frozen=True)
class Placed:
    """A mesh on the floor at the origin, facing +x."""

    mesh: Mesh
    """z up, meters."""
    topology: Topology
    scale: float
    """Meters per unit of the file."""
    up: str
    front: str
    plane: LevelPlane | None
    """The plane to sit or lie on, if there is one."""
    reasons: tuple[str, ...]


def place(mesh: Mesh, kind: Kind, file_format: str, wishes: Wishes) -> Placed:
    """Scale, turn and center a mesh and drop it to the floor.

    Raises BadObject if no reading of its numbers makes sense.
    """
    if wishes.front and wishes.up and wishes.front[0] == wishes.up[0]:
        raise BadObject(f"front {wishes.front} and up {wishes.up} are the same axis; give two different ones")
    ups = [wishes.up] if wishes.up else [up for up in ("y+", "z+") if not (wishes.front and wishes.front[0] == up[0])]
    tried: dict[str, tuple[Placed, float]] = {}
    problems: list[str] = []
    for up in ups:
        try:
            tried[up] = _stand(mesh, kind, up, wishes)
        except BadObject as error:
            problems.append(str(error))
    if not tried:
        raise BadObject(problems[0])
    if wishes.up:
        return _face(tried[wishes.up][0], kind, wishes, f"up is {wishes.up}, as given")
    defined = "GLB has y up by its definition" if file_format == "glb" else ""
    if not defined and _normalized(np.subtract(*mesh.bounds()[::-1]), mesh):
        defined = "so are normalized meshes"
    if defined:
        up = _upright_unless(tried, kind)
    else:
        up = max(tried, key=lambda up: _likely(tried[up], kind) + _PRIOR[file_format].get(up, -2.0))
    best = tried[up][0]
    others = [other for other, (placed, _) in tried.items() if other != up and placed.plane is not None]
    usual = max(_PRIOR[file_format], key=lambda axis: _PRIOR[file_format][axis])
    fits = "the size fits" if kind.needs is None or best.plane is None else "a plane fits"
    fits += ", though no plane does" if kind.needs is not None and best.plane is None else ""
    why = f"up is {up}: {fits}{', and it is usual in ' + file_format.upper() if up == usual else ''}"
    if defined and up == "y+":
        why = f"up is y+: {defined}"
    why += f" (a plane would fit with {' and '.join(others)} too: give --up if this is wrong)" if others else ""
    return _face(best, kind, wishes, why)


def _likely(found: tuple[Placed, float], kind: Kind) -> float:
    """How likely a mesh stands so, but for what is usual: by its plane and its size."""
    placed, cost = found
    return (3.0 if kind.needs is not None and placed.plane else 0.0) - cost


def _upright_unless(tried: dict[str, tuple[Placed, float]], kind: Kind) -> str:
    """y, unless z has a plane where y has nothing like one, and z's size is no less likely."""
    if "y+" not in tried or "z+" not in tried:
        return next(iter(tried))
    (upright, cost), (other, other_cost) = tried["y+"], tried["z+"]
    if kind.needs is None or other.plane is None or upright.plane is not None or other_cost > cost:
        return "y+"
    return "y+" if _plane(upright.mesh, upright.topology, LENIENT[kind.needs]) is not None else "z+"


def _plane(mesh: Mesh, found: Topology, needs: PlaneNeeds) -> LevelPlane | None:
    """The plane of a standing mesh; of parts that are not closed nobody knows which side is outside."""
    return find_plane(surfaces(mesh, found.closed[found.part]), needs)


def _stand(mesh: Mesh, kind: Kind, up: str, wishes: Wishes) -> tuple[Placed, float]:
    """The mesh on the floor with one axis up, its front not yet known, and how unlikely its size is."""
    turned = Mesh(mesh.vertices @ rotation(up, usual_front(up)).T, mesh.faces)
    low, high = turned.bounds()
    scale, cost, why = _scale(high - low, turned, kind, wishes)
    placed = _scaled(turned, kind, up, scale, why)
    logs = _logs((high - low) * scale, kind)
    if (
        kind.needs is not None
        and placed.plane is None
        and wishes == Wishes(up=wishes.up, front=wishes.front)
        and logs.mean() < -TOY
    ):
        usual = scale * float(np.exp(-logs.mean()))
        why = (
            f"1 unit is {usual:.4g} m: in m, cm, mm and in it has no plane or no likely size, so it gets the usual "
            "size of its family; give --height to set it"
        )
        resized = _scaled(turned, kind, up, usual, why)
        if resized.plane is not None:
            return resized, cost + 0.5
    return placed, cost


def _scaled(turned: Mesh, kind: Kind, up: str, scale: float, why: str) -> Placed:
    """A mesh that has z up, in meters, on the floor, centered, its closed parts not inside out, with its plane."""
    low, high = turned.bounds()
    middle = np.array([*(low + high)[:2] / 2, low[2]])
    standing = Mesh((turned.vertices - middle) * scale, turned.faces)
    found = topology(standing)
    standing = outward(standing, found)
    plane = None if kind.needs is None else _plane(standing, found, kind.needs)
    return Placed(standing, found, scale, up, usual_front(up), plane, (why,))


def _logs(size: np.ndarray, kind: Kind) -> np.ndarray:
    """Logarithms (3,) of a bounding box's sides over the usual ones: longer and shorter on the floor, and height."""
    return np.log(np.maximum([max(size[:2]), min(size[:2]), size[2]], 1e-12) / np.array(kind.size))


def _scale(size: np.ndarray, mesh: Mesh, kind: Kind, wishes: Wishes) -> tuple[float, float, str]:
    """Meters per unit, how unlikely the size is, and why. `size` (3,) is the bounding box in the file's unit, z up."""
    shape = f"{size[0]:.4g} x {size[1]:.4g} x {size[2]:.4g}"
    logs = _logs(size, kind)
    if sum(value is not None for value in (wishes.unit, wishes.height, wishes.scale)) > 1:
        raise BadObject("give only one of --unit, --height and --scale")
    if not all(1e-9 < value < 1e9 for value in (wishes.height, wishes.scale) if value is not None):
        raise BadObject("a height or a scale must be a positive number")
    given = wishes.scale if wishes.height is None else wishes.height / float(size[2])
    limit = TOO_FAR + 0.7 * (kind.needs is None)
    fits = [unit for unit, value in METERS.items() if np.abs(logs + np.log(value)).max() <= limit]
    normalized = wishes.unit == "normalized" or (_normalized(size, mesh) and np.abs(logs).max() > 0.15)
    if given is not None:
        scale = given
        why = f"1 unit is {scale:.4g} m, as given"
    elif wishes.unit in (None, "normalized") and (normalized or not fits):
        scale = float(np.exp(-logs.mean()))
        what = "the mesh is normalized" if normalized else "it has no likely size in m, cm, mm or in"
        why = f"1 unit is {scale:.4g} m: {what} ({shape}), so it gets the usual size of its family"
        why += "; give --height to set it"
    elif wishes.unit is not None:
        scale, why = METERS[wishes.unit], f"the unit is {wishes.unit}, as given"
    else:
        costs = {unit: float(np.square(logs + np.log(meters)).sum()) for unit, meters in METERS.items()}
        first, second = sorted(costs, key=lambda unit: costs[unit])[:2]
        scale, why = METERS[first], f"the unit is {first}: {shape} of it is the likeliest size"
        if costs[second] < costs[first] + 1.0:
            why += f" ({second} is possible too: give --unit if this is wrong)"
    final = logs + np.log(scale)
    if not (0 < scale < np.inf) or np.abs(final).max() > limit:
        meters = " x ".join(f"{side * scale:.3g}" for side in size)
        hint = "give --height with its height in metres"
        if fits and given is None:
            hint = f"its numbers look like {fits[0]}: leave --unit out or give --unit {fits[0]}"
        raise BadObject(f"it would be {meters} m large, which is not the size of such an object; {hint}")
    return scale, float(np.square(final).mean()), why


def _normalized(size: np.ndarray, mesh: Mesh) -> bool:
    """Whether the diagonal is 1, as in ShapeNet, or the mesh fits just into the unit ball, as in PartNet."""
    if abs(np.linalg.norm(size) - 1) < 2e-3:
        return True
    low, high = mesh.bounds()
    radius = np.linalg.norm(mesh.vertices[np.unique(mesh.faces)], axis=1).max()
    return bool(abs(radius - 1) < 2e-3 and np.abs(low + high).max() < 0.2)


def _face(placed: Placed, kind: Kind, wishes: Wishes, why_up: str) -> Placed:
    """Turn the front to +x and center again."""
    if wishes.front:
        front, why = wishes.front, f"front is {wishes.front}, as given"
    else:
        front, why = _front(placed, kind)
    # from the usual front to the wanted one, both seen in the file's axes
    turn = rotation(placed.up, front) @ rotation(placed.up, placed.front).T
    mesh = Mesh(placed.mesh.vertices @ turn.T, placed.mesh.faces)
    low, high = mesh.bounds()
    mesh = Mesh(mesh.vertices - np.array([*(low + high)[:2] / 2, low[2]]), mesh.faces)
    plane = None if kind.needs is None else _plane(mesh, placed.topology, kind.needs)
    return Placed(mesh, placed.topology, placed.scale, placed.up, front, plane, (*placed.reasons, why_up, why))


def _front(placed: Placed, kind: Kind) -> tuple[str, str]:
    """The file's axis to the front: away from what stands higher than the plane, which is the back.

    Else what is usual.
    """
    low, high = placed.mesh.bounds()
    length, width = (high - low)[:2]
    usual = placed.front
    why = f"front is {usual}, as usual with {placed.up} up"
    if (
        kind.front != "any"
        and (length > width) != (kind.front == "short")
        and abs(length - width) > 0.1 * max(length, width)
    ):
        usual = _in_file(placed, np.array([0.0, 1.0, 0.0]))
        why = f"front is {usual}, on the {kind.front} side"
    if placed.plane is None:
        return usual, f"{why}: there is no plane to tell it by" if kind.needs else why
    found = surfaces(placed.mesh)
    above = found.height > placed.plane.height + 0.10
    if above.any():
        middle = placed.plane.polygon.mean(0)
        # by how high it stands: armrests are as many cells as a thin back
        rise = found.height[above] - placed.plane.height
        back = np.average(found.xy(found.cell[above]) - middle, axis=0, weights=rise) / (high - low)[:2]
        if kind.front != "any" and abs(length - width) > 0.1 * max(length, width):
            # an armrest at one end is no back
            back[0 if (length > width) == (kind.front == "long") else 1] = 0.0
        if np.abs(back).max() > 0.12:
            axis = int(np.abs(back).argmax())
            front = _in_file(placed, -np.sign(back[axis]) * np.eye(3)[axis])
            return front, f"front is {front}: what stands higher than the plane is on the other side"
    return usual, f"{why}: nothing stands higher than the plane on one side; give --front if this is wrong"


def _in_file(placed: Placed, direction: np.ndarray) -> str:
    """The file's axis that a direction (3,) of the standing mesh is."""
    found = rotation(placed.up, placed.front).T @ direction
    index = int(np.abs(found).argmax())
    return "xyz"[index] + ("+" if found[index] > 0 else "-")
