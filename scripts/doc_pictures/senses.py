"""Pictures of docs/senses.md: what the cameras see, and the maps made of it."""

from dataclasses import dataclass

import matplotlib
import numpy as np

matplotlib.use("agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from doc_pictures.objects import pixels
from doc_pictures.picture import DocPicture, of_objects
from mimicbench.core import rotations as rot
from mimicbench.core.seeds import rng
from mimicbench.drawing.camera import Camera, Picture
from mimicbench.objects.registry import FAMILIES
from mimicbench.objects.shape import SceneObject
from mimicbench.objects.touch import stance_before, touch_pair
from mimicbench.report.render import Painter
from mimicbench.robots.registry import ROBOTS
from mimicbench.robots.rigs import HEAD_RIG, PELVIS_RIG, Rig
from mimicbench.sensors.elevation import down_map, map_from_depth
from mimicbench.sensors.elevation_cpu import Poses
from mimicbench.sensors.render import ROBOT, RigCameras, Views
from mimicbench.sensors.sight.views import views as camera_views
from mimicbench.sensors.targets import mark_targets, target_map
from mimicbench.sim.native import NativePhysics
from mimicbench.sim.physics import PhysicsConfig, RobotState
from mimicbench.sim.rows import Rows

H1 = ROBOTS.get("h1")
COLORS = np.array([(225, 232, 240), (196, 190, 180), (222, 128, 48), (70, 100, 160)], np.uint8)
"""Of nothing, floor, object and robot."""
EXTENT = (2.56, -2.56, 2.56, -2.56)


def scene(obj: SceneObject, x: float, y: float, yaw: float) -> NativePhysics:
    """A robot at rest beside an object."""
    pos, quat = H1.forward_kinematics(np.zeros(3), rot.IDENTITY, np.array(H1.rest_pose))
    height = -H1.keypoint_pos("left_sole", pos, quat)[2]
    physics = NativePhysics(H1, [obj], PhysicsConfig(visuals=True), workers=1)
    state = RobotState.of(np.array([[x, y, height]]), rot.from_yaw(np.array([yaw])), np.array([H1.rest_pose]))
    physics.reset(Rows.every(1), state)
    return physics


def look(physics: NativePhysics, rig: Rig, robot: bool = True) -> Views:
    """All pictures at the paper's size."""
    with RigCameras(physics.model(0), rig, robot=robot) as cameras:
        return cameras.look(physics.qpos()[0])


def outside(physics: NativePhysics, camera: Camera) -> np.ndarray:
    """The scene as somebody else sees it."""
    with Painter(physics.model(0), Picture(720, 560), camera) as painter:
        return painter.draw(physics.qpos()[0])


def panels(rows: int, columns: int, width: float, height: float) -> tuple[Figure, np.ndarray]:
    """A figure of panels without ticks."""
    figure, axes = plt.subplots(rows, columns, figsize=(width, height), layout="constrained", squeeze=False)
    for ax in axes.flat:
        ax.set_xticks([])
        ax.set_yticks([])
        for spine in ax.spines.values():
            spine.set_visible(False)
    return figure, axes


def draw_map(ax: Axes, heights: np.ndarray, title: str, top: float, half: float = 2.56) -> None:
    """A map as the paper draws it: the robot in the middle, facing down; its left is on the right."""
    ax.imshow(
        heights, cmap="gray", vmin=heights.min(), vmax=top, extent=(-half, half, half, -half), interpolation="nearest"
    )
    ax.plot(0, 0, marker="v", color="tab:red", markersize=6)
    ax.set_title(title, fontsize=9)


@dataclass(frozen=True)
class Scenes:
    """A chair that is walked to, a thing that is touched, and a box that is lifted."""

    chair: SceneObject
    thing: SceneObject
    box: SceneObject
    targets: np.ndarray
    """(2, 3) on the thing [m]."""


def make() -> Scenes:
    """What all pictures of the senses show."""
    thing = FAMILIES.get("household").make(9, 0)
    targets = np.array(touch_pair(thing, rng(0, "pictures")))
    return Scenes(FAMILIES.get("chair").make(3, 0), thing, FAMILIES.get("box").make(0, 0), targets)


def arrays(scenes: Scenes) -> list[np.ndarray]:
    """They as numbers."""
    return [*of_objects([scenes.chair, scenes.thing, scenes.box]), scenes.targets]


def walk_of(scenes: Scenes) -> NativePhysics:
    """The robot before the chair."""
    return scene(scenes.chair, 1.05, 0.35, np.pi + 0.35)


def near_of(scenes: Scenes) -> NativePhysics:
    """The robot before the thing."""
    return scene(scenes.thing, *stance_before(scenes.thing, *scenes.targets))


def cameras(scenes: Scenes) -> np.ndarray:
    """What every camera sees."""
    views, near = look(walk_of(scenes), PELVIS_RIG), near_of(scenes)
    root_pos, root_quat = near.qpos()[0, :3], near.qpos()[0, 3:7]
    figure, axes = panels(2, 3, 12, 6.2)
    for ax, picture, mount in zip(
        (axes[0, 1], axes[0, 0], axes[1, 0], axes[1, 1]), views.color, PELVIS_RIG.mounts, strict=True
    ):
        ax.imshow(picture)
        ax.set_title(f"pelvis: {mount.name}", fontsize=9)
    color = look(near, HEAD_RIG).color
    axes[0, 2].imshow(mark_targets(color, HEAD_RIG, root_pos, root_quat, scenes.targets, radius=4)[0])
    axes[0, 2].set_title("head: the targets of touch-points in red (here 9 x 9 pixels)", fontsize=9)
    before = scene(scenes.box, scenes.box.bounds()[1][0] + 0.4, 0.0, np.pi)
    axes[1, 2].imshow(look(before, HEAD_RIG).color[0])
    axes[1, 2].set_title("head: lift-box", fontsize=9)
    return pixels(figure)


def modalities(scenes: Scenes) -> np.ndarray:
    """Color, depth and segmentation of one camera."""
    views = look(walk_of(scenes), PELVIS_RIG)
    figure, axes = panels(1, 3, 12, 3.3)
    axes[0, 0].imshow(views.color[1])
    axes[0, 0].set_title("color", fontsize=9)
    shown = axes[0, 1].imshow(views.depth[1], cmap="viridis_r", norm=LogNorm(0.05, 50))
    axes[0, 1].set_title("depth [m]", fontsize=9)
    figure.colorbar(shown, ax=axes[0, 1], ticks=[0.05, 0.2, 0.5, 1, 2, 6, 20, 50], format="%g", shrink=0.8)
    axes[0, 2].imshow(COLORS[np.minimum(views.labels[1], ROBOT)])
    axes[0, 2].set_title("segmentation: nothing, floor, object, robot", fontsize=9)
    return pixels(figure)


def views(scenes: Scenes) -> np.ndarray:
    """Color and depth in small, as networks see them."""
    figure, axes = panels(1, 4, 12, 3.3)
    told = (
        ("pelvis rig, before a chair", walk_of(scenes), PELVIS_RIG),
        ("head, at a thing", near_of(scenes), HEAD_RIG),
    )
    for (name, physics, rig), (left, right) in zip(told, axes.reshape(2, 2), strict=True):
        qpos = physics.qpos()
        poses = Poses(qpos[:, :3], qpos[:, 3:7], *physics.object_pose())
        targets = scenes.targets[None] if rig is HEAD_RIG else None
        (seen,) = camera_views(physics.objects, poses, rig, targets)
        left.imshow(seen[:3].transpose(1, 2, 0), interpolation="nearest")
        left.set_title(f"{name}: color", fontsize=9)
        right.imshow(seen[3], cmap="viridis_r", interpolation="nearest", vmin=0, vmax=1)
        right.set_title("depth up to 6 m", fontsize=9)
    return pixels(figure)


def elevation(scenes: Scenes) -> np.ndarray:
    """Maps of both scenes."""
    walk, near = walk_of(scenes), near_of(scenes)
    figure, axes = panels(2, 3, 12, 8.2)
    axes[0, 0].imshow(outside(walk, Camera((0.45, 0.1, 0.7), 4.2, 150.0, -20.0)))
    axes[0, 0].set_title("sit-chair", fontsize=9)
    depth = look(walk, PELVIS_RIG, robot=False).depth[None]
    top = float(down_map(walk).max())
    drawn = map_from_depth(depth, walk.qpos()[:, :3], walk.qpos()[:, 3:7])[0].numpy()
    draw_map(axes[0, 1], drawn, "four depth images of 360 x 480, cells of 4 cm", top)
    draw_map(axes[0, 2], down_map(walk)[0].numpy(), "rays straight down", top)
    axes[1, 0].imshow(outside(near, Camera((0.4, 0.0, 0.7), 3.6, 130.0, -20.0)))
    axes[1, 0].set_title("touch-points", fontsize=9)
    depth = look(near, HEAD_RIG, robot=False).depth[None]
    fine = map_from_depth(depth, near.qpos()[:, :3], near.qpos()[:, 3:7], HEAD_RIG, 0.01)[0].numpy()
    draw_map(axes[1, 1], fine, "one depth image of 360 x 480, cells of 1 cm", float(fine.max()) + 0.1, 0.64)
    goal = target_map(near.qpos()[:, :3], near.qpos()[:, 3:7], scenes.targets[None])[0].numpy()
    draw_map(axes[1, 2], goal, "target map", float(fine.max()) + 0.1, 0.64)
    return pixels(figure)


def pictures() -> list[DocPicture]:
    """All."""
    return [DocPicture(f"{draw.__name__}.png", make, arrays, draw) for draw in (cameras, modalities, views, elevation)]
