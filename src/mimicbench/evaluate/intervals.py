"""Rates with their uncertainty. Every rate of this project is k/n with a 95 % Wilson interval."""

from dataclasses import dataclass
from math import sqrt
from statistics import NormalDist
from typing import Any

from mimicbench.core.errors import MimicbenchError


def wilson(k: float, n: int, confidence: float = 0.95) -> tuple[float, float]:
    """Wilson's score interval of a binomial proportion.

    With p = k/n and z the normal quantile: center (p + z^2/2n) / (1 + z^2/n), half-width
    z / (1 + z^2/n) sqrt(p(1-p)/n + z^2/4n^2). Unlike p +- z sqrt(p(1-p)/n) it holds its level for small n and stays
    inside 0..1 at k = 0 and k = n.

    Args:
        k: Successes, 0 <= k <= n. A mean count over several criteria need not be whole.
        n: Trials. Nothing is known of 0 trials: the interval is then (0, 1).
        confidence: Level in (0, 1).

    Returns:
        Lowest and highest plausible rate.
    """
    if not 0 <= k <= n:
        raise MimicbenchError(f"{k} successes out of {n} trials cannot be; check the episode rows")
    if n == 0:
        return 0.0, 1.0
    z = NormalDist().inv_cdf(0.5 + 0.5 * confidence)
    p = k / n
    shrink = 1.0 + z * z / n
    center = (p + z * z / (2 * n)) / shrink
    half = z / shrink * sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    # exact ends, where rounding would leave 1e-17
    return (0.0 if k == 0 else max(0.0, center - half)), (1.0 if k == n else min(1.0, center + half))


@dataclass(frozen=True)
class Rate:
    """k successes in n episodes, and what that says of the true rate."""

    successes: float
    """k; whole, except for a mean over the energy limits."""
    episodes: int
    """n."""

    @property
    def rate(self) -> float:
        """k/n, or 0 without episodes."""
        return self.successes / self.episodes if self.episodes else 0.0

    @property
    def low(self) -> float:
        """Lower end of the 95 % Wilson interval."""
        return wilson(self.successes, self.episodes)[0]

    @property
    def high(self) -> float:
        """Upper end of the 95 % Wilson interval."""
        return wilson(self.successes, self.episodes)[1]

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values: successes, episodes, rate, low, high."""
        return {
            "successes": whole(self.successes),
            "episodes": self.episodes,
            "rate": self.rate,
            "low": self.low,
            "high": self.high,
        }

    def percent(self, digits: int = 1) -> str:
        """Such as `91.4 %`, or `-` without episodes."""
        return f"{100 * self.rate:.{digits}f} %" if self.episodes else "-"

    def interval(self, digits: int = 1) -> str:
        """Such as `88.3–93.8`, in percent."""
        return f"{100 * self.low:.{digits}f}–{100 * self.high:.{digits}f}" if self.episodes else "-"

    def counts(self) -> str:
        """Such as `366/400`."""
        return f"{whole(self.successes)}/{self.episodes}"

    def __str__(self) -> str:
        return f"{self.percent()} [{self.interval()}] ({self.counts()})"


def whole(count: float) -> int | float:
    """The count as an int where it is one, so that it prints as 366 and not as 366.0."""
    return int(count) if float(count).is_integer() else float(count)
