"""Whittaker's smoother in one program: what is rough in many signals at once, squared and added up."""

from __future__ import annotations

from functools import cache
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import GraspFXError
from graspfx.loop.recording.growth.smoother import ORDER, roughness

if TYPE_CHECKING:
    from graspfx.compile.machine import Machine

FloatArray = NDArray[np.float64]

MORE = 20_000  # numbers from which a program is worth loading
FACTORS = ORDER + 1  # of a row of q D D' + I = L d L': four of L, and 1/d


def factorise(factors: Any, setting: Any, rows: int) -> None:
    """Factorise q D D' + I of `rows` - 4 rows, D the fourth differences: row k's factors are at 5 (k + 4).

    Args:
        factors: a buffer of 5 (rows + 4) numbers; of its first 20 those of L are zero.
        setting: q.
        rows: of the signals.
    """
    q = setting[0]
    for k in range(rows - 4):
        o = 5 * (k + 4)
        f4 = q if k >= 4 else 0.0  # l d of the entry in that column
        f3 = (-8.0 * q if k >= 3 else 0.0) - f4 * factors[o - 15]
        f2 = (28.0 * q if k >= 2 else 0.0) - f4 * factors[o - 9] - f3 * factors[o - 10]
        f1 = (-56.0 * q if k >= 1 else 0.0) - f4 * factors[o - 3] - f3 * factors[o - 4] - f2 * factors[o - 5]
        l4 = f4 * factors[o - 16]
        l3 = f3 * factors[o - 11]
        l2 = f2 * factors[o - 6]
        l1 = f1 * factors[o - 1]
        factors[o] = l1
        factors[o + 1] = l2
        factors[o + 2] = l3
        factors[o + 3] = l4
        factors[o + 4] = 1.0 / (70.0 * q + 1.0 - f4 * l4 - f3 * l3 - f2 * l2 - f1 * l1)


def sweep(
    signals: Any, work: Any, factors: Any, setting: Any, sums: Any, rows: int, columns: int, first: int, stop: int
) -> None:
    """Add up the squares of x - s = q D' (q D D' + I)^-1 D x over rows from `first` up to `stop`, signal by signal.

    Args:
        signals: x, a buffer of rows x columns.
        work: a buffer of (rows + 4) x columns, zero before the first 4 rows' end and behind the last row but 4.
        factors: from `factorise`.
        setting: q.
        sums: a buffer of columns, which is added to.
        rows, columns: of the signals.
        first, stop: of the rows that count.
    """
    q = setting[0]
    c = columns
    for k in range(rows - 4):
        f = 5 * (k + 4)
        l1 = factors[f]
        l2 = factors[f + 1]
        l3 = factors[f + 2]
        l4 = factors[f + 3]
        x = k * c
        w = (k + 4) * c
        for j in range(c):
            work[w + j] = (
                signals[x + j] - 4.0 * signals[x + c + j] + 6.0 * signals[x + 2 * c + j]
                - 4.0 * signals[x + 3 * c + j] + signals[x + 4 * c + j]
                - l1 * work[w - c + j] - l2 * work[w - 2 * c + j] - l3 * work[w - 3 * c + j] - l4 * work[w - 4 * c + j]
            )  # fmt: skip
    for i in range(rows):
        k = rows - 5 - i
        w = (k + 4) * c
        if k >= 0:
            f = 5 * (k + 4)
            d = factors[f + 4]
            l1 = factors[f + 5]
            l2 = factors[f + 11]
            l3 = factors[f + 17]
            l4 = factors[f + 23]
            for j in range(c):
                work[w + j] = (
                    d * work[w + j] - l1 * work[w + c + j] - l2 * work[w + 2 * c + j] - l3 * work[w + 3 * c + j]
                    - l4 * work[w + 4 * c + j]
                )  # fmt: skip
        else:
            for j in range(c):
                work[w + j] = 0.0
        if k + 4 >= first and k + 4 < stop:
            for j in range(c):
                rough = q * (
                    work[w + j] - 4.0 * work[w + c + j] + 6.0 * work[w + 2 * c + j] - 4.0 * work[w + 3 * c + j]
                    + work[w + 4 * c + j]
                )  # fmt: skip
                sums[j] = sums[j] + rough * rough


def rough(
    signals: Any, work: Any, factors: Any, setting: Any, sums: Any, rows: int, columns: int, first: int, stop: int
) -> None:
    """Add up squares as `sweep` does, with factors that are computed first."""
    factorise(factors, setting, rows)
    sweep(signals, work, factors, setting, sums, rows, columns, first, stop)


def rough_squares(x: FloatArray, q: float, first: int, stop: int) -> FloatArray:
    """Add up the squares of what is rough in each signal, over rows from `first` up to `stop`, (k,).

    Compiled where there is LLVM and the signals are long enough, else by numpy: the same to rounding.

    Args:
        x: (N, k), k signals of N > 4 samples.
        q: of the smoother's penalty (`smoother.roughness`).
        first, stop: of the rows that count.
    """
    machine = _machine() if x.size > MORE else None
    if machine is None:
        return np.asarray((roughness(x, q)[first:stop] ** 2).sum(axis=0))
    N, k = x.shape
    factors, work, sums = np.zeros(FACTORS * (N + 8)), np.zeros((N + 8) * k), np.zeros(k)
    factors[FACTORS - 1 : FACTORS * ORDER : FACTORS] = 1.0
    signals = np.ascontiguousarray(x).reshape(-1)
    machine.once(signals, work, factors, np.array([q]), sums, N, k, first, stop)
    return sums


@cache
def _machine() -> Machine | None:
    """Compile the kernel, or take it from the cache; None without LLVM, or with one that does not load."""
    if find_spec("llvmlite") is None:
        return None
    from graspfx.compile.machine import compiled

    try:
        return compiled(rough)
    except GraspFXError:
        return None
