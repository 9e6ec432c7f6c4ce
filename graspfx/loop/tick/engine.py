"""Engines of a tick's script: CPython as it stands, or a program specialised for it and compiled."""

from __future__ import annotations

import linecache
from collections.abc import Callable
from contextlib import suppress
from time import perf_counter
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from graspfx import log
from graspfx.compile.kernel import keep_lowerings, source_function
from graspfx.compile.records import start_of
from graspfx.errors import InputError, MissingPackageError
from graspfx.loop.tick.memory import ServoState
from graspfx.loop.tick.script import Tick

FloatArray = NDArray[np.float64]
Run = Callable[[int, int, int], int]


class Engine(Protocol):
    """A tick that can be called."""

    @property
    def name(self) -> str:
        """Which it is, as a recording says it."""
        ...

    @property
    def patience(self) -> int:
        """Ticks of one call for which whoever wants to stop a run has to wait."""
        ...

    def expect(self, ticks: int) -> None:
        """Expect so many ticks."""

    def write_to(self, rows: FloatArray) -> None:
        """Set the block of rows (r, width) that the coming ticks are recorded in."""

    def run(self, k: int, count: int, row: int) -> int:
        """Run ticks k, ..., k + count - 1, recorded from a row on; return how many were done.

        The one with the first fault is the last, so that it can be asked how things stand.
        """
        ...

    @property
    def each(self) -> Run:
        """`run` for one tick after the other, until `write_to` is called again."""
        ...

    def begin(self, k: int) -> None:
        """Run tick k up to what the devices display."""

    def end(self, k: int, row: int) -> None:
        """Run the rest of it."""


def whole_text(tick: Tick, *, pausing: bool = False) -> str:
    """Write the definition of run(k, count, r).

    Args:
        tick: the tick.
        pausing: whether it gives the ticks done, and the one in which the first fault happened is the last of them.
    """
    faulted, latched = (f"{tick.own_name}[{start_of(ServoState, name)}]" for name in ("faulted", "tick"))
    lines = [*tick.begin, *tick.end]
    lines += [f"if {faulted} != 0.0 and {latched} == k:", "    return i + 1"] if pausing else []
    body = [f"        {line}" for line in [*lines, "k += 1", "r += 1"]]
    return "\n".join(["def run(k, count, r):", "    for i in range(count):", *body, "    return count"])


def part_text(name: str, parameters: str, lines: list[str]) -> str:
    """Write the definition of a part of one tick."""
    return "\n".join([f"def {name}({parameters}):", *(f"    {line}" for line in lines)])


def texts(tick: Tick) -> dict[str, str]:
    """Write the functions of a tick, by name: one for any number of ticks, or two where code comes between."""
    if not tick.ports:
        return {"run": whole_text(tick, pausing=True)}
    return {"begin": part_text("begin", "k", tick.begin), "end": part_text("end", "k, r", tick.end)}


def sources(tick: Tick, *, make: bool = True) -> dict[str, str]:
    """Specialise the same texts as programs; LookupError if they are not yet and are not to be made."""
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
    patience = 1

    def __init__(self, tick: Tick) -> None:
        arrays = {name: memoryview(array) for name, array in tick.script.arrays.items()}
        self._names: dict[str, Any] = {
            **{name: source_function(kernel) for name, kernel in tick.script.kernels.items()},
            **arrays,
        }
        keep_lowerings()
        self._run: Run = self._function("run", whole_text(tick, pausing=True))
        self._begin = self._function("begin", part_text("begin", "k", tick.begin))
        self._end = self._function("end", part_text("end", "k, r", tick.end))

    def expect(self, ticks: int) -> None: ...

    def write_to(self, rows: FloatArray) -> None:
        self._names["rows"] = memoryview(rows.reshape(-1))

    def run(self, k: int, count: int, row: int) -> int:
        return self._run(k, count, row)

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
        quick: whether to compile in less time what then takes longer to run, the same bits.

    Raises:
        MissingPackageError: no LLVM.
        InputError: a kernel that cannot be compiled.
        LookupError: it is not in the cache, and not to be compiled.
    """

    name = "compiled"
    patience = 64

    def __init__(self, tick: Tick, *, make: bool = True, quick: bool = False) -> None:
        from graspfx.compile.native import compiled

        self._tick = tick
        self._rows: FloatArray | None = None
        self._bounds: dict[Any, Any] = {}  # by program
        self.programs = {
            name: compiled(source, quick=quick, make=make) for name, source in sources(tick, make=make).items()
        }

    def expect(self, ticks: int) -> None: ...

    def write_to(self, rows: FloatArray) -> None:
        if rows is self._rows:
            return
        self._rows = rows
        if self._tick.ports:
            self._begin, self._end = (self._bound(self.programs[name], rows).brief for name in ("begin", "end"))
        else:
            whole = self._bound(self.programs["run"], rows)
            self._long: Run = whole.long
            self._brief: Run = whole.brief

    def _bound(self, program: Any, rows: FloatArray) -> Any:
        """Bind a program to the script's arrays and these rows."""
        before = self._bounds.get(program)
        if before is None:
            arrays = {**self._tick.script.arrays, "rows": rows.reshape(-1)}
            self._bounds[program] = program.bind(*(arrays[name] for name in program.arrays))
        elif "rows" in program.arrays:
            self._bounds[program] = program.rebind(before, "rows", rows.reshape(-1))
        return self._bounds[program]

    def run(self, k: int, count: int, row: int) -> int:
        return self._brief(k, 1, row) if count == 1 else self._long(k, count, row)

    @property
    def each(self) -> Run:
        return self._brief

    def begin(self, k: int) -> None:
        self._begin(k)

    def end(self, k: int, row: int) -> None:
        self._end(k, row)


FIRST = 16  # ticks by which the cost of the rest is judged
LOADING = 0.1  # what a program in the cache has to save [s],
COMPILING = 1.0  # one that is to be compiled in a short time,
OPTIMISING = 10.0  # and one that is compiled at its best


class AutoEngine:
    """Begins with the script as it stands, and goes on with its program where the ticks to come are worth it.

    Both compute the same bits, so that it does not matter to a recording when it changes.

    Args:
        tick: the tick.
        cost: of a tick as it stands [s]; measured over the first ones if not given.
    """

    def __init__(self, tick: Tick, *, cost: float | None = None) -> None:
        self._tick = tick
        self._known_cost = cost
        self._engine: Engine = Interpreted(tick)
        self._left, self._ticks, self._spent = 0, 0, 0.0
        self._ran = self._after = 0  # ticks so far, and those before the program

    @property
    def cost(self) -> float:
        """Seconds that a tick takes as it stands, by the first ones unless it was given."""
        return self._spent / self._ticks if self._known_cost is None else self._known_cost

    @property
    def patience(self) -> int:
        return self._engine.patience

    @property
    def name(self) -> str:
        engine = self._engine.name
        return engine if engine == Interpreted.name else f"{engine} after {self._after} ticks"

    def expect(self, ticks: int) -> None:
        self._left = self._ticks + ticks
        if self._ticks >= FIRST and isinstance(self._engine, Interpreted):
            self._choose()

    def write_to(self, rows: FloatArray) -> None:
        self._rows = rows
        self._engine.write_to(rows)

    def run(self, k: int, count: int, row: int) -> int:
        trial = min(count, FIRST - self._ticks)
        if trial > 0:
            began = perf_counter()
            code = self._engine.run(k, trial, row)
            self._ran = k + code
            self._judge(code, perf_counter() - began)
            return code
        code = self._engine.run(k, count, row)
        self._ran = k + code
        return code

    @property
    def each(self) -> Run:
        return self.run if self._ticks < FIRST else self._engine.each

    def begin(self, k: int) -> None:
        self._engine.begin(k)

    def end(self, k: int, row: int) -> None:
        began = perf_counter()
        self._engine.end(k, row)
        self._ran = k + 1
        if self._ticks < FIRST:
            self._judge(1, perf_counter() - began)

    def _judge(self, ticks: int, seconds: float) -> None:
        self._spent += seconds
        self._ticks += ticks
        if self._ticks == FIRST:
            self._choose()

    def _choose(self) -> None:
        saving = (self._left - self._ticks) * self.cost
        if saving > LOADING:
            with suppress(MissingPackageError, InputError, LookupError):  # then the script goes on as it stands
                engine = Compiled(self._tick, make=saving > COMPILING, quick=saving < OPTIMISING)
                engine.write_to(self._rows)
                self._engine, self._after = engine, self._ran
                log.info("a compiled program takes over after %d ticks", self._ran)
                return
        log.debug("ticks go on as they stand: a program would save %.2g s", saving)


ENGINES: dict[str, Callable[[Tick], Engine]] = {"auto": AutoEngine, "compiled": Compiled, "interpreted": Interpreted}
