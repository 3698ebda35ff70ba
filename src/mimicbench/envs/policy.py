"""What a policy is to whoever judges it or runs it."""

from typing import Protocol

from torch import Tensor

from mimicbench.sensors.observations import Observations


class Policy(Protocol):
    """Drives N robots. The same object serves them all; what it remembers of one is forgotten by `reset`."""

    observations: tuple[str, ...]
    """Names of the terms that it observes (sensors.observations); judges refuse privileged ones."""
    gains: str
    """Which of the robot's gains its targets are meant for."""

    def to(self, device: str) -> None:
        """Move its networks to where the tensors of `device` live, as torch calls it; observations come from there."""
        ...

    def reset(self, ids: Tensor, obs: Observations) -> None:
        """Robots `ids` (M,) begin anew; `obs` are those of all N robots in their first frame."""
        ...

    def act(self, obs: Observations) -> Tensor:
        """Joint position targets (N, J) [rad] for all robots."""
        ...
