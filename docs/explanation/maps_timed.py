"""Time of maps of 200 by 200 exact limits: compiled, by numpy, and by python-control's margins on 200 of the points."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from functools import partial

import control
import numpy as np

import graspfx as gx

T, SPRING, FRICTION, OBJECT = 0.005, 33.0, 0.2, 0.1
MASS, VISCOSITY = np.linspace(0.05, 0.2, 200), np.linspace(0.2, 2.0, 200)


def external(engine: str) -> object:
    return gx.stability.external_limit_map(MASS[:, None], FRICTION, T, OBJECT, VISCOSITY, spring=SPRING, engine=engine)


def wall(engine: str) -> object:
    return gx.stability.wall_limit_map(MASS[:, None], VISCOSITY, T, spring=SPRING, engine=engine)


def by_control(points: int) -> None:
    """A device and half the object, each sampled under zero-order hold, and the gain margin of their sum."""
    for m, B in zip(np.resize(MASS, points), np.resize(VISCOSITY, points), strict=True):
        loop = sampled(m, FRICTION, SPRING) + sampled(OBJECT / 2, B / 2, 0.0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            control.stability_margins(loop)


def sampled(m: float, b: float, k: float) -> control.StateSpace:
    plant = control.ss([[0.0, 1.0], [-k / m, -b / m]], [[0.0], [1.0 / m]], [[1.0, 0.0]], 0.0)
    return control.sample_system(plant, T, "zoh")


def timed(call: Callable[[], object], times: int) -> list[float]:
    """Sorted times [s]."""
    seconds = []
    for _ in range(times):
        start = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - start)
    return sorted(seconds)


if __name__ == "__main__":
    for name, map_of in (("external", external), ("wall", wall)):
        print(f"{name}: compiling {timed(partial(map_of, 'compiled'), 1)[0]:.1f} s")
        for engine, times in (("compiled", 100), ("numpy", 10)):
            seconds = timed(partial(map_of, engine), times)
            print(f"{name}, {engine}: least {1e3 * seconds[0]:.1f} ms, median {1e3 * seconds[times // 2]:.1f} ms")
    seconds = timed(partial(by_control, 200), 1)
    print(f"external, python-control: 200 points {seconds[0]:.2f} s, 40000 would take {200 * seconds[0]:.0f} s")
