"""What a planner tells a tracker, as a vector that can be learned."""

import torch
from torch import Tensor

from mimicbench.core import rotations as rot
from mimicbench.robots.description import Robot
from mimicbench.sensors.observations import chosen_terms
from mimicbench.tasks.task import Task
from mimicbench.track.spec import Terms, TrackerSpec


class PlanLayout:
    """The privileged terms of a tracker at a task, one after the other.

    Rotation vectors are told as two columns of a matrix: half a turn to the left is half a turn to the right, and what
    lies between the two as numbers is no turn at all.
    """

    def __init__(self, spec: TrackerSpec, robot: Robot, task: Task) -> None:
        self.terms = tuple(term for term in chosen_terms(spec.observations, task) if term.privileged)
        self._widths = [torch.Size(term.shape(robot, task)).numel() for term in self.terms]
        self.size = sum(width + 3 * len(term.turns) for term, width in zip(self.terms, self._widths, strict=True))
        """P."""

    def flat(self, terms: Terms) -> Tensor:
        """(N, P) of terms that hold at least these."""
        parts = []
        for term in self.terms:
            values, end = terms[term.name].flatten(1), 0
            for at in term.turns:
                turn = rot.to_6d(rot.from_rotvec(values[:, at : at + 3]))
                parts += [values[:, end:at], turn]
                end = at + 3
            parts.append(values[:, end:])
        return torch.cat(parts, -1)

    def split(self, plan: Tensor) -> dict[str, Tensor]:
        """The terms (N, ...) of plans (N, P), by name. No gradient passes through their turns."""
        widths = [width + 3 * len(term.turns) for term, width in zip(self.terms, self._widths, strict=True)]
        found = {}
        for term, values in zip(self.terms, plan.split(widths, -1), strict=True):
            parts, end = [], 0
            for number, at in enumerate(term.turns):
                first = at + 3 * number
                turn = rot.to_rotvec(rot.from_6d(values[:, first : first + 6].detach()))
                parts += [values[:, end:first], turn]
                end = first + 6
            found[term.name] = torch.cat([*parts, values[:, end:]], -1) if parts else values
        return found
