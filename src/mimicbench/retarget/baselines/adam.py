"""The paper's way to minimize: Adam on a whole clip (appendix B.2: rate 0.02, 3000 epochs).

What the banded solver is measured against.

It gets the solver's own analytic gradient, which is kinder to it than automatic differentiation: the same numbers in
less time.
"""

from typing import Protocol

import numpy as np

from mimicbench.retarget.kinematics import Links, Pose, Tree
from mimicbench.retarget.solver import move

EPOCHS, RATE = 3000, 0.02
_MEAN, _SQUARE, _SMALL = 0.9, 0.999, 1e-8


class Differentiable(Protocol):
    """What Adam minimizes, such as `optimization.Problem`."""

    @property
    def tree(self) -> Tree:
        """The robot's."""
        ...

    @property
    def limits(self) -> np.ndarray:
        """(N, 2) of the joints [rad]."""
        ...

    def loss(self, pose: Pose, links: Links, softened: bool = True) -> float:
        """Its value, of true or of softened absolute values."""
        ...

    def gradient(self, pose: Pose, links: Links) -> np.ndarray:
        """(T, 6 + N) of the softened one."""
        ...


def adam(
    objective: Differentiable, start: Pose, epochs: int = EPOCHS, rate: float = RATE, falling: bool = False
) -> tuple[Pose, list[float]]:
    """Minimize from a start.

    Args:
        objective: What to minimize.
        start: Clipped to the limits, as every step is.
        epochs: Steps over the whole clip.
        rate: Of learning.
        falling: Let the rate fall to 0 in the end, which the appendix does not say, but which reaches a lower loss.

    Returns:
        The best configuration on the way, by the true loss, and the loss before each step.
    """
    limits = objective.limits
    pose = start._replace(joints=np.clip(start.joints, limits[:, 0], limits[:, 1]))
    mean, square = np.zeros((len(start.joints), 6 + len(limits))), np.zeros((len(start.joints), 6 + len(limits)))
    best, least, losses = pose, np.inf, []
    for epoch in range(1, epochs + 1):
        links = objective.tree.place(pose)
        losses.append(objective.loss(pose, links, softened=False))
        if losses[-1] < least:
            best, least = pose, losses[-1]
        gradient = objective.gradient(pose, links)
        mean, square = _MEAN * mean + (1 - _MEAN) * gradient, _SQUARE * square + (1 - _SQUARE) * gradient**2
        now = rate * (1 - epoch / epochs) if falling else rate
        step = -now * (mean / (1 - _MEAN**epoch)) / (np.sqrt(square / (1 - _SQUARE**epoch)) + _SMALL)
        pose = move(pose, step, limits)
    last = objective.loss(pose, objective.tree.place(pose), softened=False)
    return (pose if last < least else best), losses
