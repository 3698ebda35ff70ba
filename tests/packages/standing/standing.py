"""A task of somebody else: walk up to a pillar and stand before it. Its objects, its human clips, and its condition."""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.core.seeds import rng
from mimicbench.objects.family import Family
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body.body import unihsi_body
from mimicbench.references.body.limbs import about_y
from mimicbench.references.body.posing import Trunk, pose
from mimicbench.references.locomotion.gait import Gait
from mimicbench.references.locomotion.route import around_box
from mimicbench.references.locomotion.walking import FPS, draw_start, walk
from mimicbench.references.synthesis.synthesis import Synthesis
from mimicbench.robots.rigs import PELVIS_RIG
from mimicbench.tasks.goal import Field, GoalSpec
from mimicbench.tasks.task import Array, BodyPoints, ObjectInfo, Shortfall, Task

NEAR = 0.6
"""[m] Who stands by the pillar is no farther from it, as seen from above."""
UPRIGHT = 0.75
"""[m] A pelvis of somebody who stands is higher."""


def make_pillar(index: int, seed: int) -> SceneObject:
    """A pillar of one box, 0.9 to 1.3 m high."""
    random = rng(seed, "pillar", index)
    half = np.array([[*random.uniform(0.12, 0.2, 2), random.uniform(0.45, 0.65)]])
    middle = np.array([[0.0, 0.0, half[0, 2]]])
    return SceneObject(
        f"pillar-{seed}-{index:05d}", "pillar", "square", middle, rot.IDENTITY[None], half, np.full((1, 3), 0.6)
    )


def walk_up(clip_id: str, obj: SceneObject, seed: int) -> HumanMotion:
    """One clip: around the pillar to its front, half a meter away, and stand there."""
    random, body, gait = rng(seed, clip_id, obj.id), unihsi_body(), Gait(speed=0.65)
    start_xy, start_yaw = draw_start(random, obj)
    low, high = obj.bounds()
    stop = np.array([high[0] + 0.45, 0.0])
    route = around_box(start_xy, stop, low[:2], high[:2], 0.4)
    way = walk(body, route, start_yaw, stop, np.pi, gait, 1.5)
    upright = np.full(len(way.time), 0.03)
    pelvis = way.pelvis_quat(upright)
    chest = rot.multiply(pelvis, way.chest_turn(0.0 * upright))
    head = rot.multiply(chest, rot.multiply(way.head_turn(0.0 * upright), about_y(0.0 * upright)))
    trunk = Trunk(way.pelvis_pos_w, pelvis, chest, head)
    quat = pose(body, trunk, way.legs(), way.arms(body, 0.8))
    return HumanMotion(
        clip_id,
        "stand-by",
        body.skeleton,
        FPS,
        way.pelvis_pos_w,
        quat,
        obj.id,
        ("left_foot", "right_foot"),
        way.feet.contact,
        {"body_scale": body.size},
    )


def stands_by(body: BodyPoints, obj: ObjectInfo) -> Array:
    """(N,) whether the pelvis is up, and within 0.6 m of the pillar as seen from above."""
    x, y = (abs(body.pelvis_pos_w[:, axis]) - obj.high[:, axis] for axis in (0, 1))
    return (body.pelvis_pos_w[:, 2] >= UPRIGHT) & (x.clip(0.0) ** 2 + y.clip(0.0) ** 2 <= NEAR**2)


FAMILY = Family("pillar", make_pillar)
SYNTHESIS = Synthesis("stand-by", walk_up)
TASK = Task(
    name="stand-by",
    abbreviation="SB",
    title="Stand by a pillar",
    action="standing",
    family="pillar",
    time_limit=12.0,
    hold_time=0.3,
    holds=stands_by,
    shortfalls=(
        Shortfall("pelvis {} too far away", lambda body, obj: obj.beside(body.pelvis_pos_w) - NEAR),
        Shortfall("pelvis {} too low", lambda body, obj: UPRIGHT - body.pelvis_pos_w[:, 2]),
    ),
    goal=GoalSpec(
        fields=(Field("middle", "place", noise=0.03, spread=0.1),), describe=lambda obj: np.zeros(2), window=0.8
    ),
    in_last_frame=False,
    requires_seat=False,
    upright=True,
    max_start_distance=None,
    rig=PELVIS_RIG,
    map_cell=0.04,
)
