"""What a policy is to whoever judges it or runs it."""

from collections.abc import Sequence
from typing import Protocol

from torch import Tensor

from mimicbench.core.errors import MimicbenchError
from mimicbench.sensors.observations import TERMS, Observations, Term


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


def refuse_privileged(names: Sequence[str | Term], who: str) -> None:
    """Raises MimicbenchError if any of the terms is privileged: `who` is to act on its own senses."""
    for name in names:
        term = name if isinstance(name, Term) else TERMS.get(name)
        if term is not None and term.privileged:
            raise MimicbenchError(
                f"{who} asks for {term.name!r}, which no robot can sense; judge it on its own senses: choose from "
                + ", ".join(each.name for each in TERMS.values() if not each.privileged)
            )
