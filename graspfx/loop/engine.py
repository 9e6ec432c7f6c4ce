"""What runs the script of a tick: CPython as it stands, or a program specialised for it and compiled."""

from __future__ import annotations

import linecache
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.tick import Tick

FloatArray = NDArray[np.float64]


class Engine(Protocol):
    """A tick that can be called."""

    def write_to(self, rows: FloatArray) -> None:
        """The block of rows (r, width) that the coming ticks are recorded in."""

    def run(self, k: int, count: int, row: int) -> None:
        """Ticks k, ..., k + count - 1, recorded from a row on."""

    def begin(self, k: int) -> None:
        """Tick k up to what the devices display."""

    def end(self, k: int, row: int) -> None:
        """The rest of it."""


def whole_text(tick: Tick) -> str:
    """The definition of run(k, count, r)."""
    lines = [f"        {line}" for line in (*tick.begin, *tick.end)]
    return "\n".join(["def run(k, count, r):", "    for i in range(count):", *lines, "        k += 1", "        r += 1"])


def part_text(name: str, parameters: str, lines: list[str]) -> str:
    """The definition of a part of one tick."""
    return "\n".join([f"def {name}({parameters}):", "    i = 0", *(f"    {line}" for line in lines)])


class Interpreted:
    """The script on memoryviews, whose items are Python floats."""

    def __init__(self, tick: Tick) -> None:
        arrays = {name: memoryview(array) for name, array in tick.script.arrays.items()}
        self._names: dict[str, Any] = {**tick.script.kernels, **arrays}
        self.run: Callable[[int, int, int], None] = self._function("run", whole_text(tick))
        self.begin: Callable[[int], None] = self._function("begin", part_text("begin", "k", tick.begin))
        self.end: Callable[[int, int], None] = self._function("end", part_text("end", "k, r", tick.end))

    def write_to(self, rows: FloatArray) -> None:
        self._names["rows"] = memoryview(rows.reshape(-1))

    def _function(self, name: str, text: str) -> Any:
        file = f"<{name} of a scene's tick>"
        linecache.cache[file] = len(text), None, text.splitlines(keepends=True), file
        exec(compile(text, file, "exec"), self._names)
        return self._names[name]
