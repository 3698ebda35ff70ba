"""One clip on its way from a human to a robot: what every method is given, and how its result becomes a motion."""

from collections.abc import Mapping as Dictionary
from dataclasses import dataclass

import numpy as np

from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.objects.shape import SceneObject
from mimicbench.retarget.grounding import ground, stance
from mimicbench.retarget.kinematics import Pose, Tree
from mimicbench.retarget.mapping import Bound, Preset, bind, find_mapping
from mimicbench.retarget.measures import measure, measure_scene
from mimicbench.robots.description import Robot


@dataclass(frozen=True)
class Clip:
    """What there is to retarget."""

    motion: HumanMotion
    obj: SceneObject
    """What the human acts on."""
    robot: Robot

    @property
    def by_hand(self) -> bool:
        """Whether hands have something to do: there are places for the wrists, or an object that moves."""
        return bool(len(self.motion.wrist_goal_w) or len(self.motion.object_pos_w))

    def bind(self, preset: Preset) -> Bound:
        """The mapping between this human and this robot. Raises UnknownName or BadMotion."""
        return bind(find_mapping(self.motion.skeleton.name, self.robot), self.motion.skeleton, self.robot, preset)

    def grounded(
        self, tree: Tree, pose: Pose, bound: Bound, measures: Dictionary[str, float] | None = None
    ) -> RobotMotion:
        """The motion of a pose, moved up or down so that standing soles are on the floor, and measured."""
        pos_w, _ = self.motion.forward_kinematics()
        standing = stance(self.motion, bound, pos_w[:, [joint for joint, _ in bound.feet]])
        return self.finished(
            tree,
            pose._replace(root_pos=pose.root_pos + [0.0, 0.0, ground(tree.place(pose), bound, standing)]),
            bound,
            measures,
        )

    def finished(
        self, tree: Tree, pose: Pose, bound: Bound, measures: Dictionary[str, float] | None = None
    ) -> RobotMotion:
        """The motion of a pose, measured: same id, frame rate, object, goal, contacts and style as the human's."""
        human = self.motion
        pos_w, quat_w = human.forward_kinematics()
        standing = stance(human, bound, pos_w[:, [joint for joint, _ in bound.feet]])
        links, mapping = tree.place(pose), find_mapping(human.skeleton.name, self.robot)
        measured = measure(links, pose, bound, self.robot, pos_w, quat_w, human.fps, standing)
        measured |= measure_scene(links, self.robot, mapping, bound, human, self.obj, standing)
        return RobotMotion(
            id=human.id,
            task=human.task,
            robot=self.robot.name,
            joint_names=self.robot.joint_names,
            fps=human.fps,
            root_pos_w=pose.root_pos,
            root_quat_w=pose.root_quat,
            joint_pos=pose.joints,
            object_id=human.object_id,
            reference_id=human.id,
            contact_names=human.contact_names,
            contacts=human.contacts,
            style=human.style,
            measures={**measured, **(measures or {})},
            object_pos_w=human.object_pos_w,
            object_quat_w=human.object_quat_w,
            wrist_goal_w=human.wrist_goal_w,
        )


def storable(limits: np.ndarray) -> np.ndarray:
    """Limits (N, 2) a hair narrower, for files keep single precision and what they round must not exceed a limit."""
    return np.nextafter(limits.astype(np.float32), np.float32(limits.mean(1, keepdims=True))).astype(float)
