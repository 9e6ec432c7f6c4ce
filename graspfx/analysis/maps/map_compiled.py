"""Limits of many points by `map_kernel`, compiled when first asked for, on every core."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.arguments import one_of
from graspfx.analysis.maps import map_kernel
from graspfx.compile.machine import compiled
from graspfx.environment import processors
from graspfx.errors import InputError, MissingPackageError

FloatArray = NDArray[np.float64]

ENGINES = ("auto", "numpy", "compiled")
PAYS = 2_000_000  # points from which compiling, some seconds, is made good by the first map
BLOCK = 65536  # points held at once
SHARE = 4096  # points handed to a core at once: more than the handing costs, and a busy core holds nothing up


def is_compiled(engine: str, points: int, *, covered: bool) -> bool:
    """Tell whether a map is made by the compiled kernel; `auto` asks for it only where compiling pays.

    Args:
        covered: whether the kernel knows the case, without delay and dampers of the coupling.

    Errors: `compiled` for a case that the kernel does not know, or without llvmlite.
    """
    one_of("engine", engine, ENGINES)
    if engine == "numpy" or (engine == "auto" and (points < PAYS or not covered)):
        return False
    if not covered:
        raise InputError(
            "engine", engine, "'auto' or 'numpy' for maps with a delay or with damping of the coupling or the wall"
        )
    if find_spec("llvmlite") is not None:
        return True
    if engine == "compiled":
        raise MissingPackageError("llvmlite", "engine='compiled'", "pip install llvmlite, or use engine='numpy'")
    return False


def wall_limits(*parameters: FloatArray) -> FloatArray:
    """Compute limits of walls from m, b, T and k_s, each (points,) or one number."""
    return _shared_out(compiled(map_kernel.wall_limits).unlocked, _flat(parameters), map_kernel.WALL_WIDTH)


def external_limits(*parameters: FloatArray, integrator: int) -> FloatArray:
    """Compute limits of devices that move an object from m, b, T, k_s, m_v/n and b_v/n, each (points,) or a number."""
    return _shared_out(
        compiled(map_kernel.external_limits).unlocked, _flat(parameters), map_kernel.EXTERNAL_WIDTH, integrator
    )


def _flat(parameters: tuple[FloatArray, ...]) -> FloatArray:
    points = np.empty((max(a.size for a in parameters), len(parameters)))
    for column, a in zip(points.T, parameters, strict=True):
        column[:] = a
    return points.reshape(-1)


def _shared_out(kernel: Callable[..., None], points: FloatArray, width: int, *more: int) -> FloatArray:
    total = len(points) // width
    limits = np.empty(total)
    pieces = max(1, total // SHARE)
    cores = min(processors(), pieces)
    bounds = [total * i // pieces for i in range(pieces + 1)]
    if cores == 1:
        kernel(points, limits, 0, total, *more)
        return limits
    from concurrent.futures import ThreadPoolExecutor  # takes longer to load than one limit to find

    with ThreadPoolExecutor(cores) as pool:
        for future in [pool.submit(kernel, points, limits, *ends, *more) for ends in pairwise(bounds)]:
            future.result()
    return limits
