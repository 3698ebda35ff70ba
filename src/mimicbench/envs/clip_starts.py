"""Starts from clips: any frame of any clip can be entered, the object in mid-air between the hands included."""

from collections.abc import Sequence

import torch
from torch import Tensor

from mimicbench.core import rotations as rot
from mimicbench.envs.initial_states import InitialStates
from mimicbench.envs.reference import ReferenceBank
from mimicbench.envs.settings import ClipStartConfig
from mimicbench.robots.description import Robot
from mimicbench.sensors.arrays import own, tensor
from mimicbench.sensors.context import Frame
from mimicbench.sim.physics import RobotState


class ClipStarts:
    """Draws frames of a bank's clips, each clip beside its object."""

    def __init__(
        self, bank: ReferenceBank, object_index: Sequence[int], robot: Robot, config: ClipStartConfig | None = None
    ) -> None:
        """`object_index` (C,) are the places of the clips' objects in the physics' catalog."""
        self.bank, self.config = bank, config or ClipStartConfig()
        device = bank.lengths.device
        self._object_index = torch.tensor(object_index, dtype=torch.long, device=device)
        self._low, self._high = (
            torch.tensor(limit, dtype=torch.float32, device=device) for limit in robot.joint_range.T.copy()
        )

    def draw(self, count: int, random: torch.Generator, chances: Tensor | None = None) -> InitialStates:
        """Frames drawn at random, with noise on everything about the robot.

        `chances` (B,) are those of the B equal parts of every clip; None: all frames are as likely.
        """
        config, device = self.config, self._object_index.device
        share, first = torch.rand(2, count, generator=random, device=device)
        clip = torch.randint(len(self.bank), (count,), generator=random, device=device)
        if chances is not None:
            part = torch.multinomial(chances, count, replacement=True, generator=random)
            share = (part + share) / len(chances)
        share = torch.where(first < config.first_frame, 0.0, share)
        frame = (share * (self.bank.lengths[clip] - 2).clamp(min=0)).long()
        exact = self.at(clip, frame)
        return InitialStates(
            exact.object_index, self._disturbed(exact.robot, random), exact.object, exact.wrist_goal_w, clip, frame
        )

    def at(self, clip: Tensor, frame: Tensor) -> InitialStates:
        """Frames `frame` (n,) of clips `clip` (n,) as they are."""
        there = self.bank.frame(clip, frame)
        return InitialStates(
            self._object_index[clip], robot_state(there), there.object, there.wrist_goal_w, clip, frame
        )

    def _disturbed(self, state: RobotState, random: torch.Generator) -> RobotState:
        config, (n, joints) = self.config, state.joint_pos.shape
        noise = torch.randn(n, 12 + 2 * joints, generator=random, device=state.root_pos_w.device)
        pos, turn, lin, ang, joint_pos, joint_vel = noise.split([3, 3, 3, 3, joints, joints], -1)
        pos = pos * config.pos_noise
        pos[:, 2] /= 3
        xp, (turned, quat) = own(rot.from_rotvec(turn * config.angle_noise), state.root_quat_w)
        quat = rot.normalize(tensor(xp, rot.multiply(turned, quat)))
        angles = state.joint_pos + joint_pos * config.angle_noise
        return RobotState(
            state.root_pos_w + pos,
            quat,
            state.root_lin_vel_w + lin * config.vel_noise,
            state.root_ang_vel_b + ang * config.vel_noise,
            torch.maximum(torch.minimum(angles, self._high), self._low),
            state.joint_vel + joint_vel * config.vel_noise * 0.5,
        )


def robot_state(frame: Frame) -> RobotState:
    """The robot of a reference frame, in double precision, so that its turn is a turn to more than seven digits."""
    quat = rot.normalize(frame.root_quat_w.double())
    xp, (turn, ang_vel_w) = own(quat, frame.root_ang_vel_w.double())
    return RobotState(
        frame.root_pos_w.double(),
        quat,
        frame.root_lin_vel_w.double(),
        tensor(xp, rot.rotate_inverse(turn, ang_vel_w)),
        frame.joint_pos.double(),
        frame.joint_vel.double(),
    )
