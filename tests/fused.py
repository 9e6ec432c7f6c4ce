"""Plants driven through the FusedPlant protocol alone, by their kernels as they are or compiled."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import FunctionType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspfx.loop.plant import FusedPlant, Hand

FloatArray = NDArray[np.float64]
Kernel = Callable[[Any, int], int]


def drive(
    plant: FusedPlant, efforts: FloatArray, hand: Hand, T: float, kernel: Kernel | None = None, o: int = 0
) -> FloatArray:
    """Positions and velocities after each sample, (samples, 2, n, d), from time zero.

    By the plant's own kernel on a memoryview of its block; or by `kernel`, on an array that holds the block from `o`.
    """
    plant.hold(hand, T)
    ports, shape = plant.ports, plant.position.shape
    N = shape[0] * shape[1]
    whole = np.concatenate([np.full(o, np.nan), plant.state]) if kernel else plant.state
    S = whole[o:]
    rows = []
    for k, effort in enumerate(efforts):
        S[ports.effort : ports.effort + N] = effort.ravel()
        if ports.middle is not None:
            S[ports.middle : ports.middle + 2 * N] = np.ravel(hand.target(0.5 * (k * T + (k + 1) * T)))
        S[ports.end : ports.end + 2 * N] = np.ravel(hand.target((k + 1) * T))
        assert (kernel(whole, o) if kernel else plant.kernel(memoryview(whole), 0)) == 0
        rows.append([S[p : p + N].reshape(shape).copy() for p in (ports.position, ports.velocity)])
    assert np.isnan(whole[:o]).all()  # nothing written before the block
    return np.array(rows)


def advanced(plant: FusedPlant, efforts: FloatArray, hand: Hand, T: float) -> FloatArray:
    """The same by `advance`."""
    rows = []
    for effort in efforts:
        plant.advance(effort, hand, T)
        rows.append([plant.position.copy(), plant.velocity.copy()])
    return np.array(rows)


def compiled(kernel: Any) -> Kernel:
    """The kernel and the functions that it calls, compiled by numba; skips the test without it."""
    pytest.importorskip("numba")
    compiled_kernel: Kernel = _twin(kernel)
    return compiled_kernel


@cache  # kernels call one another: each is compiled once for all tests
def _twin(function: FunctionType) -> Any:
    import numba

    named = {name: function.__globals__.get(name) for name in function.__code__.co_names}
    calls = {name: _twin(called) for name, called in named.items() if isinstance(called, FunctionType)}
    return numba.njit(FunctionType(function.__code__, function.__globals__ | calls))
