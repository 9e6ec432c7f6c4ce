"""Maps of stability limits, and limits of grasps, beside eigenvalues with root finding and python-control."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.stability.one_gain import external_limit_map, wall_limit_map
from graspfx.bench.case import Case, Method, is_installed, missing
from graspfx.bench.cases import grasp_limits
from graspfx.bench.oracles.map_oracle import crossing
from graspfx.bench.peers.limit_peers import PEERS, Plant

FloatArray = NDArray[np.float64]

TITLE = "Limits of stability: maps, grasps and certificates"
LIMITS = """
Times are per point of a map, of the call of `external_limit_map` or `wall_limit_map`. The peers know no closed form:
they sample the plants and look for the gain at which the largest eigenvalue of the loop meets the unit circle, or its
Nyquist curve the point -1; python-control finds all margins of any loop, of which one is used. They are timed on a few
of the points. Errors are of those points, all with friction, without delay.
"""
LIMITS += grasp_limits.LIMITS

T, SPRING, FRICTION, OBJECT = 0.005, 33.0, 0.2, 0.1
COMPARED = 8  # points that the oracle and the peers are asked for
WRONG = 1e-3


def cases(quick: bool) -> Iterator[Case]:
    side = 60 if quick else 200
    mass, viscosity = np.linspace(0.05, 0.2, side)[:, None], np.linspace(0.2, 2.0, side)
    rng = np.random.default_rng(3)
    rows, columns = rng.integers(0, side, (2, COMPARED))
    points = [(float(mass[i, 0]), float(viscosity[j])) for i, j in zip(rows, columns, strict=True)]

    def external() -> FloatArray:
        return external_limit_map(mass, FRICTION, T, OBJECT, viscosity, spring=SPRING)

    def wall() -> FloatArray:
        return wall_limit_map(mass, viscosity, T, spring=SPRING)

    # two fingers: each device has half of the object
    moving = [[(m, FRICTION, SPRING), (OBJECT / 2, b / 2, 0.0)] for m, b in points]
    walls = [[(m, b, SPRING)] for m, b in points]
    for name, limits, plants in (("device that moves an object", external, moving), ("device on a wall", wall, walls)):
        methods = _methods(limits, plants, (rows, columns), side * side)
        yield Case("maps", f"{name}, {side} by {side}", "relative", list(methods), WRONG)
    yield from grasp_limits.grasp_cases(quick)


def _methods(
    limits: Callable[[], FloatArray], loops: Sequence[Sequence[Plant]], where: tuple[Any, Any], points: int
) -> Iterator[Method]:
    exact = np.array([crossing(list(plants), T, float(k)) for plants, k in zip(loops, limits()[where], strict=True)])
    yield Method("GraspFX", limits, lambda: _error(limits()[where], exact), calls=points)
    for name, limit, package in PEERS:
        if is_installed(package):
            solve = partial(_limits, limit, loops)
            yield Method(name, solve, partial(_peer_error, solve, exact), calls=len(loops))
        else:
            yield missing(name, package)


def _limits(limit: Callable[[Sequence[Plant], float], float], loops: Sequence[Sequence[Plant]]) -> FloatArray:
    return np.array([limit(plants, T) for plants in loops])


def _peer_error(solve: Callable[[], FloatArray], exact: FloatArray) -> float:
    return _error(solve(), exact)


def _error(limits: FloatArray, exact: FloatArray) -> float:
    return float(np.abs(limits / exact - 1.0).max())
