"""Which frames a batch is of: of demonstrations, of what a learner drove, of where it drove wrongly, of beginnings."""

from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from mimicbench.imitate.lerobot import Demos

NEAREST, FARTHEST = 1e-6, 0.15
"""Targets count as at least and at most so far from what should have been done [rad]: where nobody was wrong all frames
are alike, and whoever is farther off is tumbling, which is seldom worth learning to do well.
"""
SOON = 1.0
"""[s] The beginning of an episode."""
_AT_ONCE = 1 << 18


class Sampler:
    """Draws from the frames to learn from."""

    def __init__(self, demos: Demos, frames: Tensor) -> None:
        """`frames` (F,) of the demonstrations are to be learned from."""
        shown = torch.from_numpy(np.repeat(demos.success, np.diff(demos.starts)))[frames]
        self.frames = frames
        self.by_experts = frames[shown]
        """Of demonstrations, which succeeded."""
        self.by_learners = frames[~shown]
        """Of episodes that a learner drove from some moment on, what the expert drove before it among them; judged by
        nobody.
        """
        since = frames - torch.from_numpy(np.repeat(demos.starts[:-1], np.diff(demos.starts)))[frames]
        self.soon = frames[since < SOON * demos.fps]
        """Of the beginnings of all episodes."""
        self._demos = demos

    def draw(self, count: int, soon: float, driven: float, wrong: float, generator: torch.Generator) -> Tensor:
        """(count,) frames, part `soon` of them from the beginnings of episodes, and part `driven` of the others from
        episodes that a learner drove, if there is any; 0: as much as there is.

        Part `wrong` of those are drawn by how far what the learner did was from what it should have done.
        """
        if first := round(soon * count):
            others = self.draw(count - first, 0.0, driven, wrong, generator)
            return torch.cat([_some(self.soon, first, generator), others])
        if not (driven or wrong) or not len(self.by_experts) or not len(self.by_learners):
            return _some(self.frames, count, generator)
        learners = round((driven or len(self.by_learners) / len(self.frames)) * count)
        by_wrong = round(wrong * learners)
        parts = [
            _some(self.by_experts, count - learners, generator),
            _some(self.by_learners, learners - by_wrong, generator),
        ]
        if by_wrong:
            at = torch.rand(by_wrong, generator=generator, dtype=torch.float64) * self._errors_summed[-1]
            parts.append(self.by_learners[torch.searchsorted(self._errors_summed, at)])
        return torch.cat(parts)

    @cached_property
    def _errors_summed(self) -> Tensor:
        """Sums (L,) of the errors [rad] of the driven frames up to each, means over the joints."""
        errors = torch.empty(len(self.by_learners), dtype=torch.float64)
        for begin in range(0, len(errors), _AT_ONCE):
            some = self.by_learners[begin : begin + _AT_ONCE].numpy()
            off = np.abs(self._demos.action[some] - self._demos.executed_action[some]).mean(-1)
            errors[begin : begin + _AT_ONCE] = torch.from_numpy(off)
        return errors.clamp(NEAREST, FARTHEST).cumsum(0)


def _some(frames: Tensor, count: int, generator: torch.Generator) -> Tensor:
    return frames[torch.randint(len(frames), (count,), generator=generator)]
