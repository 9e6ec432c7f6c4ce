"""How fast this machine is: a fixed chain of floating-point steps, by which reports of two machines can be scaled."""

from __future__ import annotations

import ctypes
import ctypes.util
from collections.abc import Callable
from dataclasses import dataclass

from graspfx.bench.case import is_installed
from graspfx.bench.measure import clocked, collector_off
from graspfx.compile.machine import compiled

STEPS = 20_000
ROUNDS = 25


@dataclass(frozen=True)
class Calibration:
    """The machine of a run and the time of a step there, the best of many rounds; only the same `kind` compares."""

    kind: str
    step_ns: float


def chain(steps: int, x: float) -> float:
    """Take steps that each wait for the last one: a product, a sum and a division, as in the kernels of the tick."""
    for _ in range(steps):
        x = 1.0 / (0.5 * x + 0.75)
    return x


def calibrate() -> Calibration:
    """Time the chain as machine code; without llvmlite libm's cos, whose call from Python is most of its time."""
    if is_installed("llvmlite"):
        run = compiled(chain)
        return Calibration("compiled: x = 1 / (x / 2 + 3 / 4)", _step(lambda: run(STEPS, 1.0), STEPS))
    cos = ctypes.CDLL(ctypes.util.find_library("m")).cos
    cos.restype, cos.argtypes = ctypes.c_double, (ctypes.c_double,)
    return Calibration("ctypes: cos of libm", _step(lambda: [cos(1.0) for _ in range(STEPS // 20)], STEPS // 20))


def _step(call: Callable[[], object], steps: int) -> float:
    call()
    with collector_off():
        return min(clocked(call, 1) for _ in range(ROUNDS)) / steps
