"""Planning online: the goal is seen, a person does the task in the robot's mind, the robot does as that person does.

At the start of an episode the goal is looked for, as all policies do. A stand-in that is no more than that goal takes
the object's place; a clip of the task is planned there from where the robot stands (references.synthesis), retargeted,
and followed by the tracker. Nothing is learned but to see and to track. As the robot comes nearer and knows better
where its goal is, the plan goes there with it, slowly enough for feet to follow.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from mimicbench.core import rotations as rot
from mimicbench.core.checkpoint import load_checkpoint, save_checkpoint
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.core.settings import Positive, Seed
from mimicbench.envs.reference import ReferenceBank
from mimicbench.imitate.goals import KnownGoal, known_goal
from mimicbench.imitate.plan import Imagined
from mimicbench.imitate.planner import own_terms
from mimicbench.imitate.policy import BODY
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body.body import Body
from mimicbench.references.locomotion.states import BodyState, FootPoints, RigidState, state_of_points
from mimicbench.references.synthesis.planning import plan_on
from mimicbench.references.synthesis.registry import courses, synthesize
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.registry import DEFAULT_METHOD, METHODS
from mimicbench.robots.description import Robot
from mimicbench.sensors.context import StepContext
from mimicbench.sensors.heightmap import CELLS
from mimicbench.sensors.observations import Observations, chosen_terms
from mimicbench.sim.physics import ObjectState, RobotState
from mimicbench.sim.scene import CONTROL_DT
from mimicbench.tasks.task import BodyPoints, Task
from mimicbench.track.checkpoint import load_tracker
from mimicbench.track.spec import Tracker

RAISED = 0.12
"""[m] What is so high above the floor is in the way."""
LIFTED = 0.01
"""[m] What the plan has moved so far is in the hands."""
REACH = 2.0
"""[m] What is farther from a goal belongs to something else."""


@dataclass(frozen=True)
class OnlineConfig:
    """How to plan."""

    method: str = DEFAULT_METHOD
    """How plans are retargeted."""
    tries: Positive = 4
    """Styles that are tried until a plan fulfils K on the stand-in."""
    pace: float = 0.15
    """How fast a plan moves to where its goal is by now [m/s]; twice that in radians."""
    seed: Seed = 0
    """Of the styles."""


class Planning:
    """What a robot in some place plans with a goal, in the goal's own frame."""

    def __init__(self, robot: Robot, task: Task, config: OnlineConfig) -> None:
        """Raises MimicbenchError where goals of the task have no stand-in."""
        if task.goal.stand_in is None:
            raise MimicbenchError(
                f"{task.name} has nothing that stands in for its object, so nobody can plan on it; learn a planner "
                f"instead (`mimicbench imitate --task {task.name} --imitate.learner planner`)"
            )
        self._robot, self._task, self._config = robot, task, config
        self._stand_in, self._method = task.goal.stand_in, METHODS.get(config.method)

    def plan(
        self, goal: np.ndarray, room: np.ndarray, root: np.ndarray, joint_pos: np.ndarray, number: int
    ) -> RobotMotion | None:
        """The first of some plans that fulfils K on the stand-in; the last one if none does, None if nothing can be
        planned with what was seen.

        Args:
            goal: (G,) in its own frame.
            room: (2, 2) lowest and highest x, y of what rises from the floor around it [m].
            root: (3,) place [m] and heading [rad] of the robot's root there.
            joint_pos: (J,) its joints [rad].
            number: Of the plan, which decides its styles.
        """
        motion = None
        try:
            obj = self._stand_in(goal, room)
            for attempt in range(self._config.tries):
                example = synthesize(self._task.name, self._config.tries * number + attempt, obj, self._config.seed)
                ways = courses(self._task.name, obj, example.style)
                human = plan_on(ways, self._state(root, joint_pos, ways[0].body), f"plan-{number}")
                motion = self._retargeted(human, obj)
                if self._task.fulfilled(motion, obj, self._robot):
                    break
        except MimicbenchError:  # eyes can be so wrong that nobody could sit there
            return None
        return None if motion is None else self._task.trimmed(motion, obj, self._robot)

    def _retargeted(self, human: HumanMotion, obj: SceneObject) -> RobotMotion:
        human = replace(human, object_id=obj.id)
        return self._method.retarget(Clip(human, obj, self._robot), self._method.preset(None))

    def _state(self, root: np.ndarray, joint_pos: np.ndarray, body: Body) -> BodyState:
        """Somebody who stands where the robot stands, with the feet where its feet are."""
        turn = rot.from_yaw(np.array(root[2]))
        links = self._robot.forward_kinematics(np.zeros(3), rot.IDENTITY, joint_pos)
        ankles = BodyPoints.of(self._robot, *(part[None] for part in links)).ankle_pos_w[0]
        feet = rot.rotate(turn, ankles * [1, 1, 0]) + [*root[:2], body.sole]
        still = np.zeros(3)
        upright = RigidState(np.array([*root[:2], body.standing_height]), turn, still, still)
        return state_of_points(
            body, upright, FootPoints(feet, np.zeros((2, 3)), np.tile(turn, (2, 1)), np.ones(2, bool))
        )


class OnlinePolicy:
    """Plans once, at the start; from then on the tracker follows, and the plan goes where the goal is."""

    def __init__(self, robot: Robot, task: Task, tracker: Tracker, goal: KnownGoal, config: OnlineConfig) -> None:
        self._robot, self._task, self._tracker, self._goal, self._config = robot, task, tracker, goal, config
        self._planning, self._own = Planning(robot, task, config), own_terms(tracker.spec, task)
        self._told = tuple(term for term in chosen_terms(tracker.spec.observations, task) if term.privileged)
        self.gains = tracker.spec.gains
        self.observations: tuple[str, ...] = tuple(dict.fromkeys((*BODY, *goal.observations, "elevation", *self._own)))
        self._device, self._begun = "cpu", 0
        self._forget(0)

    def _forget(self, robots: int) -> None:
        self._motions: list[RobotMotion | None] = [None] * robots
        self._place = torch.zeros(robots, 3, device=self._device)
        """(N, 3) where each plan is: x, y [m] and yaw [rad] in the heading frame of the start."""
        self._last_action = torch.zeros(robots, len(self._robot.joints), device=self._device)
        self._bank: ReferenceBank | None = None

    def to(self, device: str) -> None:
        """Move the networks to a device; nothing is remembered."""
        self._device = device
        self._tracker.network.to(device)
        self._goal.to(device)
        self._forget(0)

    def networks(self) -> list[nn.Module]:
        """All that it runs on."""
        return [self._tracker.network, *self._goal.networks()]

    @torch.no_grad()
    def reset(self, ids: Tensor, obs: Observations) -> None:
        """Find out about the goal, and plan."""
        if len(self._motions) != obs.num_envs:
            self._forget(obs.num_envs)
        self._goal.begin(ids, obs)
        spec, place = self._task.goal, self._wanted()
        own = spec.to_root(self._goal.goal, place[:, :2], place[:, 2]).double().cpu().numpy()
        rooms = rooms_of(obs.of("elevation", ids), obs["proprio"][ids, 3], place[ids], self._task.map_cell)
        here = seen_from(reckoned(obs["proprio"], obs["odometry"]), place)
        stands = torch.cat([here.root_pos_w[:, :2], rot.yaw_of(here.root_quat_w)[:, None]], -1).double().cpu().numpy()
        joint_pos = here.joint_pos.double().cpu().numpy()
        for room, i in zip(rooms, ids.tolist(), strict=True):
            planned = self._planning.plan(own[i], room, stands[i], joint_pos[i], self._begun)
            self._motions[i] = planned or standing(self._robot, self._task, here, i)
            self._begun += 1
        known = next(motion for motion in self._motions if motion is not None)
        self._bank = ReferenceBank([motion or known for motion in self._motions], self._robot, self._device)
        self._place = self._place.index_copy(0, ids, place[ids])
        self._last_action = self._last_action.index_fill(0, ids, 0.0)

    @torch.no_grad()
    def act(self, obs: Observations) -> Tensor:
        """Joint position targets (N, J) [rad]."""
        bank, robots = self._bank, torch.arange(obs.num_envs, device=self._device)
        assert bank is not None, "reset it first"
        self._goal.recall(obs)
        self._go_along()
        index = (obs["time"][:, 0] / CONTROL_DT).round().long()
        state = seen_from(reckoned(obs["proprio"], obs["odometry"]), self._place)
        context = Imagined.of(self._robot, self._task, state, lambda ahead: bank.frame(robots, index + ahead))
        if self._task.moves_object:
            context = context.beside(in_hands(context))
        told = {term.name: term.compute(context) for term in self._told}
        terms = {**{name: obs[name] for name in self._own}, "last_action": self._last_action, **told}
        self._last_action = self._tracker.action(terms)
        return self._tracker.target(self._robot, terms, self._last_action)

    def _wanted(self) -> Tensor:
        """(N, 3) x, y [m] and yaw [rad] of the goals as they are known."""
        spec, goal = self._task.goal, self._goal.goal
        sine, cosine = goal[:, spec.front].unbind(-1)
        return torch.cat([goal[:, spec.where], torch.atan2(sine, cosine)[:, None]], -1)

    def _go_along(self) -> None:
        """Plans move to where their goals are known to be by now."""
        away, most = self._wanted() - self._place, self._config.pace * CONTROL_DT
        away[:, 2] = rot.wrap_angle(away[:, 2])
        far = away[:, :2].norm(dim=-1, keepdim=True).clamp(min=1e-9)
        step = away[:, :2] * (most / far).clamp(max=1.0)
        self._place = self._place + torch.cat([step, away[:, 2:].clamp(-2 * most, 2 * most)], -1)


def standing(robot: Robot, task: Task, state: RobotState, row: int) -> RobotMotion:
    """A robot that stays as it is."""
    pose = (np.repeat(part[row : row + 1].double().cpu().numpy(), 2, 0) for part in _pose(state))
    return RobotMotion("standing", task.name, robot.name, robot.joint_names, 1 / CONTROL_DT, *pose, "stand-in", "")


def _pose(state: RobotState) -> tuple[Tensor, Tensor, Tensor]:
    return state.root_pos_w, state.root_quat_w, state.joint_pos


def reckoned(proprio: Tensor, odometry: Tensor) -> RobotState:
    """Robots in the heading frames of their starts, by what they measure of themselves (N, 10 + 2 J) and odometry
    (N, 3).
    """
    joints = (proprio.shape[1] - 10) // 2
    gravity, height, lin_vel, ang_vel, joint_pos, joint_vel = proprio.split([3, 1, 3, 3, joints, joints], -1)
    zero = torch.zeros_like(height[:, 0])
    pitch, roll = torch.asin(gravity[:, 0].clamp(-1, 1)), torch.atan2(-gravity[:, 1], -gravity[:, 2])
    about_x = rot.from_rotvec(torch.stack([roll, zero, zero], -1))
    about_y = rot.from_rotvec(torch.stack([zero, pitch, zero], -1))
    quat = rot.multiply(rot.from_yaw(odometry[:, 2]), rot.multiply(about_y, about_x))
    pos = torch.cat([odometry[:, :2], height], -1)
    return RobotState(pos, quat, rot.rotate(quat, lin_vel), ang_vel, joint_pos, joint_vel)


def seen_from(state: RobotState, place: Tensor) -> RobotState:
    """The same robots in frames that stand at places (N, 3), x, y [m] and yaw [rad]."""
    back = rot.from_yaw(-place[:, 2])
    return replace(
        state,
        root_pos_w=rot.rotate(back, state.root_pos_w - _flat(place)),
        root_quat_w=rot.multiply(back, state.root_quat_w),
        root_lin_vel_w=rot.rotate(back, state.root_lin_vel_w),
    )


def in_hands(context: StepContext) -> ObjectState:
    """Where objects are that the plan moves: where they stand, and once lifted wherever the hands are as the plan has
    it.
    """
    planned, robot = context.reference(0), context.robot
    wrists = BodyPoints.of(robot, context.links.pos_w, context.links.quat_w).wrist_pos_w
    (left, right), (to_left, to_right) = wrists.unbind(1), planned.wrist_pos_w.unbind(1)
    yaw, to_yaw = (torch.atan2(away[:, 1], away[:, 0]) for away in (left - right, to_left - to_right))
    turn, obj = rot.from_yaw(rot.wrap_angle(yaw - to_yaw)), planned.object
    middle, to_middle = (left + right) / 2, (to_left + to_right) / 2
    carried = ObjectState(
        middle + rot.rotate(turn, obj.pos_w - to_middle),
        rot.multiply(turn, obj.quat_w),
        rot.rotate(turn, obj.lin_vel_w),
        obj.ang_vel_b,
    )
    lifted = (obj.pos_w.norm(dim=-1) > LIFTED)[:, None]
    pairs = zip(vars(carried).values(), vars(obj).values(), strict=True)
    return ObjectState(*(torch.where(lifted, hand, floor) for hand, floor in pairs))


def rooms_of(elevation: Tensor, root_height: Tensor, place: Tensor, cell: float) -> np.ndarray:
    """(M, 2, 2) lowest and highest x, y [m] of what rises from the floor near places (M, 3), in the frames of these.

    Args:
        elevation: (M, 128, 128) heights relative to the roots [m].
        root_height: (M,) of these above the floor [m].
        place: x, y [m] and yaw [rad] in the frames of the maps.
        cell: Side of a cell [m].
    """
    line = (torch.arange(CELLS, device=place.device) - (CELLS - 1) / 2) * cell
    x, y = (part - place[:, i, None, None] for i, part in enumerate((line[:, None], line[None, :])))
    cos, sin = (part[:, None, None] for part in (place[:, 2].cos(), place[:, 2].sin()))
    own = torch.stack(torch.broadcast_tensors(cos * x + sin * y, cos * y - sin * x), -1)
    taken = (elevation + root_height[:, None, None] > RAISED) & (own.norm(dim=-1) < REACH)
    low = torch.where(taken[..., None], own, torch.inf).amin((1, 2)).clamp(max=0.0)
    high = torch.where(taken[..., None], own, -torch.inf).amax((1, 2)).clamp(min=0.0)
    return torch.stack([low, high], 1).double().cpu().numpy()


def _flat(place: Tensor) -> Tensor:
    """(N, 3) on the floor."""
    return torch.cat([place[:, :2], torch.zeros_like(place[:, :1])], -1)


def save_online(folder: Path, robot: Robot, config: OnlineConfig, notes: Mapping[str, object]) -> None:
    """Write how to plan; tracker and perception are in folders beside it."""
    save_checkpoint(folder, "online", robot.name, config, {}, notes)


def load_online(folder: Path, robot: Robot, task: Task) -> OnlinePolicy:
    """Read one with the `tracker` and the `perception` in the folders beside it. Raises BadCheckpoint."""
    config = load_checkpoint(folder, "online", robot.name).config_as(OnlineConfig)
    tracker = load_tracker(folder.parent / "tracker", robot)
    return OnlinePolicy(robot, task, tracker, known_goal(folder.parent / "perception", robot, task), config)
