"""Whether stored demonstrations show what they were kept for: K is looked for in their states once more."""

from dataclasses import replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import RobotMotion
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.metrics import STAY
from mimicbench.imitate.cloning import clips_of
from mimicbench.imitate.lerobot import Demos


def unfulfilled(demos: Demos, clips: ClipSet) -> list[str]:
    """Reference ids of the demonstrations whose states do not fulfil K of the clips' task, or do not hold its condition
    over the last 0.3 s, or as long as K asks.

    Raises BadFile if a demonstration is of none of the clips.
    """
    task, found = clips.task, []
    frames = max(task.hold_frames(demos.fps), round(STAY * demos.fps))
    for episode, clip in enumerate(clips_of(demos, clips).tolist()):
        motion = replayed(demos, episode, clips.motions[clip])
        obj = clips.objects[motion.object_id]
        last = task.held(motion, obj, clips.robot)[-frames:]
        if not (task.fulfilled(motion, obj, clips.robot) and len(last) == frames and last.all()):
            found.append(demos.reference_ids[episode])
    return found


def replayed(demos: Demos, episode: int, followed: RobotMotion) -> RobotMotion:
    """What the robot, and the object, did in an episode, as a clip beside the object of the clip that was followed."""
    qpos = demos.qpos[demos.starts[episode] : demos.starts[episode + 1]].astype(np.float64)
    pos, quat, joints, object_pos, object_quat = np.split(qpos, np.cumsum([3, 4, len(demos.joint_names), 3]), 1)
    return replace(
        followed,
        fps=demos.fps,
        joint_names=demos.joint_names,
        root_pos_w=pos,
        root_quat_w=rot.normalize(quat),
        joint_pos=joints,
        contact_names=(),
        contacts=np.zeros((0, 0), bool),
        object_pos_w=object_pos if object_quat.size else followed.object_pos_w[:0],
        object_quat_w=rot.normalize(object_quat) if object_quat.size else followed.object_quat_w[:0],
    )
