"""Optimization after skeleton shape alignment, "OmniH2O" in the paper's tables (appendix B.3).

The human's global orientations and its root's global position stay; its bones get the robot's lengths, which moves all
its other joints; the optimization then follows these. In the rest pose, arms hanging, every mapped joint of the aligned
human lies where the robot's link does, as OmniH2O's fitted body shape brings it about as far as it can; where a human
joint stands for two links, it lies midway between them.
"""

from dataclasses import replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import RobotMotion
from mimicbench.core.skeleton import Skeleton, forward_kinematics
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.mapping import find_mapping
from mimicbench.retarget.method import Method
from mimicbench.retarget.methods.optimization import PAPER, OptimizationConfig, optimize_towards
from mimicbench.robots.description import Robot
from mimicbench.robots.mapping import Mapping


def align_and_optimize(clip: Clip, config: OptimizationConfig | None = None) -> RobotMotion:
    """The robot motion that follows the human with the robot's bones. Raises UnknownName or BadMotion."""
    motion = clip.motion
    aligned = replace(
        motion, skeleton=align(motion.skeleton, find_mapping(motion.skeleton.name, clip.robot), clip.robot)
    )
    return optimize_towards(clip, *aligned.forward_kinematics(), config or OptimizationConfig())


def align(skeleton: Skeleton, mapping: Mapping, robot: Robot) -> Skeleton:
    """The skeleton with the robot's bone lengths: mapped joints and wrists at rest lie where the robot's links and
    keypoints do.

    Joints between two mapped ones keep their share of the way, those beyond the last mapped one their offsets.
    """
    arms_down = np.array([robot.arms_down.get(name, 0.0) for name in robot.joint_names])
    link_pos, link_quat = robot.forward_kinematics(np.zeros(3), rot.IDENTITY, arms_down)
    joints = len(skeleton.joint_names)
    human, _ = forward_kinematics(skeleton, np.zeros(3), np.tile(rot.IDENTITY, (joints, 1)))
    places: dict[int, list[np.ndarray]] = {0: [np.zeros(3)]}
    for pair in mapping.pairs:
        if skeleton.index(pair.joint):  # the root stays
            places.setdefault(skeleton.index(pair.joint), []).append(link_pos[robot.link_names.index(pair.link)])
    for joint, keypoint in mapping.wrists:
        places[skeleton.index(joint)] = [robot.keypoint_pos(keypoint, link_pos, link_quat)]
    target = {joint: np.mean(where, 0) for joint, where in places.items()}
    offsets = skeleton.offsets.copy()
    for joint in target:
        chain, above = [joint], skeleton.parents[joint]
        while above >= 0 and above not in target:
            chain.append(above)
            above = skeleton.parents[above]
        if above < 0:
            continue
        span, wanted = human[joint] - human[above], target[joint] - target[above]
        shared = [step for step in chain[1:] if _leads_elsewhere(skeleton, step, joint, set(target))]
        if shared:  # a trunk that carries both arms cannot take one arm's correction: the last free bone does
            moved = sum(offsets[step] for step in chain[1:])
            offsets[joint] = wanted - moved
            continue
        for step in chain:  # every bone on the way takes its share of the change
            share = np.linalg.norm(skeleton.offsets[step]) / sum(
                np.linalg.norm(skeleton.offsets[other]) for other in chain
            )
            offsets[step] = skeleton.offsets[step] + share * (wanted - span)
    return replace(skeleton, offsets=offsets)


def _leads_elsewhere(skeleton: Skeleton, step: int, joint: int, mapped: set[int]) -> bool:
    """Whether some mapped joint other than `joint` hangs on `step` without another mapped one between."""
    for other in mapped - {joint}:
        above = skeleton.parents[other]
        while above >= 0 and above not in mapped:
            if above == step:
                return True
            above = skeleton.parents[above]
    return False


# its human has the robot's bones: what `improved` adds to the tables, for bones that differ, has no place in it
METHOD = Method("omnih2o", "OmniH2O", lambda clip, _: align_and_optimize(clip, PAPER), ("paper",))
