"""Methods of eq. (4): a force for each of several grasps, its error the largest, relative to each grasp's force."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.bench.case import Method, each, is_installed
from graspfx.grasp import point_sets
from graspfx.grasp.point_sets import COUPLE, COUPLE_ROWS, LOAD, MODE_ROWS

FloatArray = NDArray[np.float64]
Pair = tuple[FloatArray, FloatArray]  # points and displacements of a grasp, (n, 3) each

EXTERNAL, INTERNAL = 30.0, 70.0  # [N/m]
WRONG = 1e-3  # of a force: more is no matter of rounding


def force_method(
    name: str, force: Callable[[Any], FloatArray], inputs: Sequence[Any], exact: FloatArray, note: str = ""
) -> Method:
    """Make the method whose one operation is force(input), for each input in turn."""

    def error() -> float:
        return relative_error(np.array([force(x).copy() for x in inputs]).reshape(exact.shape), exact)

    return Method(name, each(force, inputs), error, note, len(inputs))


def load_machine_code() -> None:
    """Bring the calls of a `Split` to where a loop of a user has them after some milliseconds: to machine code."""
    if is_installed("llvmlite"):
        point_sets.warm()
        for engine in (COUPLE, COUPLE_ROWS, MODE_ROWS):
            engine.machine(LOAD)


def relative_error(forces: FloatArray, exact: FloatArray) -> float:
    """Compute the largest error over grasps (N, n, 3), relative to the largest force of each."""
    return float((np.abs(forces - exact).max(axis=(1, 2)) / np.abs(exact).max(axis=(1, 2))).max())
