"""The share of a population with a property, from a sample: its confidence interval, and what none found says."""

from __future__ import annotations

from dataclasses import dataclass

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Share:
    """The share of a population that has a property, by a random sample.

    Attributes:
        count: of those that have it.
        total: of the sample.
        low, high: the interval of Clopper and Pearson (1934), which holds the share with 95 % confidence or more.
    """

    count: int
    total: int
    low: float
    high: float

    @property
    def value(self) -> float:
        """The share in the sample."""
        return self.count / self.total

    @property
    def text(self) -> str:
        """The share and its interval in per cent."""
        return f"{100 * self.value:.3g} % (95 % confidence: {100 * self.low:.3g} to {100 * self.high:.3g} %)"


def share_of(count: int, total: int) -> Share:
    """Give the share and its interval: ends at which the sample's count has a tail of 2.5 % of the binomial law."""
    from scipy.special import betaincinv

    tail = (1.0 - CONFIDENCE) / 2.0
    low = 0.0 if count == 0 else float(betaincinv(count, total - count + 1, tail))
    high = 1.0 if count == total else float(betaincinv(count + 1, total - count, 1.0 - tail))
    return Share(count, total, low, high)
