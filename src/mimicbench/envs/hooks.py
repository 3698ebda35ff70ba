"""What happens to robots beside what they do: pushes, assisting forces, late or noisy actions, noisy sensors.

A hook is told when episodes begin and before every step; it may change the targets, push, or assist. Its randomness
comes from the environment's generator, so that a seed decides everything.
"""

from collections.abc import Mapping
from typing import Protocol

import torch
from torch import Tensor

from mimicbench.core import rotations as rot
from mimicbench.sensors.context import StepContext
from mimicbench.sim.physics import Physics
from mimicbench.sim.rows import Rows
from mimicbench.sim.timing import CONTROL_DT


class Hook(Protocol):
    """Disturbs or helps N robots."""

    def begin(self, physics: Physics, rows: Rows, random: torch.Generator) -> None:
        """Episodes `rows` begin anew."""
        ...

    def before_step(self, context: StepContext, target: Tensor, random: torch.Generator) -> Tensor:
        """The targets (N, J) that are applied instead of `target`; called before every control step."""
        ...

    def state_tensors(self) -> dict[str, Tensor]:
        """What it remembers."""
        ...

    def load_state_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `state_tensors`."""
        ...


class Stateless:
    """A hook that remembers nothing."""

    def begin(self, physics: Physics, rows: Rows, random: torch.Generator) -> None:
        """Nothing to do."""

    def state_tensors(self) -> dict[str, Tensor]:
        """Nothing."""
        return {}

    def load_state_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """Nothing."""


class Pushes(Stateless):
    """Sudden changes of the root's horizontal velocity."""

    def __init__(self, deviation: float, interval: float) -> None:
        """`deviation` of the velocity that a push adds [m/s]; `interval` between pushes in the mean [s]."""
        self.deviation, self.chance = deviation, CONTROL_DT / interval

    def before_step(self, context: StepContext, target: Tensor, random: torch.Generator) -> Tensor:
        """Push some."""
        n, device = context.num_envs, context.device
        hit = torch.rand(n, 1, generator=random, device=device) < self.chance
        velocity = torch.randn(n, 3, generator=random, device=device) * self.deviation
        velocity[:, 2] = 0.0
        context.physics.push(torch.where(hit, velocity, 0.0))
        return target


class ActionNoise(Stateless):
    """Gaussian noise on the applied joint targets; who records the targets themselves has clean labels."""

    def __init__(self, deviation: Tensor | float) -> None:
        """`deviation` [rad], one number or (N, 1) for each robot."""
        self.deviation = deviation

    def before_step(self, context: StepContext, target: Tensor, random: torch.Generator) -> Tensor:
        """Disturb the targets."""
        noise = torch.randn(target.shape, generator=random, device=target.device, dtype=target.dtype)
        return target + noise * self.deviation


class ActionDelay:
    """Targets arrive some control steps late; until the first arrives, the joints hold the pose of the start."""

    def __init__(self, steps: int) -> None:
        """`steps` control steps, at least one."""
        self.steps = steps
        self._waiting: Tensor | None = None

    def begin(self, physics: Physics, rows: Rows, random: torch.Generator) -> None:
        """Nothing is on its way yet."""
        joint_pos = physics.state().joint_pos
        if self._waiting is None:
            self._waiting = joint_pos.expand(self.steps, -1, -1).clone()
        for late in self._waiting:
            rows.put(late, joint_pos[rows.ids])

    def before_step(self, context: StepContext, target: Tensor, random: torch.Generator) -> Tensor:
        """The targets of `steps` ago."""
        assert self._waiting is not None, "begin comes first"
        arrived = self._waiting[0].clone()
        self._waiting = torch.cat([self._waiting[1:], target[None]])
        return arrived

    def state_tensors(self) -> dict[str, Tensor]:
        """What is on its way."""
        return {} if self._waiting is None else {"waiting": self._waiting.clone()}

    def load_state_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `state_tensors`."""
        self._waiting = tensors.get("waiting")


class AssistingWrench(Stateless):
    """A spring and a damper that pull the root towards its reference, as strong as `share` says.

    Who trains lets the share fade to zero; nobody is judged with it.
    """

    def __init__(self, force: float = 1500.0, torque: float = 150.0, damping: float = 0.1, share: float = 1.0) -> None:
        """`force` [N/m] and `torque` [N m/rad] per error, `damping` [s] of them per velocity error."""
        self.force, self.torque, self.damping, self.share = force, torque, damping, share

    def before_step(self, context: StepContext, target: Tensor, random: torch.Generator) -> Tensor:
        """Pull."""
        frame, state = context.reference(1), context.state
        spin_w = rot.rotate(state.root_quat_w, state.root_ang_vel_b)
        away = frame.root_pos_w - state.root_pos_w
        turn = rot.to_rotvec(rot.multiply(frame.root_quat_w, rot.conjugate(state.root_quat_w)))
        force = away + self.damping * (frame.root_lin_vel_w - state.root_lin_vel_w)
        torque = turn + self.damping * (frame.root_ang_vel_w - spin_w)
        context.physics.assist(self.share * self.force * force, self.share * self.torque * torque)
        return target
