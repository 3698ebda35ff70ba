"""The human skeletons of the benchmark's sources: joint trees and bone lengths.

All are kept in one rest pose, whatever the source's own is: standing, legs straight down, arms hanging, x forward, y
left, z up, every joint's frame parallel to the world's. So a joint's orientation means the same in all of them, and
limbs hang along -z.
"""

import numpy as np

from mimicbench.core.errors import UnknownName
from mimicbench.core.skeleton import Skeleton

UNIHSI = Skeleton(
    name="unihsi",
    joint_names=(
        "pelvis",
        "torso",
        "head",
        "right_upper_arm",
        "right_lower_arm",
        "right_hand",
        "left_upper_arm",
        "left_lower_arm",
        "left_hand",
        "right_thigh",
        "right_shin",
        "right_foot",
        "left_thigh",
        "left_shin",
        "left_foot",
    ),
    parents=(-1, 0, 1, 1, 3, 4, 1, 6, 7, 0, 9, 10, 0, 12, 13),
    offsets=np.array(
        [
            [0, 0, 0],
            [0, 0, 0.236151],
            [0, 0, 0.223894],
            [-0.02405, -0.18311, 0.2435],
            [0, 0, -0.274788],
            [0, 0, -0.258947],
            [-0.02405, 0.18311, 0.2435],
            [0, 0, -0.274788],
            [0, 0, -0.258947],
            [0, -0.084887, 0],
            [0, 0, -0.421546],
            [0, 0, -0.40987],
            [0, 0.084887, 0],
            [0, 0, -0.421546],
            [0, 0, -0.40987],
        ]
    ),
)
"""The 15 bodies of the AMP humanoid that UniHSI moves (1.62 m tall)."""

ROAM = Skeleton(
    name="roam",
    joint_names=(
        "Hips",
        "Spine",
        "Spine1",
        "Spine2",
        "Spine3",
        "Spine4",
        "Neck",
        "Head",
        "HeadSite",
        "LeftShoulder",
        "LeftArm",
        "LeftForeArm",
        "LeftHand",
        "RightShoulder",
        "RightArm",
        "RightForeArm",
        "RightHand",
        "LeftUpLeg",
        "LeftLeg",
        "LeftFoot",
        "LeftToeBase",
        "LeftToeBaseSite",
        "RightUpLeg",
        "RightLeg",
        "RightFoot",
        "RightToeBase",
        "RightToeBaseSite",
    ),
    parents=(-1, 0, 1, 2, 3, 4, 5, 6, 7, 4, 9, 10, 11, 4, 13, 14, 15, 0, 17, 18, 19, 20, 0, 22, 23, 24, 25),
    offsets=np.array(
        [
            [0, 0, 0],
            [-0.0298, 0, 0.0583],
            [0.0270, 0, 0.1009],
            [-0.0082, 0, 0.0765],
            [-0.0056, 0, 0.0915],
            [0.0103, 0, 0.1355],
            [0.0453, 0, 0.0647],
            [0.0232, 0, 0.0777],
            [0.0078, 0, 0.1620],
            [0.0740, 0.0389, 0.1647],
            [-0.0298, 0.1036, -0.0232],
            [0, 0, -0.2528],
            [0, 0, -0.2224],
            [0.0740, -0.0389, 0.1647],
            [-0.0298, -0.1036, -0.0232],
            [0, 0, -0.2528],
            [0, 0, -0.2224],
            [0.0149, 0.0896, -0.0291],
            [0, 0, -0.3735],
            [0, 0, -0.3754],
            [0.1318, -0.0026, -0.0371],
            [0.0786, -0.0010, -0.0126],
            [0.0149, -0.0896, -0.0291],
            [0, 0, -0.3735],
            [0, 0, -0.3754],
            [0.1318, 0.0026, -0.0371],
            [0.0786, 0.0010, -0.0126],
        ]
    ),
)
"""The 27 joints of ROAM's character."""

CORE4D = Skeleton(
    name="core4d",
    joint_names=(
        "pelvis",
        "left_hip",
        "right_hip",
        "spine1",
        "left_knee",
        "right_knee",
        "spine2",
        "left_ankle",
        "right_ankle",
        "spine3",
        "left_foot",
        "right_foot",
        "neck",
        "left_collar",
        "right_collar",
        "head",
        "left_shoulder",
        "right_shoulder",
        "left_elbow",
        "right_elbow",
        "left_wrist",
        "right_wrist",
    ),
    parents=(-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19),
    offsets=np.array(
        [
            [0, 0, 0],
            [-0.0295, 0.0511, -0.0879],
            [-0.0295, -0.0511, -0.0879],
            [-0.0209, 0, 0.1050],
            [0, 0, -0.4271],
            [0, 0, -0.4271],
            [-0.0041, 0, 0.1258],
            [0, 0, -0.4498],
            [0, 0, -0.4498],
            [0.0192, 0, 0.0491],
            [0.1230, 0.0444, -0.0663],
            [0.1230, -0.0444, -0.0663],
            [-0.0237, 0, 0.1581],
            [-0.0059, 0.0442, 0.0812],
            [-0.0059, -0.0442, 0.0812],
            [0.0241, 0, 0.1639],
            [-0.0131, 0.1144, 0.0575],
            [-0.0131, -0.1144, 0.0575],
            [0, 0, -0.2881],
            [0, 0, -0.2881],
            [0, 0, -0.2791],
            [0, 0, -0.2791],
        ]
    ),
)
"""The 22 body joints of SMPL-X, with the bones of one of CORE4D's people (1.80 m tall), legs made straight."""

SKELETONS: dict[str, Skeleton] = {skeleton.name: skeleton for skeleton in (UNIHSI, ROAM, CORE4D)}


def get_skeleton(name: str) -> Skeleton:
    """A skeleton by name. Raises UnknownName."""
    if name not in SKELETONS:
        raise UnknownName("skeleton", name, list(SKELETONS))
    return SKELETONS[name]
