"""The search for the best point: scipy's optimisers over a set of hands that grows by the worst one of each answer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspfx.certificate.judgement import Judgement
from graspfx.certificate.operator_set import OperatorSet, Search, worst_operator
from graspfx.progress import waiting
from graspfx.tuning.tuning_problem import Point, Problem

FloatArray = NDArray[np.float64]
Hand = dict[str, float]

GRID = 17  # points of one key, looked at before roots are sought
STARTS = 10  # points for each of more keys
ROUNDS = 8  # of hands that are added
MET = 1e-6  # a constraint's slack below zero that counts as met
FINE = 1e-9  # of a range: of a root
WIDEST = 10.0  # slack beyond which more tells a solver nothing
BOX_POINTS = 6  # that fill the operators' box for each of its ranges, round by round
STEP = 1e-4  # of a range: of a difference quotient


@dataclass(frozen=True)
class Answer:
    """The best point that was met.

    Attributes:
        point: of the unit box.
        feasible: whether it meets all constraints in the hands that were looked at.
        hands: the operators that the constraints were held against.
        worst: the last search for the worst operator; None for the scene's own alone.
        rounds: how often a hand was added.
    """

    point: Point
    feasible: bool
    hands: tuple[Hand, ...]
    worst: Search | None
    rounds: int


def search(problem: Problem) -> Answer:
    """Find the best point that meets the constraints in all hands (Blankenship and Falk, 1976).

    The best point for a few hands; the worst hand there, over the whole box of operators; if it violates a constraint
    it joins the few, and again.
    """
    hands: list[Hand] = [{}]
    operators = problem.operators
    if operators is not None:
        hands = [operators.values((0.5,) * len(operators.ranges))]
    point, feasible = _best(problem, hands, None)
    worst: Search | None = None
    rounds = 0
    while operators is not None and rounds < ROUNDS:
        worst = _worst(problem, operators, point)
        violated = problem.least(worst.worst) < -MET
        if not feasible or not violated:
            break
        rounds += 1
        hands += _violators(problem, worst, hands, operators)
        point, feasible = _best(problem, hands, point)
    return Answer(point, feasible, tuple(hands), worst, rounds)


def _worst(problem: Problem, operators: OperatorSet, point: Point) -> Search:
    size = len(operators.ranges)
    return worst_operator(
        operators, lambda hand: problem.judged(point, hand), lambda one: clipped(problem.least(one)),
        points=BOX_POINTS * size,
    )  # fmt: skip


def _violators(problem: Problem, worst: Search, hands: Sequence[Hand], operators: OperatorSet) -> list[Hand]:
    """Give for each constraint that is violated the hand that violates it most."""
    result: list[Hand] = []
    for k in range(len(problem.constraints)):
        slack, point = min((problem.slacks(one)[k], place) for place, one in worst.every)
        hand = operators.values(point)
        if slack < -MET and hand not in hands and hand not in result:
            result.append(hand)
    return result


def clipped(slack: float) -> float:
    """Limit a slack to what a solver can use."""
    return -WIDEST if math.isnan(slack) else min(max(slack, -WIDEST), WIDEST)


def room(problem: Problem, point: Sequence[float] | FloatArray, hands: Sequence[Hand]) -> float:
    """Give the least slack of a point in some hands."""
    return min(clipped(problem.least(problem.judged(point, hand))) for hand in hands)


def height(problem: Problem, point: Sequence[float] | FloatArray, hands: Sequence[Hand]) -> float:
    """Give the least objective of a point in some hands; without a number the least there is."""
    values = [problem.objective_of(problem.judged(point, hand)) for hand in hands[: 1 if problem.is_of_keys else None]]
    return min(-math.inf if math.isnan(each) else each for each in values)


def _best(problem: Problem, hands: Sequence[Hand], before: Point | None) -> tuple[Point, bool]:
    """Find the best point for these hands, and whether it meets the constraints."""
    if len(problem.over) == 1:
        return _best_on_line(problem, hands, before)
    return _best_in_box(problem, hands, before)


def _best_on_line(problem: Problem, hands: Sequence[Hand], before: Point | None) -> tuple[Point, bool]:
    """Look at a grid of one key, then where next to its best point the constraints begin to be violated."""
    from scipy.optimize import brentq, minimize_scalar

    grid = np.linspace(0.0, 1.0, GRID).tolist()
    with waiting("looking along the range", len(grid), "points") as wait:
        rooms = []
        for x in grid:
            rooms.append(room(problem, (x,), hands))
            wait.done += 1
    if max(rooms) < -MET:
        k = int(np.argmax(rooms))
        low, high = grid[max(k - 1, 0)], grid[min(k + 1, GRID - 1)]
        near = minimize_scalar(
            lambda x: -room(problem, (x,), hands), bounds=(low, high), method="bounded", options={"xatol": 1e-5}
        )
        best = float(near.x) if -float(near.fun) > rooms[k] else grid[k]
        if room(problem, (best,), hands) < -MET:
            return (best,), False
        grid, rooms = [*grid[: k + 1], best, *grid[k + 1 :]], [*rooms[: k + 1], 0.0, *rooms[k + 1 :]]
        order = np.argsort(grid)
        grid, rooms = [grid[i] for i in order], [rooms[i] for i in order]
    heights = [height(problem, (x,), hands) if r >= -MET else -math.inf for x, r in zip(grid, rooms, strict=True)]
    k = int(np.argmax(heights))
    ends = []
    for j in (k - 1, k + 1):
        if not 0 <= j < len(grid):
            ends.append(grid[k])
        elif rooms[j] >= -MET:
            ends.append(grid[j])
        else:
            low, high = min(grid[k], grid[j]), max(grid[k], grid[j])
            edge = float(brentq(lambda x: room(problem, (x,), hands), low, high, xtol=FINE, rtol=1e-12))
            ends.append(_inside(problem, hands, edge, grid[k]))
    candidates = [grid[k], *ends]
    if not problem.is_of_keys and ends[1] > ends[0]:
        top = minimize_scalar(
            lambda x: -height(problem, (x,), hands), bounds=tuple(ends), method="bounded", options={"xatol": 1e-6}
        )
        candidates.append(float(top.x))
    feasible = [x for x in candidates if room(problem, (x,), hands) >= -MET]
    return (max(feasible, key=lambda x: height(problem, (x,), hands)),), True


def _inside(problem: Problem, hands: Sequence[Hand], edge: float, inner: float) -> float:
    """Step from a root inwards until the constraints are met."""
    step = FINE
    while room(problem, (edge,), hands) < -MET and step < abs(edge - inner):
        edge += math.copysign(step, inner - edge)
        step *= 4.0
    return edge


def _best_in_box(problem: Problem, hands: Sequence[Hand], before: Point | None) -> tuple[Point, bool]:
    """Look at points that fill the box, then descend from the best by sequential quadratic programming."""
    size = len(problem.over)
    box = OperatorSet(problem.over, "")
    own = problem.point({each.key: _own(problem, each.key) for each in problem.over})
    places = [own, *([before] if before is not None else box.spread(STARTS * size))]
    with waiting("looking at the box", len(places), "points") as wait:
        ranked = []
        for place in places:
            slack = room(problem, place, hands)
            good = height(problem, place, hands) if slack >= -MET else -math.inf
            ranked.append((slack >= -MET, good if slack >= -MET else slack, place))
            wait.done += 1
    ranked.sort(reverse=True)
    starts = [place for _, _, place in ranked[:2]]
    best: tuple[bool, float, Point] = ranked[0]
    for start in starts:
        for place in _descended(problem, hands, start):
            slack = room(problem, place, hands)
            entry = (slack >= -MET, height(problem, place, hands) if slack >= -MET else slack, place)
            best = max(best, entry)
    if best[0]:
        best = max(best, _pushed_out(problem, hands, best[2]))
    return best[2], best[0]


def _own(problem: Problem, key: str) -> float:
    from graspfx.assembly.live import value_of

    value = value_of(problem.scene, key)
    return float(value) if isinstance(value, int | float) else 0.0


def _descended(problem: Problem, hands: Sequence[Hand], start: Point) -> list[Point]:
    """Maximise t with t below the objective of every hand, all slacks above zero (SLSQP, Kraft 1988)."""
    from scipy.optimize import Bounds, NonlinearConstraint, minimize

    size = len(start)
    modes = list(dict.fromkeys(row.limit.mode for hand in hands for row in problem.judged(start, hand).limits))
    scale = max(abs(height(problem, start, hands)), 1e-9)

    def rows(x: FloatArray) -> FloatArray:
        values: list[float] = []
        for hand in hands:
            one = problem.judged(x[:size], hand)
            values += [clipped(each) for each in problem.smooth_slacks(one, modes)]
            if not problem.is_of_keys:
                values.append(clipped(problem.objective_of(one) / scale - x[size]))
        return np.array(values)

    def cost(x: FloatArray) -> float:
        return -height(problem, x[:size], hands[:1]) / scale if problem.is_of_keys else -float(x[size])

    first = np.array(start if problem.is_of_keys else [*start, height(problem, start, hands) / scale])
    least, most = np.zeros(len(first)), np.ones(len(first))
    least[size:], most[size:] = -np.inf, np.inf
    result = minimize(
        cost, first, method="SLSQP", bounds=Bounds(least, most),
        constraints=[NonlinearConstraint(rows, 0.0, np.inf)], options={"maxiter": 40, "ftol": 1e-8, "eps": STEP},
    )  # fmt: skip
    end = tuple(float(x) for x in np.clip(result.x[:size], 0.0, 1.0))
    if room(problem, end, hands) >= -MET:
        return [end]
    # a step back towards where it came from
    return [end, *_between(problem, hands, start, end)]


def _between(problem: Problem, hands: Sequence[Hand], inner: Point, outer: Point) -> list[Point]:
    """Find where on the way from a point that meets the constraints to one that does not they begin to be violated."""
    from scipy.optimize import brentq

    if room(problem, inner, hands) < 0.0:
        return []
    a, b = np.array(inner), np.array(outer)
    edge = float(brentq(lambda s: room(problem, a + s * (b - a), hands), 0.0, 1.0, xtol=FINE, rtol=1e-12))
    return [tuple(float(x) for x in a + s * (b - a)) for s in (edge, max(edge - 1e-7, 0.0))]


def _pushed_out(problem: Problem, hands: Sequence[Hand], point: Point) -> tuple[bool, float, Point]:
    """Push each key in turn as far as the objective rises and the constraints hold."""
    best = (True, height(problem, point, hands), point)
    for i in [*range(len(point))] * 2:
        for way in (1.0, -1.0):
            step = 0.02
            while step > 1e-8:
                trial = list(best[2])
                trial[i] = min(max(trial[i] + way * step, 0.0), 1.0)
                place = tuple(trial)
                if place == best[2]:
                    break
                if problem.is_of_keys and height(problem, place, hands) <= best[1]:
                    break
                slack = room(problem, place, hands)
                value = height(problem, place, hands)
                if slack >= -MET and value > best[1]:
                    best = (True, value, place)
                else:
                    step /= 4.0
    return best


def judgements(problem: Problem, point: Sequence[float] | FloatArray, hands: Sequence[Hand]) -> list[Judgement]:
    """Give the judgements of a point in some hands."""
    return [problem.judged(point, hand) for hand in hands]
