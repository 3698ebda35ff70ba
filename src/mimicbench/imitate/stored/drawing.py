"""Which frames a batch is of: of demonstrations, of what a learner drove, and of where it drove wrongly."""

import numpy as np
import torch
from torch import Tensor

from mimicbench.imitate.lerobot import Demos

FARTHEST = 0.15
"""Targets that are farther from what should have been done [rad] count as much as these: whoever is that far off is
tumbling, which is seldom worth learning to do well.
"""
_AT_ONCE = 1 << 18


class Drawing:
    """Draws from the frames to learn from."""

    def __init__(self, demos: Demos, frames: Tensor) -> None:
        """`frames` (F,) of the demonstrations are to be learned from."""
        shown = torch.from_numpy(np.repeat(demos.success, np.diff(demos.starts)))[frames]
        self.frames = frames
        self.by_experts = frames[shown]
        """Of demonstrations, which succeeded."""
        self.by_learners = frames[~shown]
        """Of what a learner drove, judged by nobody."""
        self._demos = demos
        self._wrong: Tensor | None = None

    def draw(self, count: int, driven: float, wrong: float, generator: torch.Generator) -> Tensor:
        """(count,) frames, part `driven` of them from what a learner drove, if there is any; 0: from all.

        Part `wrong` of those are drawn by how far what the learner did was from what it should have done.
        """
        if not driven or not len(self.by_experts) or not len(self.by_learners):
            return _some(self.frames, count, generator)
        learners = round(driven * count)
        by_wrong = round(wrong * learners)
        parts = [
            _some(self.by_experts, count - learners, generator),
            _some(self.by_learners, learners - by_wrong, generator),
        ]
        if by_wrong:
            sums = self._errors_summed()
            at = torch.rand(by_wrong, generator=generator, dtype=torch.float64) * sums[-1]
            parts.append(self.by_learners[torch.searchsorted(sums, at).clamp(max=len(sums) - 1)])
        return torch.cat(parts)

    def _errors_summed(self) -> Tensor:
        """Sums (L,) of the errors [rad] of the driven frames up to each, means over the joints."""
        if self._wrong is None:
            errors = torch.empty(len(self.by_learners), dtype=torch.float64)
            for begin in range(0, len(errors), _AT_ONCE):
                some = self.by_learners[begin : begin + _AT_ONCE].numpy()
                off = np.abs(self._demos.action[some] - self._demos.executed_action[some]).mean(-1)
                errors[begin : begin + _AT_ONCE] = torch.from_numpy(off).double().clamp(max=FARTHEST)
            self._wrong = errors.cumsum(0)
        return self._wrong


def _some(frames: Tensor, count: int, generator: torch.Generator) -> Tensor:
    return frames[torch.randint(len(frames), (count,), generator=generator)]
