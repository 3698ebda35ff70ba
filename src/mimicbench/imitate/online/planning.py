"""What a robot plans with a goal: a person does the task on a stand-in, and the robot as that person."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion, BadObject, MimicbenchError
from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.core.seeds import digest
from mimicbench.imitate.learners.online import OnlineConfig
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body.body import Body
from mimicbench.references.locomotion.states import (
    BodyState,
    FootPoints,
    RigidState,
    state_of_motion,
    state_of_points,
)
from mimicbench.references.synthesis.planning import plan_on
from mimicbench.references.synthesis.registry import courses, synthesize
from mimicbench.retarget.acceptance import unsolved
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.registry import METHODS
from mimicbench.robots.description import Robot
from mimicbench.sim.physics import RobotState
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.task import BodyPoints, Task

WALKS = 0.1
"""[m/s] Who is slower stands."""
RAISED, STEPS = 0.015, 0.3
"""[m], [m/s] A foot that is this much higher than the other, or faster, is in the air."""
_KEPT = 2
"""What a plan is worth that is kept."""

Begin = Callable[[Body], BodyState]
"""Where a plan begins: what a body does there."""


@dataclass(frozen=True)
class Planned:
    """What a robot is going to do."""

    human: HumanMotion
    """Of the person in its mind, in the goal's frame."""
    motion: RobotMotion
    """Of the robot as that person."""
    stand_in: SceneObject
    """Beside which it is planned."""


class Planning:
    """What a robot in some place plans with a goal, in the goal's own frame."""

    def __init__(self, robot: Robot, task: Task, config: OnlineConfig) -> None:
        """Raises MimicbenchError where goals of the task have no stand-in."""
        if task.goal.stand_ins is None:
            raise MimicbenchError(
                f"{task.name} has nothing that stands in for its object, so nobody can plan on it; learn a planner "
                f"instead (`mimicbench imitate --task {task.name} --imitate.learner planner`)"
            )
        self._robot, self._task, self._config = robot, task, config
        self._stand_ins, self._method = task.goal.stand_ins, METHODS.get(config.method)

    def plans(self, goal: np.ndarray, around: np.ndarray, begin: Begin, number: int) -> list[Planned]:
        """The first of some plans that is kept as a clip for learning would be, or as many as are to be rehearsed; if
        none is, the first that fulfils K on the stand-in, or else the first. None if nothing can be planned with what
        was seen.

        Args:
            goal: (G,) in its own frame.
            around: (M, 3) what rises from the floor there: x, y and height above the floor [m].
            begin: Where the plan begins, there.
            number: Of the plan, which decides its styles.
        """
        try:
            stand_ins = self._stand_ins(goal, around)
        except BadObject:  # eyes can be so wrong that nothing could look like that
            return []
        for obj in stand_ins:
            try:
                return self._plans(obj, begin, number)
            except (BadObject, BadMotion):  # or that nobody could do it there
                continue
        return []

    def _plans(self, obj: SceneObject, begin: Begin, number: int) -> list[Planned]:
        """Those on one stand-in: kept are plans in which K holds, and the robot rests where the person does. Raises
        BadObject or BadMotion.
        """
        found: list[tuple[int, Planned]] = []
        for attempt in range(self._config.tries * number, self._config.tries * (number + 1)):
            example = synthesize(self._task.name, attempt, obj, self._config.seed)
            wrists = example.wrist_goal_w if len(example.wrist_goal_w) else None
            ways = courses(self._task.name, obj, example.style, wrists)
            human = plan_on(ways, begin(ways[0].body), f"plan-{number}")
            motion = self._retargeted(human, obj)
            worth = 0
            if self._task.fulfilled(motion, obj, self._robot):
                worth = 1 if unsolved(motion.measures, self._method.limits) else _KEPT
            found.append((worth, Planned(human, self._task.trimmed(motion, obj, self._robot), obj)))
            if sum(each == _KEPT for each, _ in found) == max(1, self._config.rehearsals):
                break
        best = max(worth for worth, _ in found)
        some = [plan for worth, plan in found if worth == best]
        return some if best == _KEPT else some[:1]

    def _retargeted(self, human: HumanMotion, obj: SceneObject) -> RobotMotion:
        human = replace(human, object_id=obj.id)
        return self._method.retarget(Clip(human, obj, self._robot), self._method.preset(None))


def numbers_of(goal: Tensor, joint_pos: Tensor) -> list[int]:
    """What decides the styles of N robots' plans: how their goals (N, G) are known, and how they stand, with joints
    (N, J) [rad], as they begin; to a tenth, so that last bits decide nothing.

    So an episode comes out alike whatever came before it, and whoever is beside it.
    """
    rounded = (torch.cat([goal, joint_pos], -1).nan_to_num() * 10.0).round().long().tolist()
    return [digest(0, "styles", *row) % (1 << 32) for row in rounded]


def from_standing(robot: Robot, root: np.ndarray, joint_pos: np.ndarray) -> Begin:
    """Where a robot stands, with its root at (3,) x, y [m] and heading [rad] and its joints at (J,) [rad]: somebody who
    stands there, with the feet where its feet are.
    """

    def begin(body: Body) -> BodyState:
        turn = rot.from_yaw(np.array(root[2]))
        links = robot.forward_kinematics(np.zeros(3), rot.IDENTITY, joint_pos)
        ankles = BodyPoints.of(robot, *(part[None] for part in links)).ankle_pos_w[0]
        feet = rot.rotate(turn, ankles * [1, 1, 0]) + [*root[:2], body.sole]
        still = np.zeros(3)
        upright = RigidState(np.array([*root[:2], body.standing_height]), turn, still, still)
        points = FootPoints(feet, np.zeros((2, 3)), np.tile(turn, (2, 1)), np.ones(2, bool))
        return state_of_points(body, upright, points)

    return begin


def from_walking(robot: Robot, state: RobotState, row: int) -> Begin:
    """Where a robot is in motion: somebody upright there whose pelvis and feet move as its root and feet do, with the
    foot in the air that it has in the air.

    Args:
        robot: Which.
        state: Of N robots, in the frame of the plan.
        row: Which of them.
    """
    parts = (state.root_pos_w, state.root_quat_w, state.joint_pos)
    rates = (state.root_lin_vel_w, state.root_ang_vel_b, state.joint_vel)
    pos, quat, joint_pos = (part[row].double().cpu().numpy() for part in parts)
    lin_vel, ang_vel, joint_vel = (rate[row].double().cpu().numpy() for rate in rates)
    # half a control step before and after: what the feet do meanwhile is how fast they move
    ticks = np.array([[-0.5], [0.0], [0.5]]) * CONTROL_DT
    turned = rot.multiply(quat, rot.from_rotvec(ticks * ang_vel))
    links = robot.forward_kinematics(pos + ticks * lin_vel, turned, joint_pos + ticks * joint_vel)
    before, ankles, after = BodyPoints.of(robot, *links).ankle_pos_w
    velocity = (after - before) / CONTROL_DT
    height = ankles[:, 2] - ankles[:, 2].min()
    bears = (height == 0.0) | (height < RAISED) & (np.linalg.norm(velocity, axis=-1) < STEPS)
    heading = rot.from_yaw(rot.yaw_of(quat))

    def begin(body: Body) -> BodyState:
        feet = np.column_stack([ankles[:, :2], body.sole + np.where(bears, 0.0, height)])
        place = np.append(pos[:2], body.standing_height)
        upright = RigidState(place, heading, lin_vel * [1, 1, 0], ang_vel * [0, 0, 1])
        return state_of_points(body, upright, FootPoints(feet, velocity, np.tile(heading, (2, 1)), bears))

    return begin


def from_plan(before: Planned, seconds: float, moved: np.ndarray) -> Begin:
    """What the person in mind does so many seconds after a plan began, for a plan in another frame.

    Args:
        before: The plan that is followed until now.
        seconds: Since its begin.
        moved: (3,) x, y [m] and yaw [rad] of its frame in that of the new plan.
    """
    frame = min(round(seconds * before.human.fps), before.human.frames - 2)
    state = state_of_motion(before.human, frame)
    place = rot.rotate(rot.from_yaw(np.array(moved[2])), np.append(state.place, 0.0))[:2] + moved[:2]
    there = state.moved(place, state.yaw + float(moved[2]))
    return lambda _: there


def standing(robot: Robot, task: Task, state: RobotState, row: int) -> RobotMotion:
    """A robot that stays as it is."""
    pose = state.root_pos_w, state.root_quat_w, state.joint_pos
    pos, quat, joints = (np.repeat(part[row : row + 1].double().cpu().numpy(), 2, 0) for part in pose)
    fps = 1 / CONTROL_DT
    return RobotMotion("standing", task.name, robot.name, robot.joint_names, fps, pos, quat, joints, "stand-in", "")
