"""The first loss of stability over the factor of a gain, of many families of loops side by side."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.linearisation import Linearisation
from graspfx.certificate.certificate import is_stable
from graspfx.certificate.crossing import bracketed, crossings
from graspfx.certificate.gain_reach import BEYOND, FACTORS_ABOVE, FACTORS_BELOW, ROUNDS, Reach
from graspfx.certificate.late_loss import late_reaches
from graspfx.certificate.whole_loop import Family, Stiffness, WholeLoop

FloatArray = NDArray[np.float64]

BATCH = 2  # of factors that are looked at together, upwards until one is not stable
ANOTHER = 1e-7  # above 1 there: |z| of a root that has crossed earlier


@dataclass
class _Search:
    """The search of one family: factors yet to look at, the last stable one, the first that is not, the edge between.

    `roots` are those farthest out, by factor; `beyond` is that of a factor just above the edge.
    """

    family: Family
    factors: list[float]
    from_below: bool = False
    before: float | None = None
    lost: float | None = None
    edge: float | None = None
    beyond: complex | None = None
    roots: dict[float, complex] = field(default_factory=dict)

    def upcoming(self) -> list[float]:
        """Give the factors to look at now; none where the search is over."""
        if self.lost is not None:
            return []
        return self.factors[:BATCH]

    def take(self, factors: Sequence[float], roots: Sequence[complex]) -> None:
        """Take the farthest roots of these factors into account."""
        self.factors = self.factors[len(factors) :]
        for s, z in zip(factors, roots, strict=True):
            self.roots[s] = z
            if is_stable(abs(z)):
                self.before = s
            elif self.before is not None:
                self.lost = s
                return
            elif not self.from_below:  # the present gain is not stable
                self.from_below, self.factors = True, list(FACTORS_BELOW)
                return

    @property
    def reach(self) -> Reach:
        """The answer, once the search is over."""
        if self.edge is None or self.beyond is None:
            return Reach(0.0 if self.before is None else math.inf, math.nan)
        return Reach(self.edge, abs(float(np.angle(self.beyond))) / (2 * math.pi * self.family.period))


def reach(linear: Linearisation | WholeLoop, stiffness: Stiffness) -> Reach:
    """Find the first loss of stability above the present gain, or, where that is unstable, above the first stable one.

    Args:
        linear: with s = 1.
        stiffness: K(s).
    """
    return reaches([Family(linear, stiffness)])[0]


def reaches(families: Sequence[Family]) -> list[Reach]:
    """Find the reach of each family, as `reach` does; those of as many states share their eigenproblems."""
    return [reach for [reach] in least_reaches([[family] for family in families])]


def least_reaches(groups: Sequence[Sequence[Family]]) -> list[list[Reach]]:
    """Find the reach of each family in groups of which the least one counts.

    A family that is stable up to a factor beyond which another of its group is not has a larger reach: its search ends
    there, and it is told as inf.
    """
    if any(family.late for group in groups for family in group):
        return [late_reaches(group) for group in groups]
    searches = [[_Search(family, list(FACTORS_ABOVE)) for family in group] for group in groups]
    each = [search for group in searches for search in group]
    while some := [(search, factors) for search in each if (factors := search.upcoming())]:
        roots = farthest([(search.family, factors) for search, factors in some])
        for (search, factors), worst in zip(some, roots, strict=True):
            search.take(factors, worst)
        for group in searches:
            _drop_larger(group)
    _find_edges([search for search in each if search.lost is not None])
    return [[search.reach for search in group] for group in searches]


def _drop_larger(group: Sequence[_Search]) -> None:
    """End the searches of a group that are stable where another one is not."""
    least = min((search.lost for search in group if search.lost is not None), default=math.inf)
    for search in group:
        if search.before is not None and not search.from_below and search.before >= least:
            search.factors, search.lost = [], None


def farthest(families: Sequence[tuple[Family, Sequence[float]]]) -> list[list[complex]]:
    """Find the eigenvalue of largest |z| of each family for each of its factors; matrices of one size go together."""
    stacks: defaultdict[int, list[FloatArray]] = defaultdict(list)
    places: defaultdict[int, list[tuple[int, int]]] = defaultdict(list)
    worst: list[list[complex]] = [[0j] * len(factors) for _, factors in families]
    for k, (family, factors) in enumerate(families):
        for A in family.matrices(factors):
            stacks[A.shape[-1]].append(A)
            places[A.shape[-1]] += [(k, i) for i in range(len(factors))]
    for size, matrices in stacks.items():
        if not size:
            continue
        z = np.linalg.eigvals(np.concatenate(matrices))
        far = z[np.arange(len(z)), np.abs(z).argmax(axis=1)].tolist()
        for (k, i), each in zip(places[size], far, strict=True):
            if abs(each) > abs(worst[k][i]):
                worst[k][i] = complex(each)
    return worst


def _find_edges(searches: Sequence[_Search]) -> None:
    """Find where between its last stable factor and the first that is not each search's family loses stability."""
    for search in searches:
        if abs(search.roots[search.before or 0.0]) >= 1.0:
            search.edge = search.before  # on the circle to rounding
    upper = {id(search): (search.lost or 0.0, search.roots[search.lost or 0.0]) for search in searches}
    pending = [search for search in searches if search.edge is None]
    for _ in range(ROUNDS):
        candidates = crossings([(search.family, *upper[id(search)]) for search in pending])
        inside = [
            (search, s)
            for search, s in zip(pending, candidates, strict=True)
            if s is not None and (search.before or 0.0) <= s <= upper[id(search)][0]
        ]
        pending = []
        for (search, s), z in zip(inside, _just_above(inside), strict=True):
            if abs(z) <= 1.0 + ANOTHER:
                search.edge, search.beyond = s, z
            else:
                upper[id(search)] = s * (1.0 + BEYOND), z
                pending.append(search)
        if not pending:
            break
    for search in searches:
        if search.edge is None:
            family = search.family
            search.edge = bracketed(partial(_excess, family), search.before or 0.0, search.lost or 0.0)
    late = [(search, search.edge or 0.0) for search in searches if search.beyond is None]
    for (search, _), z in zip(late, _just_above(late), strict=True):
        search.beyond = z


def _excess(family: Family, s: float) -> float:
    return family.radius(s) - 1.0


def _just_above(searches: Sequence[tuple[_Search, float]]) -> list[complex]:
    """Find the eigenvalue of largest |z| just above a factor of each search."""
    return [z for (z,) in farthest([(search.family, [s * (1.0 + BEYOND)]) for search, s in searches])]
