"""Copied rotations: the robot's joint angles read off the human's, without regard to places (section 4.1).

The other methods start from them.
"""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import RobotMotion
from mimicbench.retarget.clip import Clip, storable
from mimicbench.retarget.kinematics import Pose, Tree, tree_of
from mimicbench.retarget.mapping import Bound, Preset, followed_points
from mimicbench.retarget.method import Method


def copy_rotation(clip: Clip, preset: Preset = "improved") -> RobotMotion:
    """The motion with the human's rotations.

    Its root stands where the human's does, moved up or down until standing soles are on the floor.
    """
    bound, tree = clip.bind(preset), tree_of(clip.robot)
    return clip.grounded(
        tree, copy_rotations(bound, tree, storable(clip.robot.joint_range), *clip.motion.forward_kinematics()), bound
    )


def copy_rotations(bound: Bound, tree: Tree, limits: np.ndarray, pos_w: np.ndarray, quat_w: np.ndarray) -> Pose:
    """The pose whose root stands where the human's does and whose runs of joints between two carriers take the
    human's relative rotations.

    A run of three joints with successive axes at right angles gets its three angles in closed form; a shorter one the
    part of the rotation that is about its axes. Angles are continuous in time and clipped to the limits (N, 2) [rad].

    Args:
        bound: The mapping.
        tree: The robot's.
        limits: Of the joints.
        pos_w: (T, J, 3) human joint positions [m].
        quat_w: (T, J, 4) human joint orientations.
    """
    from scipy.spatial.transform import Rotation

    turned = {
        link: rot.multiply(quat_w[:, joint], offset)
        for (joint, link), offset in zip(bound.carriers, bound.carrier_offsets, strict=True)
    }
    joints = np.zeros((len(pos_w), len(limits)))
    driver = {int(link): j for j, link in enumerate(tree.joint_link)}
    parent = {int(link): int(up) for links, ups in tree.levels for link, up in zip(links, ups, strict=True)}
    for link, target in turned.items():
        run = []
        while link in parent and (not run or link not in turned):
            run.insert(0, link)
            link = parent[link]
        if not run or link not in turned or not all(step in driver for step in run):
            continue
        # The run's rotation is the product of Q_i R(a_i, q_i); seen from its start, that is the product of R(b_i, q_i)
        # times a constant.
        fixed, axes = rot.IDENTITY, []
        for step in run:
            fixed = rot.multiply(fixed, tree.link_quat[step])
            axes.append(rot.rotate(fixed, tree.joint_axis[driver[step]]))
        turn = rot.multiply(rot.multiply(rot.conjugate(turned[link]), target), rot.conjugate(fixed))
        columns = [driver[step] for step in run]
        if len(run) == 3 and abs(axes[0] @ axes[1]) < 1e-6 and abs(axes[1] @ axes[2]) < 1e-6:
            joints[:, columns] = Rotation.from_quat(turn, scalar_first=True).as_davenport(
                np.array(axes), "intrinsic", suppress_warnings=True
            )
        else:
            joints[:, columns] = rot.to_rotvec(turn) @ np.array(axes).T
    # Continuous in time first, then whole turns: a joint must not leap from one end of its range to the other.
    joints = np.unwrap(joints, axis=0)
    joints -= 2 * np.pi * np.round((joints - np.mean(limits, 1)).mean(0) / (2 * np.pi))
    return Pose(followed_points(bound, pos_w, quat_w)[:, 0], turned[0], np.clip(joints, limits[:, 0], limits[:, 1]))


METHOD = Method("copy-rotation", "Copy rotation", copy_rotation)
