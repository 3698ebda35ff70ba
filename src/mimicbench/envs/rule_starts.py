"""How episodes of an environment start (appendix C.1): each from its seed, in the first pose of a clip, or by a rule.

By the rule the robot stands at rest: around the object for the tasks that navigate, in front of it and facing it for
the others.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion, BadObject, MimicbenchError, UnknownName
from mimicbench.core.motion import RobotMotion
from mimicbench.core.names import typed
from mimicbench.core.seeds import rng
from mimicbench.core.stage import HEADER, read_stage
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.initial_states import InitialState, start_of
from mimicbench.objects.make import read_objects
from mimicbench.objects.registry import FAMILIES, make_object
from mimicbench.objects.shape import SceneObject, split_of
from mimicbench.objects.touch import stance_before, touch_pair
from mimicbench.references.locomotion.walking import draw_start as draw_place
from mimicbench.retarget.make import read_retargeted
from mimicbench.robots.description import Robot
from mimicbench.sensors.heightmap import CELLS
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.task import Task

SPLITS = ("train", "test", "all")
CLEARANCE = 0.005
"""[m] between the soles and the floor, so that no start begins inside of it."""
BACK_TO_TOUCH, BACK_TO_LIFT = 0.1, 0.3
"""[m] how far behind where it could begin at once a robot in front of an object may stand. Whoever touches has the
targets on its map of 1.28 m."""
SIDE, TURN = 0.1, 0.2
"""How far it may stand to either side [m], and be turned [rad]."""
STANDS = 0.6
"""Share of a task's time for which a clip of somebody who only stands goes on."""
_TRIES = 50
"""Draws of a start with both targets on the map; nine in ten pairs can be, of every object."""


@dataclass(frozen=True)
class Stance:
    """A robot at rest, with its soles just above the floor."""

    joint_pos: np.ndarray
    """(J,) its rest pose, or another in which it stands [rad]."""
    height: float
    """Of the root [m]."""
    ankles_r: np.ndarray
    """(3,) the middle of its ankles in the root frame [m]."""

    @staticmethod
    def of(robot: Robot, joint_pos: np.ndarray | None = None) -> "Stance":
        """The stance of a robot in its rest pose, or with joints (J,) [rad]."""
        joints = np.array(robot.rest_pose if joint_pos is None else joint_pos, float)
        links = robot.forward_kinematics(np.zeros(3), rot.IDENTITY, joints)
        soles, ankles = (
            np.array([robot.keypoint_pos(f"{side}_{name}", *links) for side in ("left", "right")])
            for name in ("sole", "ankle")
        )
        return Stance(joints, CLEARANCE - float(soles[:, 2].min()), ankles.mean(0))


def draw_start(task: Task, obj: SceneObject, stance: Stance, random: np.random.Generator) -> InitialState:
    """A start without a reference: at rest.

    Tasks that navigate: the ankles anywhere 1 to 2 m from the origin, within 100 degrees of the front and 0.45 m clear
    of the object, any heading, as the clips of sit-chair start. The others: in front of the object, facing it, up to
    0.3 m (touch-points: 0.1 m) behind where it could begin, 0.1 m to the side and turned by 0.2 rad. Targets and places
    are drawn again until both targets are on the robot's map, which is to tell it of them.
    """
    goal, root, quat = _stand(task, obj, stance, random)
    for _ in range(_TRIES):
        if (np.abs(rot.rotate_inverse(quat, goal - root)[:, :2]) < CELLS / 2 * task.map_cell).all():
            break
        goal, root, quat = _stand(task, obj, stance, random)
    still = np.zeros(3)
    return InitialState(obj, root, quat, stance.joint_pos, still, still, np.zeros(len(stance.joint_pos)), goal)


def _stand(
    task: Task, obj: SceneObject, stance: Stance, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Targets (2, 3) or none, and position (3,) [m] and orientation (4,) of the root."""
    goal = np.stack(touch_pair(obj, random)) if task.wrist_goals else np.zeros((0, 3))
    if task.max_start_distance is not None:
        xy, yaw = _around(obj, task.max_start_distance, random)
    else:
        before = goal if len(goal) else np.zeros((2, 3))  # two hands at the object's middle, where there are no targets
        *xy, yaw = stance_before(obj, *before) + random.uniform(
            [0.0, -SIDE, -TURN], [BACK_TO_TOUCH if len(goal) else BACK_TO_LIFT, SIDE, TURN]
        )
    quat = rot.from_yaw(np.array(yaw))
    return goal, np.array([*(xy - rot.rotate(quat, stance.ankles_r)[:2]), stance.height]), quat


def _around(obj: SceneObject, limit: float, random: np.random.Generator) -> tuple[np.ndarray, float]:
    """A place (2,) [m] and heading [rad] by the rule of sit-chair's clips, within `limit` [m] of the origin."""
    for _ in range(100):
        xy, yaw = draw_place(random, obj)
        if np.linalg.norm(xy) <= limit:
            return xy, yaw
    raise BadObject(f"object {obj.id} leaves no room to stand within {limit:g} m of its middle; scale it down")


def standing(
    task: Task,
    robot: Robot,
    objects: Mapping[str, SceneObject],
    count: int,
    seed: int,
    poses: Sequence[np.ndarray] = (),
) -> ClipSet:
    """`count` clips for whoever begins where clips do and follows none: robots that stand where `draw_start` puts them,
    beside objects drawn from these, for STANDS of the task's time; at rest, or with joints drawn from `poses` (J,).
    """
    stances = [Stance.of(robot, pose) for pose in poses] or [Stance.of(robot)]
    ids, motions = sorted(objects), []
    frames = round(STANDS * task.time_limit / CONTROL_DT)
    for number in range(count):
        random = rng(seed, "start of a demonstration", task.name, number)
        obj = objects[ids[int(random.integers(len(ids)))]]
        stance = stances[int(random.integers(len(stances)))] if poses else stances[0]
        start = draw_start(task, obj, stance, random)
        pos, quat, joints = (
            np.broadcast_to(values, (frames, len(values)))
            for values in (start.root_pos_w, start.root_quat_w, start.joint_pos)
        )
        name = f"start-{seed}-{number:06d}"
        what = (name, task.name, robot.name, robot.joint_names, 1 / CONTROL_DT)
        goal = start.wrist_goal_w
        motions.append(RobotMotion(*what, pos, quat, joints, start.obj.id, name, wrist_goal_w=goal))
    return ClipSet(task, robot, motions, objects)


class Starts:
    """Where the episodes of a task start. An episode's seed alone decides its object and its start."""

    def __init__(
        self,
        task: Task,
        robot: Robot,
        split: str,
        objects: Sequence[str | SceneObject] | None,
        pool: int,
        motions: Sequence[RobotMotion] | Path | str | None,
    ) -> None:
        """See episodes.GymConfig for `split`, `objects`, `pool`, and `motions`, which is its `starts`."""
        if split not in SPLITS:
            raise UnknownName("split", split, list(SPLITS))
        self.task, self.robot, self._stance = task, robot, Stance.of(robot)
        own = _by_id([obj for obj in objects or () if isinstance(obj, SceneObject)])
        if isinstance(motions, Path | str):
            own, motions = _read_workdir(Path(motions), task, robot, own)
        self._own: Mapping[str, SceneObject] = own
        self._motions = None if motions is None else list(motions)
        self._ids: Sequence[str] = [obj if isinstance(obj, str) else obj.id for obj in objects or ()]
        if objects is None and motions is None:
            FAMILIES.get(task.family)  # now rather than in the middle of an episode
            every = (f"{task.family}-0-{index:05d}" for index in range(pool))
            self._ids = [object_id for object_id in every if split in ("all", split_of(object_id))]
        self._places = range(len(self._ids))
        if self._motions is not None:
            beside = [split_of(motion.object_id) for motion in self._motions]
            self._places = [place for place, part in enumerate(beside) if split in ("all", part)]
        if self._motions is not None and not self._places:
            raise BadMotion(
                f"none of the motions to start from is beside an object of split {split!r}; make "
                "more, or choose another split"
            )
        if self._motions is None and not self._ids:
            raise BadObject(
                f"there is no object of split {split!r} to start beside; give a larger pool, other "
                "objects or another split"
            )

    @property
    def has_hulls(self) -> bool:
        """Whether any object that it may draw has convex pieces; those made from their ids are of boxes."""
        return any(obj.hulls for obj in self._own.values())

    def draw(self, seed: int, number: int | None = None) -> tuple[InitialState, int]:
        """The start of the episode `seed`, and its number: the place of its motion among all, or of its object.

        With `number`, that motion or object. Raises MimicbenchError if there is none, or if it is of another split.
        """
        random, count = rng(seed, "episode", self.task.name), len(self._ids if self._motions is None else self._motions)
        drawn = self._places[int(random.integers(len(self)))]
        if number is not None and not (isinstance(number, int | np.integer) and 0 <= number < count):
            raise MimicbenchError(f"there is no start {number!r}; give a whole number from 0 to {count - 1}")
        chosen = drawn if number is None else int(number)
        if chosen not in self._places:
            few = ", ".join(map(str, self._places[:9]))
            raise MimicbenchError(f"start {chosen} is beside an object of another split; give another, such as {few}")
        if self._motions is not None:
            motion = self._motions[chosen]
            return start_of(motion, self._object(motion.object_id), self.robot, self.task), chosen
        return draw_start(self.task, self._object(self._ids[chosen]), self._stance, random), chosen

    def __len__(self) -> int:
        """How many motions, or else objects, there are to start from."""
        return len(self._places)

    def _object(self, object_id: str) -> SceneObject:
        obj = self._own.get(object_id) or _made(object_id)
        if self.task.requires_seat:
            obj.require_seat()
        if self.task.moves_object and not obj.movable:
            raise BadObject(f"object {obj.id} is fixed, and {self.task.name} moves its own; give one that is movable")
        return obj


def _by_id(objects: Sequence[SceneObject]) -> dict[str, SceneObject]:
    """The objects by their ids. Raises BadObject if two that differ have one id."""
    found: dict[str, SceneObject] = {}
    for obj in objects:
        if found.setdefault(obj.id, obj) is not obj and found[obj.id].to_dict() != obj.to_dict():
            raise BadObject(f"two objects are called {obj.id}; give each an id of its own")
    return found


@lru_cache(maxsize=4096)
def _made(object_id: str) -> SceneObject:
    return make_object(object_id)


def _read_workdir(
    workdir: Path, task: Task, robot: Robot, own: Mapping[str, SceneObject]
) -> tuple[Mapping[str, SceneObject], Sequence[RobotMotion]]:
    """The objects and the retargeted clips that fulfil K, of a stage `retarget`, or of the only one of a folder."""
    inside = sorted(workdir.glob(f"{task.name}/retarget/*/{HEADER}"))
    headers = [workdir / HEADER] if (workdir / HEADER).exists() else inside
    if len(headers) > 1:
        several = ", ".join(str(header.parent) for header in headers)
        raise BadMotion(f"{workdir} holds several stages of clips; give one of {several}")
    motions = read_retargeted(headers[0].parent, robot.name) if headers else []
    if not motions:
        raise BadMotion(
            f"{workdir} holds no retargeted clips; run `mimicbench retarget --task {task.name} "
            f"--workdir {typed(workdir)}` first"
        )
    stage = read_stage(headers[0].parent)
    return {**read_objects(stage.folder.resolve().parents[1] / stage.header["reads"]["objects"]), **own}, motions
