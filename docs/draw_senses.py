"""Draws the pictures of docs/senses.md: `python docs/draw_senses.py`. Needs OpenGL."""

from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from mimicbench.core import rotations as rot
from mimicbench.core.seeds import rng
from mimicbench.objects.registry import FAMILIES
from mimicbench.objects.shape import SceneObject
from mimicbench.objects.touch import stance_before, touch_pair
from mimicbench.report.render import Camera, Painter, Picture
from mimicbench.robots.registry import ROBOTS
from mimicbench.robots.rigs import HEAD_RIG, PELVIS_RIG, Rig
from mimicbench.sensors.elevation import down_map, map_from_depth
from mimicbench.sensors.render import ROBOT, RigCameras, Views
from mimicbench.sensors.targets import mark_targets, target_map
from mimicbench.sim.native import NativePhysics
from mimicbench.sim.physics import PhysicsConfig, RobotState
from mimicbench.sim.rows import Rows

IMAGES = Path(__file__).parent / "images"
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


def save(figure: Figure, name: str) -> None:
    """Write a figure."""
    figure.savefig(IMAGES / name, dpi=90)
    plt.close(figure)


def draw_map(ax: Axes, heights: np.ndarray, title: str, top: float, half: float = 2.56) -> None:
    """A map as the paper draws it: the robot in the middle, facing down; its left is on the right."""
    ax.imshow(
        heights, cmap="gray", vmin=heights.min(), vmax=top, extent=(-half, half, half, -half), interpolation="nearest"
    )
    ax.plot(0, 0, marker="v", color="tab:red", markersize=6)
    ax.set_title(title, fontsize=9)


def main() -> None:
    """All pictures."""
    walk = scene(FAMILIES.get("chair").make(3, 0), 1.05, 0.35, np.pi + 0.35)
    views = look(walk, PELVIS_RIG)
    thing = FAMILIES.get("household").make(9, 0)
    targets = np.array(touch_pair(thing, rng(0, "pictures")))
    near = scene(thing, *stance_before(thing, *targets))
    root_pos, root_quat = near.qpos()[0, :3], near.qpos()[0, 3:7]
    hands = look(near, HEAD_RIG)

    figure, axes = panels(2, 3, 12, 6.2)
    for ax, picture, mount in zip(
        (axes[0, 1], axes[0, 0], axes[1, 0], axes[1, 1]), views.color, PELVIS_RIG.mounts, strict=True
    ):
        ax.imshow(picture)
        ax.set_title(f"pelvis: {mount.name}", fontsize=9)
    axes[0, 2].imshow(mark_targets(hands.color, HEAD_RIG, root_pos, root_quat, targets, radius=4)[0])
    axes[0, 2].set_title("head: the targets of touch-points in red (here 9 x 9 pixels)", fontsize=9)
    box = FAMILIES.get("box").make(0, 0)
    axes[1, 2].imshow(look(scene(box, box.bounds()[1][0] + 0.4, 0.0, np.pi), HEAD_RIG).color[0])
    axes[1, 2].set_title("head: lift-box", fontsize=9)
    save(figure, "cameras.png")

    figure, axes = panels(1, 3, 12, 3.3)
    axes[0, 0].imshow(views.color[1])
    axes[0, 0].set_title("color", fontsize=9)
    shown = axes[0, 1].imshow(views.depth[1], cmap="viridis_r", norm=LogNorm(0.05, 50))
    axes[0, 1].set_title("depth [m]", fontsize=9)
    figure.colorbar(shown, ax=axes[0, 1], ticks=[0.05, 0.2, 0.5, 1, 2, 6, 20, 50], format="%g", shrink=0.8)
    axes[0, 2].imshow(COLORS[np.minimum(views.labels[1], ROBOT)])
    axes[0, 2].set_title("segmentation: nothing, floor, object, robot", fontsize=9)
    save(figure, "modalities.png")

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
    goal = target_map(near.qpos()[:, :3], near.qpos()[:, 3:7], targets[None])[0].numpy()
    draw_map(axes[1, 2], goal, "target map", float(fine.max()) + 0.1, 0.64)
    save(figure, "elevation.png")


if __name__ == "__main__":
    main()
