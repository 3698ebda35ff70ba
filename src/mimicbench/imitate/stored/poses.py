"""Poses that demonstrations were to come to, by the clips that they follow, or came to themselves."""

from dataclasses import replace

import torch
from torch import Tensor

from mimicbench.core.motion import RobotMotion
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.reference import ReferenceBank
from mimicbench.imitate.cloning import clips_of
from mimicbench.imitate.lerobot import Demos
from mimicbench.imitate.plan import PosePlan
from mimicbench.sim.physics import ObjectState, RobotState


def motions_of(demos: Demos, clips: ClipSet) -> ClipSet:
    """The demonstrations' own motions, one for each, by the names of the clips in whose first frames they began."""
    joints = len(demos.joint_names)
    begun = {motion.id: motion for motion in clips.motions}
    found = []
    for number, name in enumerate(demos.reference_ids):
        qpos = demos.qpos[demos.starts[number] : demos.starts[number + 1]]
        moved = qpos[:, 7 + joints :]
        where = {"object_pos_w": moved[:, :3], "object_quat_w": moved[:, 3:7]} if moved.shape[1] else {}
        found.append(
            RobotMotion(
                name,
                clips.task.name,
                demos.robot,
                demos.joint_names,
                demos.fps,
                qpos[:, :3],
                qpos[:, 3:7],
                qpos[:, 7 : 7 + joints],
                demos.object_ids[number],
                begun[name].reference_id,
                wrist_goal_w=begun[name].wrist_goal_w,
                **where,
            )
        )
    return replace(clips, motions=found)


class ClipPlans:
    """What the clips of demonstrations would have had a robot plan, wherever the tracker had taken it."""

    def __init__(self, demos: Demos, clips: ClipSet) -> None:
        self._layout = PosePlan(clips.robot, clips.task)
        self._bank = ReferenceBank(clips.motions, clips.robot)
        lengths = torch.from_numpy(demos.starts).diff()
        self._clip = clips_of(demos, clips).repeat_interleave(lengths)
        self._first = torch.from_numpy(demos.starts[:-1]).repeat_interleave(lengths)
        self._qpos, self._qvel = torch.from_numpy(demos.qpos), torch.from_numpy(demos.qvel)
        self._joints = len(clips.robot.joints)

    def of(self, frames: Tensor, steps: Tensor) -> Tensor:
        """(B, chunk, P) what is planned in frames (B,) for frames `steps` (B, chunk) of the same episodes."""
        here, there = frames[:, None].expand(steps.shape).flatten(), steps.flatten()
        root = self._qpos[here, :7].float()
        none = root[:, :0]
        state = RobotState(root[:, :3], root[:, 3:], none, none, none, none)
        index = there - self._first[here]
        two = self._bank.frame(self._clip[here].repeat(2), torch.cat([index + 1, index + 2]))
        return self._layout.flat(state, self._objects(there), two).unflatten(0, steps.shape)

    def _objects(self, frames: Tensor) -> ObjectState:
        """Where the objects are in frames (M,); at the origin where they stay there."""
        pose, motion = self._qpos[frames, 7 + self._joints :].float(), self._qvel[frames, 6 + self._joints :].float()
        if not pose.shape[1]:
            return ObjectState.at_origin(len(frames))
        return ObjectState(pose[:, :3], pose[:, 3:7], motion[:, :3], motion[:, 3:6])
