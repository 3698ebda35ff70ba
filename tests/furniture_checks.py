"""What holds of every piece of furniture to sit or lie on, whatever its family."""

import mujoco
import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.objects.shape import SLOTS, SceneObject


def sizes(objects):
    """(N, 3) extents along x, y, z [m]."""
    return np.array([np.subtract(*obj.bounds()[::-1]) for obj in objects])


def inside(obj, points):
    """Whether any box of the object holds each of the points (N, 3)."""
    local = rot.rotate_inverse(obj.box_quat[:, None], points[None] - obj.box_pos[:, None])
    return (np.abs(local) <= obj.box_half[:, None] + 1e-9).all(-1).any(0)


def grid(obj, margin=0.012, count=25):
    """(N, 2) points of the plane, a margin away from its edge."""
    low, high = obj.seat_polygon.min(0) + margin, obj.seat_polygon.max(0) - margin
    return np.stack(np.meshgrid(*np.linspace(low, high, count).T), -1).reshape(-1, 2)


def at_height(points, height):
    return np.column_stack([points, np.full(len(points), height)])


def touching(obj, slack=0.001):
    """(B, B) whether boxes touch or overlap, by separating axes; `slack` is how far apart still counts."""
    axes = rot.to_matrix(obj.box_quat)  # columns are a box's axes
    boxes = len(axes)
    result = np.zeros((boxes, boxes), bool)
    for i in range(boxes):
        for j in range(boxes):
            a, b = axes[i].T, axes[j].T
            crossed = np.cross(a[:, None], b[None]).reshape(9, 3)
            directions = np.concatenate([a, b, crossed[np.linalg.norm(crossed, axis=1) > 1e-6]])
            directions /= np.linalg.norm(directions, axis=1, keepdims=True)
            reach = np.abs(directions @ a.T) @ obj.box_half[i] + np.abs(directions @ b.T) @ obj.box_half[j]
            result[i, j] = (np.abs(directions @ (obj.box_pos[i] - obj.box_pos[j])) <= reach + slack).all()
    return result


def check_stands_in_one_piece(obj: SceneObject) -> None:
    low, high = obj.bounds()
    assert len(obj.box_pos) <= SLOTS
    assert abs(low[2]) < 1e-9, "it stands on the floor"
    np.testing.assert_allclose(low[:2], -high[:2], atol=1e-9)
    linked, reached = touching(obj), np.zeros(len(obj.box_pos), bool)
    reached[0] = True
    for _ in range(len(reached)):
        reached = linked[reached].any(0)
    assert reached.all(), f"boxes {np.flatnonzero(~reached)} of this {obj.kind} hang in the air"


def check_plane(obj: SceneObject, covered: float, drop: float, cushion: float = 0.0, near_head: float = 0.0) -> None:
    """The plane is level, solid and free.

    Args:
        obj: the object.
        covered: share of the plane that must be exactly at the seat's height.
        drop: how far below the rest of it may be [m].
        cushion: how high pillows may rise above it [m].
        near_head: within what distance of the head, along the object's longer free side, there may be pillows [m].
    """
    low, high = obj.bounds()
    polygon, height = obj.seat_polygon, obj.require_seat()
    assert (polygon >= low[:2] - 1e-9).all() and (polygon <= high[:2] + 1e-9).all()
    x, y = polygon.T
    assert (np.roll(y, -1) * x - np.roll(x, -1) * y).sum() > 0, "counter-clockwise"
    points = grid(obj)
    assert inside(obj, at_height(points, height - 1e-4)).mean() >= covered, "on the plane's top"
    assert inside(obj, at_height(points, height - drop - 1e-3)).all(), "solid below all of it"
    for above in (0.002, 0.01, 0.02, 0.04, 0.06, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5):
        hit = points[inside(obj, at_height(points, height + above))]
        if above < cushion and len(hit):
            along = int(np.argmax(np.ptp(polygon, axis=0))) if obj.family == "couch" else 0
            hit = hit[np.abs(hit - obj.head_xy)[:, along] > near_head]
        assert not len(hit), f"{obj.kind}: something is {above} m above the plane at {hit[:3]}"


def ball_at_rest(obj: SceneObject, xy: np.ndarray, radius: float = 0.1) -> np.ndarray:
    """Where a ball of 5 kg is two seconds after it was dropped from 5 cm above the plane (3,) [m]."""
    spec = mujoco.MjSpec()
    world = spec.worldbody
    world.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.05])
    for pos, quat, half in zip(obj.box_pos, obj.box_quat, obj.box_half, strict=True):
        world.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, pos=pos, quat=quat, size=half)
    ball = world.add_body(pos=[*xy, obj.require_seat() + radius + 0.05])
    ball.add_freejoint()
    ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0], mass=5.0)
    model = spec.compile()
    data = mujoco.MjData(model)
    while data.time < 2:
        mujoco.mj_step(model, data)
    assert np.linalg.norm(data.qvel[:3]) < 0.02
    return data.qpos[:3].copy()
