"""Pictures of objects: one sheet per family, and what becomes of imported meshes."""

import sys
from functools import partial
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np
import trimesh
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from scipy.spatial import ConvexHull

from doc_pictures.picture import DocPicture, of_objects
from mimicbench.drawing.camera import Picture
from mimicbench.objects.importing.own import ImportConfig, import_mesh
from mimicbench.objects.registry import FAMILIES
from mimicbench.objects.shape import SceneObject
from mimicbench.report.pictures.sheet import contact_sheet

SHEETS = {"chair": 24, "sofa": 18, "bed": 18, "couch": 18, "box": 24, "household": 35}
"""Family -> objects on its sheet."""
NAMES = {"chair": "chairs", "sofa": "sofas", "bed": "beds", "couch": "couches", "box": "boxes"}
VIEW = (22.0, 35.0)
"""Elevation and azimuth from which imported meshes are seen [deg]."""
TOWARDS = np.array(
    [*np.cos(np.radians(VIEW[0])) * np.array([np.cos(np.radians(VIEW[1])), np.sin(np.radians(VIEW[1]))]), 0.37]
)
COLORS = np.array([plt.get_cmap("Set2")(i)[:3] for i in range(8)])
"""Of pieces."""
TESTS = Path(__file__).parents[2] / "tests"


def sheets() -> list[DocPicture]:
    """One per family."""
    return [
        DocPicture(
            f"{NAMES.get(family, family)}.png",
            partial(first, family, count),
            of_objects,
            partial(contact_sheet, columns=7 if family == "household" else 6, cell=Picture(200, 180, 2048), workers=1),
        )
        for family, count in SHEETS.items()
    ]


def first(family: str, count: int) -> list[SceneObject]:
    """The first objects of a family, of seed 0."""
    return [FAMILIES.get(family).make(index, 0) for index in range(count)]


def imported() -> list[tuple[trimesh.Trimesh, SceneObject]]:
    """Meshes of the tests, and the objects made of them."""
    if str(TESTS) not in sys.path:
        sys.path.insert(0, str(TESTS))
    shapes = import_module("shapes")
    meshes = {
        "chair": shapes.chair(),
        "one-piece": shapes.swept(_one_piece(), 0.44),
        "sofa": shapes.sofa(),
    }
    found = []
    with TemporaryDirectory() as folder:
        for name, mesh in meshes.items():
            path = Path(folder) / f"{name}.stl"
            mesh.export(path)
            obj, _ = import_mesh(path, "sofa" if name == "sofa" else "chair", ImportConfig())
            found.append((mesh, obj))
    return found


def _one_piece() -> np.ndarray:
    """Section of a chair bent from one board, counter-clockwise: foot, rise, seat, back."""
    outer = [(-0.2, 0.0), (0.22, 0.0), (0.22, 0.03), (-0.13, 0.03), (-0.17, 0.41), (0.22, 0.41), (0.22, 0.45)]
    return np.array([*outer, (-0.18, 0.45), (-0.24, 0.92), (-0.27, 0.92), (-0.21, 0.41)])


def draw_imported(found: list[tuple[trimesh.Trimesh, SceneObject]]) -> np.ndarray:
    """Per row a mesh, its pieces with the seat's outline, and the boxes around them."""
    figure = plt.figure(figsize=(9.0, 3.0 * len(found)), layout="constrained")
    for row, (mesh, obj) in enumerate(found):
        low, high = obj.bounds()
        mesh = mesh.copy()
        mesh.apply_translation(0.5 * (low + high) - mesh.bounds.mean(0))
        whole = [(mesh.triangles, mesh.face_normals, np.array([0.58, 0.52, 0.45]))]
        pieces, boxes = (
            [(*_faces(corners), COLORS[i % len(COLORS)]) for i, corners in enumerate(solids)]
            for solids in (obj.hulls or obj.corners(), obj.corners())
        )
        for column, solids in enumerate((whole, pieces, boxes)):
            axis = figure.add_subplot(len(found), 3, 3 * row + column + 1, projection="3d")
            for triangles, normals, rgb in solids:
                seen = normals @ TOWARDS > 0  # what faces away would be drawn over what is seen
                triangles, normals = triangles[seen], normals[seen]
                light = 0.7 + 0.3 * normals @ np.array([0.35, 0.2, 0.91])
                axis.add_collection3d(
                    Poly3DCollection(triangles, facecolors=np.clip(light[:, None] * rgb, 0, 1), edgecolors="none")
                )
            if column == 1 and len(obj.seat_polygon):
                line = np.vstack([obj.seat_polygon, obj.seat_polygon[:1]])
                axis.plot(line[:, 0], line[:, 1], np.full(len(line), obj.require_seat() + 0.005), "r-", zorder=9)
            span = 0.5 * float((high - low).max())
            middle = 0.5 * (low + high)
            axis.set(
                xlim=middle[0] + span * np.array([-1, 1]),
                ylim=middle[1] + span * np.array([-1, 1]),
                zlim=middle[2] + span * np.array([-1, 1]),
                box_aspect=(1, 1, 1),
            )
            axis.view_init(*VIEW)
            axis.set_axis_off()
    return pixels(figure)


def _faces(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (N, 3, 3) of the hull of corners, and their outward normals (N, 3)."""
    hull = ConvexHull(corners)
    return corners[hull.simplices], hull.equations[:, :3]


def pixels(figure: Figure, dpi: int = 90) -> np.ndarray:
    """(H, W, 3), uint8, of a figure, which is closed."""
    figure.set_dpi(dpi)
    figure.canvas.draw()
    found = np.asarray(figure.canvas.buffer_rgba())[..., :3].copy()  # type: ignore[attr-defined]
    plt.close(figure)
    return found


def pictures() -> list[DocPicture]:
    """All."""
    return [
        *sheets(),
        DocPicture("own-objects.png", imported, lambda found: of_objects([obj for _, obj in found]), draw_imported),
    ]
