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


class Engine(Protocol):
    """A tick that can be called."""

    @property
    def name(self) -> str:
        """Which it is, as a recording says it."""
        ...

    def expect(self, ticks: int) -> None:
        """So many are to come."""

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
    return "\n".join(
        ["def run(k, count, r):", "    for i in range(count):", *lines, "        k += 1", "        r += 1"]
    )


def part_text(name: str, parameters: str, lines: list[str]) -> str:
    """The definition of a part of one tick."""
    return "\n".join([f"def {name}({parameters}):", "    i = 0", *(f"    {line}" for line in lines)])


def texts(tick: Tick) -> dict[str, str]:
    """The functions that run a tick, by name: one for any number of ticks, or two for one where code comes between."""
    if not tick.ports:
        return {"run": whole_text(tick)}
    return {"begin": part_text("begin", "k", tick.begin), "end": part_text("end", "k, r", tick.end)}


def sources(tick: Tick, *, make: bool = True) -> dict[str, str]:
    """The same as programs, specialised; LookupError if they are not yet and are not to be made."""
    from graspfx.compile.program import program_source

    script = tick.script
    arrays = [*script.arrays, "rows"]
    return {
        name: program_source(text, script.kernels, arrays, script.frozen, make=make)
        for name, text in texts(tick).items()
    }


class Interpreted:
    """The script on memoryviews, whose items are Python floats."""

    name = "interpreted"

    def __init__(self, tick: Tick) -> None:
        arrays = {name: memoryview(array) for name, array in tick.script.arrays.items()}
        self._names: dict[str, Any] = {**tick.script.kernels, **arrays}
        self._run = self._function("run", whole_text(tick))
        self._begin = self._function("begin", part_text("begin", "k", tick.begin))
        self._end = self._function("end", part_text("end", "k, r", tick.end))

    def expect(self, ticks: int) -> None: ...

    def write_to(self, rows: FloatArray) -> None:
        self._names["rows"] = memoryview(rows.reshape(-1))

    def run(self, k: int, count: int, row: int) -> None:
        self._run(k, count, row)

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
        quick: whether to compile in less time what then takes longer to run, the same bits.

    Raises:
        MissingPackageError: no LLVM.
        InputError: a kernel that cannot be compiled.
        LookupError: it is not in the cache, and not to be compiled.
    """

    name = "compiled"

    def __init__(self, tick: Tick, *, make: bool = True, quick: bool = False) -> None:
        from graspfx.compile.native import compiled

        self._tick = tick
        self.programs = {
            name: compiled(source, quick=quick, make=make) for name, source in sources(tick, make=make).items()
        }

    def expect(self, ticks: int) -> None: ...

    def write_to(self, rows: FloatArray) -> None:
        arrays = {**self._tick.script.arrays, "rows": rows.reshape(-1)}

        def bound(program: Any) -> Any:
            return program.bind(*(arrays[name] for name in program.arrays))

        if self._tick.ports:
            self._begin, self._end = (bound(self.programs[name]).brief for name in ("begin", "end"))
        else:
            whole = bound(self.programs["run"])
            self._long, self._brief = whole.long, whole.brief

    def run(self, k: int, count: int, row: int) -> None:
        if count == 1:
            self._brief(k, 1, row)
        else:
            self._long(k, count, row)

    def begin(self, k: int) -> None:
        self._begin(k)

    def end(self, k: int, row: int) -> None:
        self._end(k, row)


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

    @property
    def cost(self) -> float:
        """Of a tick as it stands, by the first ones [s]."""
        return self._spent / self._done

    @property
    def name(self) -> str:
        engine = self._engine.name
        return engine if engine == Interpreted.name else f"{engine} after {FIRST} ticks"

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
        saving = (self._left - self._done) * self.cost
        if self._done == FIRST and saving > LOADING:
            with suppress(MissingPackageError, InputError, LookupError):  # then the script goes on as it stands
                engine = Compiled(self._tick, make=saving > COMPILING)
                engine.write_to(self._rows)
                self._engine = engine


ENGINES: dict[str, Callable[[Tick], Engine]] = {"auto": Either, "compiled": Compiled, "interpreted": Interpreted}
