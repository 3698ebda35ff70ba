"""What a planner tells a tracker, as a vector that can be learned: the tracker's own terms, or poses of which these
follow.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, cast

import torch
from torch import Tensor

from mimicbench.core import rotations as rot
from mimicbench.core.errors import MimicbenchError
from mimicbench.robots.description import Robot
from mimicbench.sensors.context import Frame, StepContext
from mimicbench.sensors.observations import chosen_terms
from mimicbench.sensors.reference import object_in_root, reference_links
from mimicbench.sim.physics import LinkState, ObjectState, RobotState
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.task import Task
from mimicbench.track.spec import Terms, TrackerSpec


class PlanLayout:
    """The privileged terms of a tracker at a task, one after the other.

    Rotation vectors are told as two columns of a matrix: half a turn to the left is half a turn to the right, and what
    lies between the two as numbers is no turn at all.
    """

    def __init__(self, spec: TrackerSpec, robot: Robot, task: Task) -> None:
        self.terms = tuple(term for term in chosen_terms(spec.observations, task) if term.privileged)
        self._widths = [torch.Size(term.shape(robot, task)).numel() for term in self.terms]
        self.widths = {t.name: width + 3 * len(t.turns) for t, width in zip(self.terms, self._widths, strict=True)}
        """Numbers of the plan for each term, in order."""
        self.size = sum(self.widths.values())
        """P."""

    def flat(self, terms: Terms) -> Tensor:
        """(N, P) of terms that hold at least these."""
        parts = []
        for term in self.terms:
            values, end = terms[term.name].flatten(1), 0
            for at in term.turns:
                turn = rot.to_6d(rot.from_rotvec(values[:, at : at + 3]))
                parts += [values[:, end:at], turn]
                end = at + 3
            parts.append(values[:, end:])
        return torch.cat(parts, -1)

    def split(self, plan: Tensor) -> dict[str, Tensor]:
        """The terms (N, ...) of plans (N, P), by name. No gradient passes through their turns."""
        found = {}
        for term, values in zip(self.terms, plan.split(list(self.widths.values()), -1), strict=True):
            parts, end = [], 0
            for number, at in enumerate(term.turns):
                first = at + 3 * number
                turn = rot.to_rotvec(rot.from_6d(values[:, first : first + 6].detach()))
                parts += [values[:, end:first], turn]
                end = first + 6
            found[term.name] = torch.cat([*parts, values[:, end:]], -1) if parts else values
        return found


class PosePlan:
    """The poses of the two frames after each frame of a chunk, as seen from where the robot is now (G.2).

    P numbers for each frame of the chunk: J, dJ, the root's position and its orientation (6D), 47 of the H1, and how
    fast these change until the second frame [1/s], which is what the second pose comes to; where wrists are given
    targets, these (6); where an object is moved, its state then and in the frame after it, each of position,
    orientation (6D), linear and angular velocity (15). All but J and dJ are in the root frame of the frame in which the
    plan is made. Velocities of the root follow from the difference of its two poses, those of all links
    from forward kinematics.

    The second pose itself would say nothing of velocities: its errors of 7 mm are 0.35 m/s in the difference over
    0.02 s, and people walk at less.
    """

    def __init__(self, robot: Robot, task: Task) -> None:
        self.robot, self.task = robot, task
        self._pose = 2 * len(robot.joints) + 9
        told, moved = 6 if task.wrist_goals else 0, 15 if task.moves_object else 0
        self._widths = [self._pose, self._pose, told, moved, moved]
        self.size = sum(self._widths)
        """P."""

    def flat(self, root: RobotState, now: ObjectState, two: Frame) -> Tensor:
        """(M, P) of M frames of chunks.

        Args:
            root: (M,) where the robots are when the plan is made; only position and orientation of the root count.
            now: (M,) the objects in the frames of the chunk.
            two: (2 M,) the references one frame after these, and then those two frames after them.
        """
        count = len(root.root_pos_w)
        quat = root.root_quat_w.repeat(2, 1)
        pos = rot.rotate_inverse(quat, two.root_pos_w - root.root_pos_w.repeat(2, 1))
        turn = rot.to_6d(rot.multiply(rot.conjugate(quat), two.root_quat_w))
        poses = torch.cat([two.joint_pos, two.joint_vel, pos, turn], -1)
        parts = [poses[:count], (poses[count:] - poses[:count]) / CONTROL_DT]
        if self.task.wrist_goals:
            # a hand that has nothing to do is where the reference has it
            goal = torch.where(two.wrist_goal_w.isnan(), two.wrist_pos_w, two.wrist_goal_w)[:count]
            away = goal - root.root_pos_w[:, None]
            parts.append(rot.rotate_inverse(root.root_quat_w[:, None].expand(-1, 2, -1), away).flatten(1))
        if self.task.moves_object:
            then = ObjectState(*(part[:count] for part in _fields(two.object)))
            for state in (now, then):
                seen = object_in_root(root, state)
                parts.append(torch.cat([seen[:, :3], rot.to_6d(rot.from_rotvec(seen[:, 3:6])), seen[:, 6:]], -1))
        return torch.cat(parts, -1)

    def terms(self, spec: TrackerSpec, chunk: Tensor, proprio: Tensor) -> dict[str, Tensor]:
        """What a tracker has to be told of plans (N, K, P): its privileged terms, and the wrists' targets.

        Args:
            spec: The tracker.
            chunk: (N, K, P); a tracker that looks n frames ahead needs K >= n.
            proprio: (N, 10 + 2 J) what the robots measure of themselves.

        Raises:
            MimicbenchError: The tracker looks farther ahead than the plans go.
        """
        first = chunk[:, 0].split(self._widths, -1)
        context = Imagined.in_root(self.robot, self.task, proprio, lambda ahead: self._frame(chunk, ahead))
        if self.task.moves_object:
            context = context.beside(_object(first[3]))
        wanted = (term for term in chosen_terms(spec.observations, self.task) if term.privileged)
        found = {term.name: term.compute(context) for term in wanted}
        return {**found, "targets": first[2].unflatten(-1, (2, 3))} if self.task.wrist_goals else found

    def _frame(self, chunk: Tensor, ahead: int) -> Frame:
        """The planned frame `ahead` frames from now, in the robot's root frame as if that were the world's."""
        if ahead > chunk.shape[1]:
            raise MimicbenchError(
                f"this tracker looks {ahead} frames ahead, but the plans end after {chunk.shape[1]}; learn with a "
                "longer chunk (--imitate.network.chunk)"
            )
        first, change, _, _, moved = chunk[:, ahead - 1].split(self._widths, -1)
        second = first + CONTROL_DT * change
        joints = len(self.robot.joints)
        joint_pos, joint_vel, pos, turn = first.split([joints, joints, 3, 6], -1)
        quat, later = rot.from_6d(turn), rot.from_6d(second[:, -6:])
        lin_vel = (second[:, -9:-6] - pos) / CONTROL_DT
        ang_vel = rot.to_rotvec(rot.multiply(later, rot.conjugate(quat))) / CONTROL_DT
        nowhere = pos.new_full((len(pos), 2, 3), torch.nan)
        obj = _object(moved) if self.task.moves_object else ObjectState.at_origin(len(pos), pos.device)
        return Frame(pos, quat, lin_vel, ang_vel, joint_pos, joint_vel, obj, nowhere, nowhere, nowhere)


@dataclass(frozen=True)
class Imagined(StepContext):
    """Robots wherever their own reckoning has them, before references that are planned.

    There is no physics: only terms that follow from the robots' poses, their references and the object can be worked
    out.
    """

    planned_object: ObjectState | None = None

    @staticmethod
    def of(robot: Robot, task: Task, state: RobotState, reference: Callable[[int], Frame]) -> "Imagined":
        """Of robots (N,) in the frame that their references are in."""
        joint_pos, unused = state.joint_pos, cast("Any", None)
        none, zero = joint_pos[:, :0], joint_pos[:, 0]
        goal = joint_pos.new_full((len(joint_pos), 2, 3), torch.nan)
        return Imagined(robot, task, unused, state, zero, none, zero, none, none, goal, reference, unused)

    @staticmethod
    def in_root(robot: Robot, task: Task, proprio: Tensor, reference: Callable[[int], Frame]) -> "Imagined":
        """In their own root frames, as if these were the world's, of what they measure of themselves (N, 10 + 2 J)."""
        joints = len(robot.joints)
        _, _, lin_vel, ang_vel, joint_pos, joint_vel = proprio.split([3, 1, 3, 3, joints, joints], -1)
        at = ObjectState.at_origin(len(proprio), proprio.device)
        state = RobotState(at.pos_w, at.quat_w, lin_vel, ang_vel, joint_pos, joint_vel)
        return Imagined.of(robot, task, state, reference)

    def beside(self, obj: ObjectState) -> "Imagined":
        """The same beside an object."""
        return replace(self, planned_object=obj)

    @cached_property
    def links(self) -> LinkState:
        """By forward kinematics."""
        state, at = self.state, ObjectState.at_origin(self.num_envs, self.device)
        spin_w = rot.rotate(state.root_quat_w, state.root_ang_vel_b)
        pose = (state.root_pos_w, state.root_quat_w, state.root_lin_vel_w, spin_w)
        return reference_links(
            self.robot, Frame(*pose, state.joint_pos, state.joint_vel, at, at.pos_w, at.pos_w, at.pos_w)
        )

    @cached_property
    def object(self) -> ObjectState:
        """As planned."""
        assert self.planned_object is not None
        return self.planned_object


def _object(numbers: Tensor) -> ObjectState:
    """Of (N, 15) numbers of a plan."""
    pos, turn, lin_vel, ang_vel = numbers.split([3, 6, 3, 3], -1)
    quat = rot.from_6d(turn)
    return ObjectState(pos, quat, lin_vel, rot.rotate_inverse(quat, ang_vel))


def _fields(state: ObjectState) -> tuple[Tensor, ...]:
    return state.pos_w, state.quat_w, state.lin_vel_w, state.ang_vel_b
