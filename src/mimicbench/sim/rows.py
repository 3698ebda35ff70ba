"""Some of the N rows of batched tensors, chosen by a mask, written without asking a GPU what the mask holds.

On the CPU only the chosen rows are worked out. A GPU would have to stop and tell which they are; there all rows are
worked out, and those outside of the mask stay what they were.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class Rows:
    """Rows `ids` (n,) of which those in `mask` (N,) are meant: where values (n, ...) go."""

    mask: Tensor
    """(N,) bool, the rows that are meant."""
    ids: Tensor
    """(n,) int64 the rows that values are given for: those of the mask, or all N."""
    whole: bool
    """Whether `ids` are all N rows, whatever the mask."""

    @staticmethod
    def where(mask: Tensor, whole: bool = False) -> "Rows":
        """The rows in which `mask` (N,) is true; `whole` works them all out and asks nothing of the mask."""
        ids = torch.arange(len(mask), device=mask.device) if whole else mask.nonzero()[:, 0]
        return Rows(mask, ids, whole)

    @staticmethod
    def every(count: int, device: str | torch.device = "cpu") -> "Rows":
        """All of `count` rows."""
        return Rows(torch.ones(count, dtype=torch.bool, device=device), torch.arange(count, device=device), whole=True)

    @staticmethod
    def of(ids: Sequence[int] | Tensor, count: int, device: str | torch.device = "cpu") -> "Rows":
        """Rows `ids` (n,) of `count`, as known by whoever asks."""
        index = torch.as_tensor(ids, dtype=torch.long, device=device)
        mask = torch.zeros(count, dtype=torch.bool, device=device)
        mask[index] = True
        return Rows(mask, index, whole=False)

    def __len__(self) -> int:
        """n, how many rows values are given for."""
        return len(self.ids)

    def put(self, there: Tensor, values: Tensor | float) -> None:
        """Write `values` (n, ...) or one number into the rows of `there` (N, ...), in place."""
        if not self.whole:
            if there.device.type == "cpu":  # as arrays, whose calls cost a fraction of tensors'
                there.numpy()[self.ids.numpy()] = values.numpy() if isinstance(values, Tensor) else values
            else:
                there[self.ids] = values.to(there.dtype) if isinstance(values, Tensor) else values
            return
        mask = self.mask.reshape(-1, *[1] * (there.dim() - 1))
        if isinstance(values, Tensor):
            there.copy_(torch.where(mask, values.to(there.dtype), there))
        else:
            there.masked_fill_(mask, values)
