"""Maps of stability limits: compiled, by numpy, and by the gain margins of python-control."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.maps import external_limit_map, wall_limit_map
from graspfx.bench.case import Case, Method, is_installed, missing
from graspfx.bench.map_oracle import crossing

FloatArray = NDArray[np.float64]
Plants = list[tuple[float, float, float]]

TITLE = "Maps of stability limits"
LIMITS = """
Times are per point of a map. The compiled kernel runs on all processors, numpy and python-control on one; compiling
takes 1 to 4 s once per process and is not in the times. python-control finds all margins of any loop, of which the gain
margin is used, and interpolates its crossing; it is timed on a few of the points. Errors are of those points, all with
friction, without delay.
"""

T, SPRING, FRICTION, OBJECT = 0.005, 33.0, 0.2, 0.1
COMPARED = 8  # points that the oracle and python-control are asked for
WRONG = 1e-3


def cases(quick: bool) -> Iterator[Case]:
    side = 60 if quick else 200
    mass, viscosity = np.linspace(0.05, 0.2, side)[:, None], np.linspace(0.2, 2.0, side)
    rng = np.random.default_rng(3)
    rows, columns = rng.integers(0, side, (2, COMPARED))
    chosen = [(float(mass[i, 0]), float(viscosity[j])) for i, j in zip(rows, columns, strict=True)]

    def external(engine: str) -> FloatArray:
        return external_limit_map(mass, FRICTION, T, OBJECT, viscosity, spring=SPRING, engine=engine)

    def wall(engine: str) -> FloatArray:
        return wall_limit_map(mass, viscosity, T, spring=SPRING, engine=engine)

    # two fingers: each device has half of the object
    moved = [[(m, FRICTION, SPRING), (OBJECT / 2, b / 2, 0.0)] for m, b in chosen]
    walls = [[(m, b, SPRING)] for m, b in chosen]
    for name, limits, plants in (("device that moves an object", external, moved), ("device on a wall", wall, walls)):
        methods = _methods(limits, plants, (rows, columns), side * side)
        yield Case("maps", f"{name}, {side} by {side}", "relative", list(methods), WRONG)


def _methods(
    limits: Callable[[str], FloatArray], loops: list[Plants], where: tuple[Any, Any], points: int
) -> Iterator[Method]:
    exact = np.array([crossing(plants, T, float(k)) for plants, k in zip(loops, limits("numpy")[where], strict=True)])

    def error(engine: str) -> float:
        return _error(limits(engine)[where], exact)

    yield Method("GraspFX, numpy", partial(limits, "numpy"), partial(error, "numpy"), calls=points)
    if is_installed("llvmlite"):
        yield Method("GraspFX, compiled", partial(limits, "compiled"), partial(error, "compiled"), calls=points)
    else:
        yield missing("GraspFX, compiled", "llvmlite")
    if is_installed("control"):
        margins = partial(_margins, loops)
        yield Method("python-control", margins, lambda: _error(margins(), exact), calls=len(loops))
    else:
        yield missing("python-control", "control")


def _margins(loops: list[Plants]) -> FloatArray:
    """Gain margins of plants sampled under zero-order hold: the force moves one forward and the other back."""
    import control

    found = []
    for plants in loops:
        continuous = [([[0.0, 1.0], [-k / m, -b / m]], [[0.0], [1.0 / m]]) for m, b, k in plants]
        sampled = [control.sample_system(control.ss(A, B, [[1.0, 0.0]], 0.0), T, "zoh") for A, B in continuous]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that it interpolates, for each
            found.append(float(control.stability_margins(sum(sampled[1:], sampled[0]))[0]))
    return np.array(found)


def _error(found: FloatArray, exact: FloatArray) -> float:
    return float(np.abs(found / exact - 1.0).max())
