"""Where in their clips robots fail, so that training can start there more often."""

from collections.abc import Mapping

import torch
from torch import Tensor

PARTS = 32
"""Equal parts that every clip is split into: clips of a task have walking, turning and acting in the same order."""
MEMORY = 1000
"""Control steps of all robots after which what was seen counts by 1/e."""
REWIND = 0.6
"""How much less a start so many parts before a failure counts, per part: what is lost there is often lost before."""


class Failures:
    """How often robots fail in each part of their clips, over the last control steps."""

    def __init__(self, device: str | torch.device = "cpu") -> None:
        # as if every part had been seen and had failed as often as the others
        self.steps = torch.full((PARTS,), 100.0, device=device)
        self.failed = torch.ones(PARTS, device=device)
        ahead = torch.arange(PARTS)[None] - torch.arange(PARTS)[:, None]
        self._rewind = torch.where(ahead >= 0, REWIND ** ahead.clamp(min=0), 0.0).to(device)

    def update(self, progress: Tensor, failed: Tensor) -> None:
        """Robots are at `progress` (N,) of their clips, 1 being the end; some `failed` (N,) bool."""
        part = (progress * PARTS).long().clamp(max=PARTS - 1)
        keep = 1.0 - 1.0 / MEMORY
        self.steps = (keep * self.steps).index_add(0, part, torch.ones_like(progress))
        self.failed = (keep * self.failed).index_add(0, part, failed.to(progress.dtype))

    def chances(self, focus: float) -> Tensor:
        """(PARTS,) chance of each part to be started in; 1 - `focus` of it is spread evenly."""
        hazard = self.failed / self.steps.clamp(min=1.0)
        weight = self._rewind @ hazard
        return focus * weight / weight.sum().clamp(min=1e-12) + (1.0 - focus) / PARTS

    def state_tensors(self) -> dict[str, Tensor]:
        """What was seen."""
        return {"steps": self.steps.clone(), "failed": self.failed.clone()}

    def load_state_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `state_tensors`."""
        self.steps, self.failed = tensors["steps"].to(self.steps.device), tensors["failed"].to(self.failed.device)
