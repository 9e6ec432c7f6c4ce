"""Tuning problems, and the search for their optimum with SciPy, for a set of worst-case operators.

A hand is a set of values of the operator's parameters. A point is a vector of the values of the keys that change,
scaled to the unit box.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.live import value_of
from graspfx.certificate.judgement import Judge, Judgement
from graspfx.certificate.operator_set import (
    FORM,
    OperatorRange,
    OperatorSet,
    Ranges,
    Search,
    range_of,
    worst_operator,
)
from graspfx.errors import InputError
from graspfx.progress import waiting
from graspfx.scene.model import Scene
from graspfx.tuning.formulas import GAINS, MEASURES, Constraint, Expression, key_of, numbers_of

FloatArray = NDArray[np.float64]
Hand = dict[str, float]
Point = tuple[float, ...]
Ranked = tuple[bool, float, Point]  # whether it satisfies the constraints, the objective or else the slack, the point

WIDE = 100.0  # a gain's default range: its value divided by and multiplied by this
MOST_KEYS = 12
PUSHING = "margin.pushing"

GRID = 17  # points of a grid over one key, before roots are sought
STARTS = 10  # samples of the box per key, for several keys
ROUNDS = 8  # largest number of rounds that add hands
MET = 1e-6  # tolerance of a constraint's slack below zero
FINE = 1e-9  # tolerance of a root, relative to a range
WIDEST = 10.0  # largest slack, to which larger ones are clipped because they do not guide a solver
BOX_POINTS = 6  # points per range and round that sample the operators' box
STEP = 1e-4  # step of a difference quotient, relative to a range


class Problem:
    """A tuning problem, with a cache of judgements.

    Args:
        scene: Scene whose gains change.
        objective: Formula to maximise.
        constraints: Constraints that must hold for every operator.
        over: Ranges of the keys that may change. If None, the keys in the objective, or both stiffnesses if the
            objective contains no keys, have default ranges.
        operators: Set of operators; None for the scene's own operator.
    """

    def __init__(
        self,
        scene: Scene,
        objective: Expression,
        constraints: Sequence[Constraint],
        over: Ranges | None,
        operators: OperatorSet | None,
    ) -> None:
        self.scene, self.objective, self.constraints, self.operators = scene, objective, tuple(constraints), operators
        names = dict.fromkeys([*objective.names, *(name for each in constraints for name in each.names)])
        self.keys = {name: key_of(scene, name) for name in names}
        self.over = tuple(_ranges(scene, objective, over, self.keys))
        shared = {each.key for each in self.over} & set(operators.keys if operators is not None else ())
        if shared:
            raise InputError("over", sorted(shared)[0], "a key that does not vary with the operator")
        self._judge = Judge(scene, grips=True)
        self.session = self._judge.session
        self._needs_pushing = PUSHING in self.keys
        self._memory: dict[tuple[tuple[str, float], ...], Judgement] = {}

    @property
    def count(self) -> int:
        """Number of judgements that have been computed."""
        return self._judge.count

    @property
    def is_of_keys(self) -> bool:
        """Whether all names in the objective are keys that change, so that its value does not depend on the hand."""
        changing = {each.key for each in self.over}
        return all(self.keys[name] in changing for name in self.objective.names) and bool(self.objective.names)

    def values(self, point: Sequence[float] | FloatArray) -> dict[str, float]:
        """Return the value of each key at a point of the unit box."""
        pairs = zip(self.over, np.clip(point, 0.0, 1.0).tolist(), strict=True)
        return {each.key: float(each.between(share)) for each, share in pairs}

    def point(self, values: Mapping[str, float]) -> Point:
        """Return the point of the unit box for values of the keys; values outside their ranges are clipped."""
        shares = []
        for each in self.over:
            low, high, value = each.low, each.high, float(values[each.key])
            if each.is_logarithmic:
                low, high, value = math.log(low), math.log(high), math.log(max(value, 1e-300))
            shares.append(min(max((value - low) / (high - low), 0.0), 1.0))
        return tuple(shares)

    def judged(self, point: Sequence[float] | FloatArray, hand: Mapping[str, float]) -> Judgement:
        """Judge the scene at a point of the unit box for a hand; results are cached."""
        return self.judged_with(self.values(point), hand)

    def judged_with(self, values: Mapping[str, float], hand: Mapping[str, float]) -> Judgement:
        """Judge the scene for values of the keys, which may be outside their ranges, and a hand; results are cached."""
        whole = {**values, **hand}
        entry = tuple(sorted(whole.items()))
        if entry not in self._memory:
            self._memory[entry] = self._judge.judge(whole, pushing=self._needs_pushing)
        return self._memory[entry]

    def slacks(self, one: Judgement) -> list[float]:
        """Return the slack of each constraint in a judgement (`Constraint.slack`)."""
        numbers = numbers_of(self.keys, one)
        return [each.slack(numbers) for each in self.constraints]

    def least(self, one: Judgement) -> float:
        """Return the smallest slack of a constraint in a judgement."""
        return min(self.slacks(one), default=math.inf)

    def smooth_slacks(self, one: Judgement, modes: Sequence[str]) -> Iterator[float]:
        """Yield slacks that are smoother functions of the point than those of `slacks`.

        A constraint on `margin`, which is the minimum over all modes, is replaced by a constraint for each mode.
        """
        numbers = numbers_of(self.keys, one)
        for each in self.constraints:
            if "margin" in each.names and one.stable:
                for mode in modes:
                    yield each.slack(numbers | {"margin": one.margin_of(mode)})
            else:
                yield from [each.slack(numbers)] * (len(modes) if "margin" in each.names else 1)

    def objective_of(self, one: Judgement) -> float:
        """Return the value of the objective for a judgement."""
        return self.objective.value(numbers_of(self.keys, one))


def _ranges(scene: Scene, objective: Expression, over: Any, keys: Mapping[str, str | None]) -> Iterator[OperatorRange]:
    """Yield the ranges of the keys that may change, from the argument `over`."""
    if over is None:
        own = [key for key in dict.fromkeys(keys[name] for name in objective.names) if key is not None]
        for key in own or [GAINS["external.stiffness"], GAINS["internal.stiffness"]]:
            yield _wide(scene, key)
        return
    if isinstance(over, str) or not isinstance(over, Mapping | Sequence) or not 1 <= len(over) <= MOST_KEYS:
        raise InputError("over", over, f"ranges of 1 to {MOST_KEYS} keys", f"as {FORM}")
    if isinstance(over, Mapping):
        ranges = [range_of(name, value) for name, value in over.items()]
    else:
        ranges = [each if isinstance(each, OperatorRange) else OperatorRange.read(each, "--over") for each in over]
    for each in ranges:
        yield replace(each, key=_key(scene, each.key))


def _key(scene: Scene, name: str) -> str:
    key = key_of(scene, name)
    if key is None:
        raise InputError("over", name, "a key of the scene", f"{name} is a measure: {MEASURES[name].formula}")
    return key


def _wide(scene: Scene, key: str) -> OperatorRange:
    value = value_of(scene, key)
    if not value > 0.0:
        do = f"the value {value} has no default range, because it is not positive"
        raise InputError("over", key, "a range, KEY=FROM:TO", do)
    return OperatorRange(key, value / WIDE, value * WIDE)


@dataclass(frozen=True)
class Answer:
    """Result of a search.

    Attributes:
        point: Best point in the unit box.
        feasible: Whether the point satisfies all constraints for all `hands`.
        hands: Hands for which the constraints were imposed.
        worst: Result of the last search for the worst hand; None for the scene's own operator.
        rounds: Number of rounds that added hands.
    """

    point: Point
    feasible: bool
    hands: tuple[Hand, ...]
    worst: Search | None
    rounds: int


def search(problem: Problem) -> Answer:
    """Find the best point that satisfies the constraints for all hands (Blankenship and Falk, 1976).

    Each round finds the best point for a finite set of hands, and then the worst hand for this point among all
    operators. If the worst hand violates a constraint, the worst hand for each violated constraint is added to the set.
    The search ends when no hand violates a constraint, or after `ROUNDS` rounds.
    """
    hands: list[Hand] = [{}]
    operators = problem.operators
    if operators is not None:
        hands = [operators.values((0.5,) * len(operators.ranges))]
    point, feasible = Subproblem(problem, hands).best(None)
    worst: Search | None = None
    rounds = 0
    while operators is not None and rounds < ROUNDS:
        worst = _worst(problem, operators, point)
        violated = problem.least(worst.worst) < -MET
        if not feasible or not violated:
            break
        rounds += 1
        hands += _violators(problem, worst, hands, operators)
        point, feasible = Subproblem(problem, hands).best(point)
    return Answer(point, feasible, tuple(hands), worst, rounds)


def _worst(problem: Problem, operators: OperatorSet, point: Point) -> Search:
    size = len(operators.ranges)
    return worst_operator(
        operators, lambda hand: problem.judged(point, hand), lambda one: clipped(problem.least(one)),
        points=BOX_POINTS * size,
    )  # fmt: skip


def _violators(problem: Problem, worst: Search, hands: Sequence[Hand], operators: OperatorSet) -> list[Hand]:
    """Return, for each violated constraint, the new hand that violates this constraint most."""
    result: list[Hand] = []
    for k in range(len(problem.constraints)):
        slack, point = min((problem.slacks(one)[k], place) for place, one in worst.every)
        hand = operators.values(point)
        if slack < -MET and hand not in hands and hand not in result:
            result.append(hand)
    return result


def clipped(slack: float) -> float:
    """Clip a slack to the range from -`WIDEST` to `WIDEST`; return -`WIDEST` for NaN."""
    return -WIDEST if math.isnan(slack) else min(max(slack, -WIDEST), WIDEST)


class Subproblem:
    """A tuning problem with constraints for a finite set of hands.

    Args:
        problem: Tuning problem for all hands.
        hands: Hands in which the constraints must hold.
    """

    def __init__(self, problem: Problem, hands: Sequence[Hand]) -> None:
        self.problem, self.hands = problem, hands

    def room(self, point: Sequence[float] | FloatArray) -> float:
        """Return the smallest slack at a point, over all constraints and hands."""
        return min(clipped(self.problem.least(self.problem.judged(point, hand))) for hand in self.hands)

    def height(self, point: Sequence[float] | FloatArray) -> float:
        """Return the smallest objective at a point over all hands; -inf if an objective is NaN."""
        problem, hands = self.problem, self.hands[: 1 if self.problem.is_of_keys else None]
        values = [problem.objective_of(problem.judged(point, hand)) for hand in hands]
        return min(-math.inf if math.isnan(each) else each for each in values)

    def ranked(self, point: Point) -> Ranked:
        """Return a tuple by which points are compared.

        It contains whether the point satisfies the constraints; the objective if it does, and otherwise the smallest
        slack; and the point.
        """
        slack = self.room(point)
        return (True, self.height(point), point) if slack >= -MET else (False, slack, point)

    def best(self, before: Point | None) -> tuple[Point, bool]:
        """Return the best point, and whether this point satisfies the constraints.

        Args:
            before: Best point of the previous round, at which the search starts; None in the first round.
        """
        return self._best_on_line() if len(self.problem.over) == 1 else self._best_in_box(before)

    def _best_on_line(self) -> tuple[Point, bool]:
        """Find the best point for one key: evaluate a grid, then search next to the best point of the grid."""
        from scipy.optimize import brentq, minimize_scalar

        grid = np.linspace(0.0, 1.0, GRID).tolist()
        with waiting("searching the range", len(grid), "points") as wait:
            rooms = []
            for x in grid:
                rooms.append(self.room((x,)))
                wait.done += 1
        if max(rooms) < -MET:
            k = int(np.argmax(rooms))
            beside = grid[max(k - 1, 0)], grid[min(k + 1, GRID - 1)]
            near = minimize_scalar(lambda x: -self.room((x,)), bounds=beside, method="bounded", options={"xatol": 1e-5})
            best = float(near.x) if -float(near.fun) > rooms[k] else grid[k]
            if self.room((best,)) < -MET:
                return (best,), False
            pairs = sorted([*zip(grid, rooms, strict=True), (best, 0.0)])
            grid, rooms = [x for x, _ in pairs], [r for _, r in pairs]
        heights = [self.height((x,)) if r >= -MET else -math.inf for x, r in zip(grid, rooms, strict=True)]
        k = int(np.argmax(heights))
        ends = []
        for j in (k - 1, k + 1):
            if not 0 <= j < len(grid):
                ends.append(grid[k])
            elif rooms[j] >= -MET:
                ends.append(grid[j])
            else:
                low, high = min(grid[k], grid[j]), max(grid[k], grid[j])
                edge = float(brentq(lambda x: self.room((x,)), low, high, xtol=FINE, rtol=1e-12))
                ends.append(self._inside(edge, grid[k]))
        candidates = [grid[k], *ends]
        if not self.problem.is_of_keys and ends[1] > ends[0]:
            top = minimize_scalar(
                lambda x: -self.height((x,)), bounds=tuple(ends), method="bounded", options={"xatol": 1e-6}
            )
            candidates.append(float(top.x))
        feasible = [x for x in candidates if self.room((x,)) >= -MET]
        return (max(feasible, key=lambda x: self.height((x,))),), True

    def _inside(self, edge: float, inner: float) -> float:
        """Move a root `edge` in steps towards the feasible point `inner` until the constraints are satisfied."""
        step = FINE
        while self.room((edge,)) < -MET and step < abs(edge - inner):
            edge += math.copysign(step, inner - edge)
            step *= 4.0
        return edge

    def _best_in_box(self, before: Point | None) -> tuple[Point, bool]:
        """Find the best point for several keys: sample the box, then optimise from the two best samples."""
        over = self.problem.over
        own = self.problem.point({each.key: _own(self.problem, each.key) for each in over})
        samples = OperatorSet(over, "").spread(STARTS * len(over)) if before is None else [before]
        with waiting("searching the box", 1 + len(samples), "points") as wait:
            ranked = []
            for place in (own, *samples):
                ranked.append(self.ranked(place))
                wait.done += 1
        ranked.sort(reverse=True)
        ends = (place for _, _, start in ranked[:2] for place in self._descended(start))
        best = max([ranked[0], *map(self.ranked, ends)])
        if best[0]:
            best = self._pushed_out(best)
        return best[2], best[0]

    def _descended(self, start: Point) -> list[Point]:
        """Maximise the smallest objective over the hands subject to all constraints, by SLSQP (Kraft 1988).

        Returns:
            Final point of the optimiser; if it violates a constraint, also points on the boundary of the constraints
            between the start and the final point.
        """
        from scipy.optimize import Bounds, NonlinearConstraint, minimize

        problem, size = self.problem, len(start)
        judged = (problem.judged(start, hand) for hand in self.hands)
        modes = list(dict.fromkeys(row.limit.mode for one in judged for row in one.limits))
        scale = max(abs(self.height(start)), 1e-9)

        def rows(x: FloatArray) -> FloatArray:
            values: list[float] = []
            for hand in self.hands:
                one = problem.judged(x[:size], hand)
                values += [clipped(each) for each in problem.smooth_slacks(one, modes)]
                if not problem.is_of_keys:
                    values.append(clipped(problem.objective_of(one) / scale - x[size]))
            return np.array(values)

        def cost(x: FloatArray) -> float:
            return -self.height(x[:size]) / scale if problem.is_of_keys else -float(x[size])

        first = np.array(start if problem.is_of_keys else [*start, self.height(start) / scale])
        least, most = np.zeros(len(first)), np.ones(len(first))
        least[size:], most[size:] = -np.inf, np.inf
        result = minimize(
            cost, first, method="SLSQP", bounds=Bounds(least, most),
            constraints=[NonlinearConstraint(rows, 0.0, np.inf)], options={"maxiter": 40, "ftol": 1e-8, "eps": STEP},
        )  # fmt: skip
        end = tuple(float(x) for x in np.clip(result.x[:size], 0.0, 1.0))
        return [end, *([] if self.room(end) >= -MET else self._between(start, end))]

    def _between(self, inner: Point, outer: Point) -> list[Point]:
        """Find points on the boundary of the constraints between a feasible and an infeasible point.

        Returns:
            The boundary, and a point slightly nearer to the feasible point; empty if `inner` is not feasible.
        """
        from scipy.optimize import brentq

        if self.room(inner) < 0.0:
            return []
        a, b = np.array(inner), np.array(outer)
        edge = float(brentq(lambda s: self.room(a + s * (b - a)), 0.0, 1.0, xtol=FINE, rtol=1e-12))
        return [tuple(float(x) for x in a + s * (b - a)) for s in (edge, max(edge - 1e-7, 0.0))]

    def _pushed_out(self, best: Ranked) -> Ranked:
        """Change one key after another, twice, while the objective increases and the constraints hold."""
        for i in [*range(len(best[2]))] * 2:
            for way in (1.0, -1.0):
                step = 0.02
                while step > 1e-8:
                    trial = list(best[2])
                    trial[i] = min(max(trial[i] + way * step, 0.0), 1.0)
                    place = tuple(trial)
                    if place == best[2] or (self.problem.is_of_keys and self.height(place) <= best[1]):
                        break
                    entry = self.ranked(place)
                    if entry[:2] > best[:2]:
                        best = entry
                    else:
                        step /= 4.0
        return best


def _own(problem: Problem, key: str) -> float:
    value = value_of(problem.scene, key)
    return float(value) if isinstance(value, int | float) else 0.0
