"""What a tracker's network saw in the last frames, of each robot since its episode began."""

from collections.abc import Mapping

import torch
from torch import Tensor

from mimicbench.sim.rows import Rows
from mimicbench.track.spec import Terms
from mimicbench.track.tracker import Layout, Tracker


class History:
    """The frames before the present one, of N robots; zeros where their episode had not begun yet (HumanPlus)."""

    def __init__(self, layout: Layout, num_envs: int, device: str | torch.device = "cpu") -> None:
        self._width = layout.size
        self.past = torch.zeros(num_envs, (layout.frames - 1) * layout.size, device=device)
        """(N, (F - 1) O) numbers, the oldest frame first; none where a network sees the present frame alone."""

    @property
    def remembers(self) -> bool:
        """Whether there is anything to remember."""
        return self.past.shape[1] > 0

    def begin(self, rows: Rows) -> None:
        """Episodes `rows` begin anew: nothing was seen before."""
        if self.remembers:
            rows.put(self.past, 0.0)

    def seen(self, now: Tensor) -> Tensor:
        """(N, F O) all frames, the present one (N, O) last."""
        return torch.cat([self.past, now], -1) if self.remembers else now

    def add(self, now: Tensor) -> None:
        """The present frame (N, O) is over."""
        if self.remembers:
            self.past = self.seen(now)[:, self._width :]

    def state_tensors(self) -> dict[str, Tensor]:
        """What was seen."""
        return {"past": self.past.clone()} if self.remembers else {}

    def load_state_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `state_tensors`."""
        self.past = tensors["past"].to(self.past.device, copy=True) if self.remembers else self.past


class Follower:
    """A tracker that drives N robots by its mean action, and remembers what it saw of each."""

    def __init__(self, tracker: Tracker, num_envs: int, device: str | torch.device = "cpu") -> None:
        """All robots begin an episode."""
        self.tracker = tracker
        self.history = History(tracker.layout, num_envs, device)

    def action(self, terms: Terms) -> Tensor:
        """(N, J) its action on the terms of the present frame, after which the next one begins."""
        now = self.tracker.layout.flat(terms)
        action = self.tracker.network(self.history.seen(now))
        self.history.add(now)
        return action
