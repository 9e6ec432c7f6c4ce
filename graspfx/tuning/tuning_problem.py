"""A problem of tuning: what is to be large, what has to hold, which keys may change, in whose hands."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.live import value_of
from graspfx.certificate.judgement import Judge, Judgement
from graspfx.certificate.operator_set import FORM, OperatorRange, OperatorSet, Ranges, range_of
from graspfx.errors import InputError
from graspfx.scene.model import Scene
from graspfx.tuning.formulas import Constraint, Expression
from graspfx.tuning.tuning_measures import GAINS, MEASURES, key_of, numbers_of

FloatArray = NDArray[np.float64]
Point = tuple[float, ...]

WIDE = 100.0  # times a gain's value, and one part in as many: where it is looked for
MOST_KEYS = 12
PUSHING = "margin.pushing"
LEAST_ROOM = 0.999999  # of what binds, as solvers leave it


class Problem:
    """A problem of tuning, and a memory of judgements.

    Args:
        scene: whose gains change.
        objective: what is to be as large as possible.
        constraints: what has to hold, in every hand.
        over: ranges of the keys that may change; those of the objective's keys if None.
        operators: the set of operators; None for the scene's own.
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
            raise InputError("over", sorted(shared)[0], "a key that no operator varies")
        self._judge = Judge(scene, grips=True)
        self.session = self._judge.session
        self._needs_pushing = PUSHING in self.keys
        self._memory: dict[tuple[tuple[str, float], ...], Judgement] = {}

    @property
    def count(self) -> int:
        """Number of judgements that were made."""
        return self._judge.count

    @property
    def is_of_keys(self) -> bool:
        """Whether the objective is of keys that change, and of nothing that has to be judged."""
        changing = {each.key for each in self.over}
        return all(self.keys[name] in changing for name in self.objective.names) and bool(self.objective.names)

    def values(self, point: Sequence[float] | FloatArray) -> dict[str, float]:
        """Give the values by key at a point of the unit box."""
        pairs = zip(self.over, np.clip(point, 0.0, 1.0).tolist(), strict=True)
        return {each.key: float(each.between(share)) for each, share in pairs}

    def point(self, values: Mapping[str, float]) -> Point:
        """Give the point of the unit box where keys have these values, or the nearest."""
        shares = []
        for each in self.over:
            low, high, value = each.low, each.high, float(values[each.key])
            if each.is_logarithmic:
                low, high, value = math.log(low), math.log(high), math.log(max(value, 1e-300))
            shares.append(min(max((value - low) / (high - low), 0.0), 1.0))
        return tuple(shares)

    def judged(self, point: Sequence[float] | FloatArray, hand: Mapping[str, float]) -> Judgement:
        """Judge the scene at a point in an operator's hand, once."""
        return self.judged_with(self.values(point), hand)

    def judged_with(self, values: Mapping[str, float], hand: Mapping[str, float]) -> Judgement:
        """Judge the scene with these values, which may be outside of the box, in an operator's hand, once."""
        whole = {**values, **hand}
        entry = tuple(sorted(whole.items()))
        if entry not in self._memory:
            self._memory[entry] = self._judge.judge(whole, pushing=self._needs_pushing)
        return self._memory[entry]

    def slacks(self, one: Judgement) -> list[float]:
        """Give by how much each constraint is met in a judgement, over its bound; less than zero where it is not."""
        numbers = numbers_of(self.keys, one)
        return [each.slack(numbers) for each in self.constraints]

    def least(self, one: Judgement) -> float:
        """Give the least slack of a judgement."""
        return min(self.slacks(one), default=math.inf)

    def smooth_slacks(self, one: Judgement, modes: Sequence[str]) -> Iterator[float]:
        """Give the slacks, of constraints on the least margin one for each mode: smoother than their least."""
        numbers = numbers_of(self.keys, one)
        for each in self.constraints:
            if "margin" in each.names and one.stable:
                for mode in modes:
                    yield each.slack(numbers | {"margin": one.margin_of(mode)})
            else:
                yield from [each.slack(numbers)] * (len(modes) if "margin" in each.names else 1)

    def objective_of(self, one: Judgement) -> float:
        """Give the objective's value in a judgement."""
        return self.objective.value(numbers_of(self.keys, one))


def _ranges(scene: Scene, objective: Expression, over: Any, keys: Mapping[str, str | None]) -> Iterator[OperatorRange]:
    """Read the ranges of the keys that may change."""
    if over is None:
        own = [key for key in dict.fromkeys(keys[name] for name in objective.names) if key is not None]
        for key in own or [GAINS["external.stiffness"], GAINS["internal.stiffness"]]:
            yield _wide(scene, key)
        return
    if isinstance(over, str) or not isinstance(over, Mapping | Sequence) or not 1 <= len(over) <= MOST_KEYS:
        raise InputError("over", over, f"ranges of from 1 to {MOST_KEYS} keys", f"as {FORM}")
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
        raise InputError("over", key, "a range, KEY=FROM:TO", f"the scene's own value is {value}, which tells no size")
    return OperatorRange(key, value / WIDE, value * WIDE)
