"""What runs the script of a tick: CPython as it stands, or a program specialised for it and compiled."""

from __future__ import annotations

import linecache
from collections.abc import Callable
from contextlib import suppress
from time import perf_counter
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError, MissingPackageError
from graspfx.loop.tick import Tick

FloatArray = NDArray[np.float64]
Run = Callable[[int, int, int], object]


class Engine(Protocol):
    """A tick that can be called."""

    def expect(self, ticks: int) -> None:
        """So many are to come."""

    def write_to(self, rows: FloatArray) -> None:
        """The block of rows (r, width) that the coming ticks are recorded in."""

    def run(self, k: int, count: int, row: int) -> None:
        """Ticks k, ..., k + count - 1, recorded from a row on."""

    @property
    def each(self) -> Run:
        """`run` for one tick after the other, until `write_to` is called again."""
        ...

    def begin(self, k: int) -> None:
        """Tick k up to what the devices display."""

    def end(self, k: int, row: int) -> None:
        """The rest of it."""


def whole_text(tick: Tick) -> str:
    """The definition of run(k, count, r)."""
    lines = [f"        {line}" for line in (*tick.begin, *tick.end)]
    return "\n".join(
        ["def run(k, count, r):", "    for _ in range(count):", *lines, "        k += 1", "        r += 1"]
    )


def part_text(name: str, parameters: str, lines: list[str]) -> str:
    """The definition of a part of one tick."""
    return "\n".join([f"def {name}({parameters}):", *(f"    {line}" for line in lines)])


class Interpreted:
    """The script on memoryviews, whose items are Python floats."""

    def __init__(self, tick: Tick) -> None:
        arrays = {name: memoryview(array) for name, array in tick.script.arrays.items()}
        self._names: dict[str, Any] = {**tick.script.kernels, **arrays}
        self._run: Run = self._function("run", whole_text(tick))
        self._begin = self._function("begin", part_text("begin", "k", tick.begin))
        self._end = self._function("end", part_text("end", "k, r", tick.end))

    def expect(self, ticks: int) -> None: ...

    def write_to(self, rows: FloatArray) -> None:
        self._names["rows"] = memoryview(rows.reshape(-1))

    def run(self, k: int, count: int, row: int) -> None:
        self._run(k, count, row)

    @property
    def each(self) -> Run:
        return self._run

    def begin(self, k: int) -> None:
        self._begin(k)

    def end(self, k: int, row: int) -> None:
        self._end(k, row)

    def _function(self, name: str, text: str) -> Any:
        file = f"<{name} of a scene's tick>"
        linecache.cache[file] = len(text), None, text.splitlines(keepends=True), file
        exec(compile(text, file, "exec"), self._names)
        return self._names[name]


class Compiled:
    """The script's program for this machine.

    Args:
        tick: the tick.
        make: whether to compile what is not in the cache yet.

    Raises:
        MissingPackageError: no LLVM.
        InputError: a kernel that cannot be compiled.
        LookupError: it is not in the cache, and not to be compiled.
    """

    def __init__(self, tick: Tick, *, make: bool = True) -> None:
        self._tick, self._make = tick, make
        self._bounds: dict[Any, Any] = {}  # by program
        if tick.ports:
            self._first = self._program("begin", part_text("begin", "k", tick.begin))
            self._last = self._program("end", part_text("end", "k, r", tick.end))
        else:
            self._whole = self._program("run", whole_text(tick))

    def expect(self, ticks: int) -> None: ...

    def write_to(self, rows: FloatArray) -> None:
        if self._tick.ports:
            self._begin, self._end = self._bound(self._first, rows).brief, self._bound(self._last, rows).brief
        else:
            whole = self._bound(self._whole, rows)
            self._long: Run = whole.long
            self._brief: Run = whole.brief

    def _bound(self, program: Any, rows: FloatArray) -> Any:
        """A program on the script's arrays and these rows."""
        before = self._bounds.get(program)
        if before is None:
            arrays = {**self._tick.script.arrays, "rows": rows.reshape(-1)}
            self._bounds[program] = program.bind(*(arrays[name] for name in program.arrays))
        elif "rows" in program.arrays:
            self._bounds[program] = program.rebind(before, "rows", rows.reshape(-1))
        return self._bounds[program]

    def run(self, k: int, count: int, row: int) -> None:
        if count == 1:
            self._brief(k, 1, row)
        else:
            self._long(k, count, row)

    @property
    def each(self) -> Run:
        return self._brief

    def begin(self, k: int) -> None:
        self._begin(k)

    def end(self, k: int, row: int) -> None:
        self._end(k, row)

    def _program(self, name: str, text: str) -> Any:
        from graspfx.compile.native import compiled
        from graspfx.compile.program import program_source

        script = self._tick.script
        source = program_source(text, script.kernels, [*script.arrays, "rows"], script.frozen, make=self._make)
        tick = self._tick
        alone = not (tick.ports or tick.guests or tick.bodies or tick.plants)  # tick after tick, nothing between
        return compiled(source, compact=not alone, make=self._make)


FIRST = 16  # ticks by which the cost of the rest is judged
LOADING = 0.1  # what a program in the cache has to save [s]
COMPILING = 3.0  # and one that is not [s]


class Either:
    """Begins with the script as it stands, and goes on with its program where the ticks to come are worth it.

    Both compute the same bits, so that it does not matter to a recording when it changes.
    """

    def __init__(self, tick: Tick) -> None:
        self._tick = tick
        self._engine: Engine = Interpreted(tick)
        self._left, self._done, self._spent = 0, 0, 0.0

    def expect(self, ticks: int) -> None:
        self._left = self._done + ticks

    def write_to(self, rows: FloatArray) -> None:
        self._rows = rows
        self._engine.write_to(rows)

    def run(self, k: int, count: int, row: int) -> None:
        trial = max(0, min(count, FIRST - self._done))
        if trial:
            self._timed(trial, lambda: self._engine.run(k, trial, row))
        if count > trial:
            self._engine.run(k + trial, count - trial, row + trial)

    @property
    def each(self) -> Run:
        return self.run if self._done < FIRST else self._engine.each

    def begin(self, k: int) -> None:
        self._engine.begin(k)

    def end(self, k: int, row: int) -> None:
        if self._done < FIRST:
            self._timed(1, lambda: self._engine.end(k, row))
        else:
            self._engine.end(k, row)

    def _timed(self, ticks: int, run: Callable[[], None]) -> None:
        began = perf_counter()
        run()
        self._spent += perf_counter() - began
        self._done += ticks
        saving = (self._left - self._done) * self._spent / self._done
        if self._done == FIRST and saving > LOADING:
            with suppress(MissingPackageError, InputError, LookupError):  # then the script goes on as it stands
                engine = Compiled(self._tick, make=saving > COMPILING)
                engine.write_to(self._rows)
                self._engine = engine


ENGINES: dict[str, Callable[[Tick], Engine]] = {"auto": Either, "compiled": Compiled, "interpreted": Interpreted}
