"""The worst operator of a box: the least over its corners, points that fill it, and a descent from there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspfx.certificate.judgement import Judgement
from graspfx.certificate.operators.operator_set import OperatorSet
from graspfx.progress import waiting

FloatArray = NDArray[np.float64]
Point = tuple[float, ...]
Judging = Callable[[dict[str, float]], Judgement]
Figure = Callable[[Judgement], float]

POINTS = 16  # that fill the box for each of its ranges
DESCENTS = 2  # from the worst points
STEPS = 30  # of a descent for each range, at most
FINE = 1e-4  # of a range: where a descent ends
BOX_STEP = 0.15  # of a range: the first step of a descent


@dataclass(frozen=True)
class Search:
    """A search for the worst operator.

    Attributes:
        worst: the judgement of least figure.
        point: where in the unit box that is.
        every: all judgements, with the points.
    """

    worst: Judgement
    point: Point
    every: tuple[tuple[Point, Judgement], ...]


def worst_operator(
    operators: OperatorSet, judge: Judging, figure: Figure, starts: Sequence[Point] = (), points: int | None = None
) -> Search:
    """Search the box of a set of operators for the least figure.

    All corners of up to six ranges, the middle, 16 points a range that fill the box, and from the two worst of them a
    descent by Nelder and Mead (1965) within the box. Each operator is judged in full; what lies between is not, so
    that a worse one may hide where the figure dips within less than the points' distance.

    Args:
        operators: the set.
        judge: gives the judgement of values by key.
        figure: of a judgement, the less the worse.
        starts: points that are looked at besides.
        points: that fill the box; 16 for each range if None.
    """
    from scipy.optimize import minimize

    size = len(operators.ranges)
    spread = operators.spread(POINTS * size if points is None else points)
    places = list(dict.fromkeys([*operators.corners(), (0.5,) * size, *spread, *starts]))
    every: dict[Point, Judgement] = {}

    def value(point: FloatArray | Point) -> float:
        place = tuple(float(x) for x in np.clip(point, 0.0, 1.0))
        if place not in every:
            every[place] = judge(operators.values(place))
        return figure(every[place])

    most = len(places) + DESCENTS * STEPS * size
    with waiting("looking for the worst operator", most, "operators", lambda: float(len(every))):
        ranked = sorted(places, key=value)
        for start in apart(ranked)[:DESCENTS]:
            minimize(
                value, start, method="Nelder-Mead", bounds=[(0.0, 1.0)] * size,
                options={
                    "initial_simplex": simplex(start), "maxfev": STEPS * size, "xatol": FINE, "fatol": 1e-6,
                },
            )  # fmt: skip
    point = min(every, key=lambda place: figure(every[place]))
    return Search(every[point], point, tuple(every.items()))


def apart(ranked: Sequence[Point]) -> list[Point]:
    """Select of points, the worst first, those that are no neighbours of a worse one."""
    selection: list[Point] = []
    for place in ranked:
        if all(np.abs(np.subtract(place, other)).max() > 2.0 * BOX_STEP for other in selection):
            selection.append(place)
    return selection


def simplex(start: Point) -> FloatArray:
    """Put a simplex at a point, its edges inwards."""
    corners = np.tile(np.array(start), (len(start) + 1, 1))
    for i, x in enumerate(start):
        corners[i + 1, i] = x - BOX_STEP if x > 0.5 else x + BOX_STEP
    return corners
