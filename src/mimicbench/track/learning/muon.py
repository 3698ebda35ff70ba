"""Muon for matrices beside Adam for everything else, as one optimizer."""

from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import nn

from mimicbench.core.errors import MimicbenchError


class MuonAndAdam(torch.optim.Optimizer):
    """Steps of momentum made orthogonal where a parameter is a matrix (Jordan et al. 2024), Adam's for the others.

    Muon's steps have the size that Adam's would have in the mean (Liu et al. 2025), so both share one learning rate.
    There is one group for each model of each kind: a model's matrices, then its other parameters.
    """

    def __init__(self, models: Sequence[nn.Module], lr: float) -> None:
        muon: Any = getattr(torch.optim, "Muon", None)
        if muon is None:
            raise MimicbenchError(f"torch {torch.__version__} has no Muon; install torch 2.9 or later, or choose adam")
        self._parts: tuple[torch.optim.Optimizer, torch.optim.Optimizer] = (
            muon(_groups(models, True), lr=lr, weight_decay=0.0, adjust_lr_fn="match_rms_adamw"),
            torch.optim.Adam(_groups(models, False), lr=lr),
        )
        kinds = [dict(group, kind=kind) for kind, part in enumerate(self._parts) for group in part.param_groups]
        # in the order of the models: who sets rates by model finds a model's two groups side by side
        super().__init__([group for pair in zip(*_halves(kinds), strict=True) for group in pair], {"lr": lr})

    def step(self, closure: Callable[[], float] | None = None) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """One step of both, on the groups and the state that this optimizer has now."""
        assert closure is None, "losses are worked out before"
        for kind, part in enumerate(self._parts):
            # a state that was loaded has brought groups of its own
            part.param_groups = [group for group in self.param_groups if group["kind"] == kind]
            part.state = self.state
            part.step()


def _groups(models: Sequence[nn.Module], matrices: bool) -> list[dict[str, Any]]:
    return [{"params": [p for p in model.parameters() if (p.ndim == 2) is matrices]} for model in models]


def _halves(values: list[dict[str, Any]]) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    return values[: len(values) // 2], values[len(values) // 2 :]
