"""The first loss of stability of a loop with a reaction too late for a state for each sample of it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from graspfx.analysis.stability.late_roots import root_at, root_near
from graspfx.certificate.crossing import NEAREST, bracketed
from graspfx.certificate.gain_reach import BEYOND, FACTORS_ABOVE, FACTORS_BELOW, Reach
from graspfx.certificate.whole_loop import Family

NARROW = 1e-3  # relative width of a bracket in which an eigenvalue is followed
FARTHEST = 0.05  # that it moves there


def late_reaches(families: Sequence[Family]) -> list[Reach]:
    """Find the reach of each family of a group of which the least one counts; larger ones may be told as inf.

    Factors as of other reaches, each by counting the eigenvalues beyond the circle; then the one that leaves it.
    """
    answers: list[Reach] = []
    for family in families:
        least = min((each.factor for each in answers if not math.isnan(each.frequency)), default=math.inf)
        answers.append(_reach(family, least))
    return answers


def _reach(family: Family, most: float) -> Reach:
    before: float | None = None
    for s in FACTORS_BELOW if family.unstable(1.0) else FACTORS_ABOVE:
        if before is not None and before >= most:
            break
        if not family.unstable(s):
            before = s
        elif before is not None:
            edge, z = _edge(family, before, s)
            return Reach(edge, abs(float(np.angle(z))) / (2 * math.pi * family.period))
    return Reach(0.0 if before is None else math.inf, math.nan)


def _edge(family: Family, before: float, lost: float) -> tuple[float, complex]:
    """Find where a late family loses stability, and the eigenvalue there.

    The bracket is halved by counting; when it is narrow, the eigenvalue next to the circle is followed onto it, and
    counting just below and just above tells whether it was the first. Where it was not, halving goes on.
    """
    low, high = _halved(family, before, lost, NARROW)
    crossing = _crossing(family, low, high)
    if crossing is not None:
        below, above = crossing[0] * (1.0 - BEYOND), crossing[0] * (1.0 + BEYOND)
        if (below <= low or not family.unstable(below)) and (above >= high or family.unstable(above)):
            return crossing
    low, high = _halved(family, low, high, NEAREST)
    return high, family.farthest(high * (1.0 + BEYOND))


def _halved(family: Family, low: float, high: float, width: float) -> tuple[float, float]:
    while high - low > width * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if family.unstable(middle) else (middle, high)
    return low, high


def _crossing(family: Family, low: float, high: float) -> tuple[float, complex] | None:
    """Find the factor at which an eigenvalue that is beyond the circle at `high` is on it; None where it gets lost."""
    part = next(part for part in family.loop.parts if family.unstable_of(part, high))
    if not part.late:
        edge = bracketed(lambda s: abs(family.farthest_of(part, s)) - 1.0, low, high)
        return edge, family.farthest_of(part, edge)
    at = root_at(part.late_loop(family.stiffness(high)), 1.0)
    if at is None or abs(at) <= 1.0:
        return None
    roots = {high: at}

    def excess(s: float) -> float:
        if s not in roots:
            start = roots[min(roots, key=lambda each: abs(each - s))]
            roots[s] = root_near(part.late_loop(family.stiffness(s)), start) or 0j
        return abs(roots[s]) - 1.0

    if not -FARTHEST <= excess(low) <= 0.0:
        return None
    edge = bracketed(excess, low, high)
    return edge, roots[edge]
