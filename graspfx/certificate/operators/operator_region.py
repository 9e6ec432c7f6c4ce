"""The margin of a scene over one or two keys of its operators: the region of hands in which it is stable."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.certificate.judgement import Judge
from graspfx.certificate.operators.operator_range import OperatorRange
from graspfx.certificate.operators.operator_set import OperatorSet
from graspfx.certificate.plain_data import plain
from graspfx.errors import InputError, UnknownNameError
from graspfx.progress import waiting
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]

MOST_POINTS = 200


@dataclass(frozen=True, eq=False)
class OperatorRegion:
    """Margins over one or two keys of a set of operators, the others as in the scene.

    Attributes:
        ranges: one or two, evenly divided as their laws spread them.
        values: of each range, (n,).
        margin: the least of all modes at each point, (n,) or (n1, n2); less than 1 where the loop is not stable.
        stable: whether it is, in the same shape.
    """

    ranges: tuple[OperatorRange, ...]
    values: tuple[FloatArray, ...]
    margin: FloatArray
    stable: NDArray[np.bool_]

    def to_dict(self) -> dict[str, Any]:
        """Write plain data for JSON."""
        return {
            "keys": [each.key for each in self.ranges],
            "values": [each.tolist() for each in self.values],
            "margin": plain(self.margin),
            "stable": self.stable.tolist(),
        }


def operator_region(
    scene: Scene, operators: OperatorSet, keys: tuple[str, ...] | None = None, points: int = 24
) -> OperatorRegion:
    """Judge a grid over one or two of the ranges; of a set with one range, or one key, a line.

    Raises:
        InputError: another number of keys, or of points.
        UnknownNameError: a key that is not in the set.
    """
    if not 2 <= points <= MOST_POINTS:
        raise InputError("points", points, f"from 2 to {MOST_POINTS}")
    by_key = {each.key: each for each in operators.ranges}
    selection = operators.keys[:2] if keys is None else tuple(keys)
    if not 1 <= len(set(selection)) == len(selection) <= 2:
        raise InputError("keys", keys, "one or two different keys of the set")
    for key in selection:
        if key not in by_key:
            raise UnknownNameError("key of the operators", key, by_key)
    ranges = tuple(by_key[key] for key in selection)
    values = tuple(each.between(np.linspace(0.0, 1.0, points)) for each in ranges)
    shape = (points,) * len(ranges)
    margin, stable = np.zeros(shape), np.zeros(shape, dtype=bool)
    judge = Judge(scene)
    with judge.session(), waiting(f"judging hands over {' and '.join(selection)}", margin.size, "hands") as wait:
        for place in np.ndindex(*shape):
            one = judge.judge({key: float(x[i]) for key, x, i in zip(selection, values, place, strict=True)})
            margin[place], stable[place] = one.margin, one.stable
            wait.done += 1
    return OperatorRegion(ranges, values, margin, stable)
