"""Gates of the tiers of programs: ratios within one run, at half of what was measured."""

from __future__ import annotations

from pathlib import Path
from time import perf_counter

import numpy as np
import pytest

import graspfx as gx
from graspfx.build.build import build
from graspfx.compile.generic import library
from graspfx.loop.tick.library import LIBRARY
from graspfx.loop.tick.programs import Compiled, Generic, MachineCode
from graspfx.loop.tick.text import write

pytestmark = [pytest.mark.alone, pytest.mark.optimised]

SLOWER = 2.5  # generic over specialised ticks: 1.2 was measured
SOONER = 15.0  # a specialised program over a joined one, nothing of the scene in the cache: 30 to 70 were measured
TICKS = 1024


def test_a_new_scene_starts_soon_and_runs_nearly_as_fast(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("llvmlite")
    library(LIBRARY)
    monkeypatch.setenv("GRASPFX_CACHE", str(tmp_path))
    with build(gx.load("paper-waving")) as servo:
        ticks = [write(servo.parts) for _ in range(2)]
        began = perf_counter()
        generic = Generic(ticks[0])
        joined = perf_counter()
        specialised = Compiled(ticks[1])
        waits = joined - began, perf_counter() - joined
        rows = np.zeros((TICKS, servo.layout.width))
        for _ in range(5):  # a busy machine gets further chances
            times = interleaved(generic, specialised, rows)
            if times[0] <= SLOWER * times[1]:
                break
    assert waits[1] >= SOONER * waits[0]
    assert times[0] <= SLOWER * times[1]


def interleaved(one: MachineCode, other: MachineCode, rows: np.ndarray) -> tuple[float, float]:
    """Time many ticks of two engines in turn, each on its own script; the least of several."""
    least = [float("inf"), float("inf")]
    for _ in range(9):
        for i, engine in enumerate((one, other)):
            engine.write_to(rows)
            began = perf_counter()
            engine.run(0, TICKS, 0)
            least[i] = min(least[i], perf_counter() - began)
    return least[0], least[1]
