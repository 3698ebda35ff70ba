"""What is kept of worlds that break on Warp until somebody asks, without asking the GPU in every step."""

from collections.abc import Iterator, Sequence

import numpy as np
import torch

from mimicbench.sim.rows import Rows
from mimicbench.sim.warp_kernels import BAD_POSITION, BAD_TARGET, BAD_VELOCITY, OVERFLOW

_REASONS = {
    BAD_POSITION: "positions are not finite, or too large",
    BAD_VELOCITY: "velocities are not finite, or too large",
    BAD_TARGET: "targets are not finite",
    OVERFLOW: "there are more contacts than room for them",
}


class Breaks:
    """The last good states of worlds that broke, and why, until they are told."""

    def __init__(self, broken: torch.Tensor, state: Sequence[torch.Tensor]) -> None:
        """`broken` (N,) marks worlds; `state` is positions, velocities, warmstart, targets and wrenches, (N, ...) each,
        and which object is there, (N,), for a world may be given another until it is told of.
        """
        self._last_good = [array.clone() for array in state]  # before, and of, the steps in which worlds broke
        self._noticed = torch.zeros_like(broken, dtype=torch.bool)
        self._untold = torch.zeros_like(broken)

    def notice(self, broken: torch.Tensor, before: Sequence[torch.Tensor]) -> None:
        """Keep what it takes to tell of worlds that broke in this step, once each."""
        fresh = (broken != 0) & ~self._noticed
        self._noticed |= fresh
        keep = Rows(fresh, torch.empty(0), whole=True)
        for there, value in zip(self._last_good, before, strict=True):
            keep.put(there, value.to(there.device))
        keep.put(self._untold, broken)

    def forget(self, rows: Rows) -> None:
        """Worlds that were reset may break anew."""
        rows.put(self._noticed, False)

    def taken(self) -> Iterator[tuple[int, str, list[np.ndarray]]]:
        """Each world that broke and was not told of yet, the reason, and its last good state."""
        for env in (self._untold != 0).nonzero()[:, 0].tolist():
            found = int(self._untold[env])
            reason = " and ".join(told for bit, told in _REASONS.items() if found & bit)
            yield env, reason, [array[env].double().cpu().numpy().copy() for array in self._last_good]
        self._untold.zero_()
