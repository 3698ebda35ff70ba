"""Clips in the mirror: a robot that does with its right what it did with its left, beside the mirrored object."""

from dataclasses import replace

from mimicbench.core.motion import RobotMotion
from mimicbench.envs.clips import ClipSet
from mimicbench.objects.shape import SceneObject
from mimicbench.references.augment import LATERAL, mirrored_object
from mimicbench.robots.description import Robot
from mimicbench.robots.mirror import SPECULAR, SPECULAR_QUAT, mirrored_joints, mirrored_labels, other_side, toggled


def mirrored(motion: RobotMotion, robot: Robot, obj: SceneObject) -> RobotMotion:
    """Left and right exchanged, of the robot, the object's path and the goals, for `obj`, the object in the mirror.

    Twice gives the same clip again. Raises BadMotion if the robot is not the same on both sides, or its labels are not.
    """
    other, sign = mirrored_joints(robot)
    columns = mirrored_labels(motion.id, motion.contact_names)
    return replace(
        motion,
        id=toggled(motion.id),
        object_id=obj.id,
        root_pos_w=motion.root_pos_w * SPECULAR,
        root_quat_w=motion.root_quat_w * SPECULAR_QUAT,
        joint_pos=motion.joint_pos[:, other] * sign,
        contacts=motion.contacts[:, columns] if columns else motion.contacts,
        style={other_side(name): -value if name in LATERAL else value for name, value in motion.style.items()},
        object_pos_w=motion.object_pos_w * SPECULAR,
        object_quat_w=motion.object_quat_w * SPECULAR_QUAT,
        wrist_goal_w=motion.wrist_goal_w[::-1] * SPECULAR,
    )


def with_mirror_images(clips: ClipSet) -> ClipSet:
    """The clips and the mirror images that they lack, each of these beside the mirror image of its object.

    Raises BadMotion if the robot is not the same on both sides.
    """
    known = {motion.id for motion in clips.motions}
    lacking = [motion for motion in clips.motions if toggled(motion.id) not in known]
    objects = {name: mirrored_object(clips.objects[name]) for name in {motion.object_id for motion in lacking}}
    images = [mirrored(motion, clips.robot, objects[motion.object_id]) for motion in lacking]
    return clips.joined(replace(clips, motions=images, objects={obj.id: obj for obj in objects.values()}))
