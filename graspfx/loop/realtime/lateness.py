"""Lateness of ticks, counted in bins of a microsecond: no memory grows, however long a run is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate

BINS = 4096  # of a microsecond each; the last one has all that is later
SHARES = {"p50": 0.5, "p99": 0.99, "p99.9": 0.999}


class Lateness:
    """A histogram of how late ticks began after their deadlines."""

    def __init__(self) -> None:
        self.counts = [0] * BINS
        self.most = 0.0  # [s]

    def add(self, late: float) -> None:
        """Count a tick that began so late [s]."""
        self.counts[min(max(int(1e6 * late), 0), BINS - 1)] += 1
        if late > self.most:
            self.most = late

    def merge(self, counts: Sequence[int], most: float) -> None:
        """Add the counts of another histogram, and its latest [s]."""
        self.counts = [one + other for one, other in zip(self.counts, counts, strict=True)]
        self.most = max(self.most, most)

    @property
    def figures(self) -> Mapping[str, float]:
        """Quantiles and the most [s], by name; nothing before the first tick.

        A quantile that lies beyond the bins is the most.
        """
        sums = list(accumulate(self.counts))
        if not sums[-1]:
            return {}
        bins = {name: next(i for i, n in enumerate(sums) if n >= share * sums[-1]) for name, share in SHARES.items()}
        values = {name: min(1e-6 * (i + 1), self.most) if i < BINS - 1 else self.most for name, i in bins.items()}
        return {**values, "max": self.most}
