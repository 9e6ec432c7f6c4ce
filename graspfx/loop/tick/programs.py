"""Ways to run a tick's script: CPython as it stands, generic kernels joined, or a program specialised for the scene."""

from __future__ import annotations

import linecache
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.kernel import keep_lowerings, source_function
from graspfx.loop.tick.engine_text import arrays_of, joined_texts, part_text, sources, whole_text
from graspfx.loop.tick.library import LIBRARY
from graspfx.loop.tick.script import Tick

if TYPE_CHECKING:
    from graspfx.compile.native import Native, Spread

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

    def spread(self, k: int, count: int) -> Spread | None:
        """Give the code of ticks k, ..., k + count - 1 for other machine code, until `write_to` is called again.

        It takes the numbers of `run`. None where they are not machine code.
        """
        ...

    def begin(self, k: int) -> None:
        """Run tick k up to what the devices display."""

    def end(self, k: int, row: int) -> None:
        """Run the rest of it."""


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

    def spread(self, k: int, count: int) -> None:
        return None

    def begin(self, k: int) -> None:
        self._begin(k)

    def end(self, k: int, row: int) -> None:
        self._end(k, row)

    def _function(self, name: str, text: str) -> Any:
        file = f"<{name} of a scene's tick>"
        linecache.cache[file] = len(text), None, text.splitlines(keepends=True), file
        exec(compile(text, file, "exec"), self._names)
        return self._names[name]


class MachineCode:
    """Programs for this machine, bound to a script's arrays and to the rows that are recorded.

    Args:
        tick: the tick.
        programs: `run`, or `begin` and `end` where code comes between.
    """

    patience = 64

    def __init__(self, tick: Tick, programs: dict[str, Native]) -> None:
        self._tick = tick
        self._rows: FloatArray | None = None
        self._bounds: dict[Any, Any] = {}  # by program
        self.programs = programs

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
            self._spread: Spread | None = whole.spread

    def _bound(self, program: Any, rows: FloatArray) -> Any:
        """Bind a program to the script's arrays and these rows."""
        before = self._bounds.get(program)
        if before is None:
            arrays = {**self._tick.script.arrays, "rows": rows.reshape(-1)}
            self._bounds[program] = program.bind(*(arrays[name] for name in program.arrays))
        elif "rows" in program.arrays:
            self._bounds[program] = program.rebind(before, "rows", rows.reshape(-1))
        return self._bounds[program]

    def halves(self, rows: FloatArray) -> tuple[Spread, Spread]:
        """Give `begin` and `end` of a tick for other machine code, recorded in these rows."""
        begin, end = (self._bound(self.programs[name], rows).spread for name in ("begin", "end"))
        assert begin is not None
        assert end is not None
        return begin, end

    def run(self, k: int, count: int, row: int) -> int:
        return self._brief(k, 1, row) if count == 1 else self._long(k, count, row)

    @property
    def each(self) -> Run:
        return self._brief

    def spread(self, k: int, count: int) -> Spread | None:
        return self._spread

    def begin(self, k: int) -> None:
        self._begin(k)

    def end(self, k: int, row: int) -> None:
        self._end(k, row)


class Generic(MachineCode):
    """Kernels that were compiled once for all scenes, joined by a short program of this one.

    Raises:
        MissingPackageError: no LLVM.
        InputError: a kernel that cannot be compiled.
    """

    name = "generic"

    def __init__(self, tick: Tick) -> None:
        from graspfx.compile.joined import joined

        kernels, buffers = tick.script.kernels, arrays_of(tick)
        programs = {name: joined(text, kernels, buffers, LIBRARY) for name, text in joined_texts(tick).items()}
        super().__init__(tick, programs)


class Compiled(MachineCode):
    """The script's program, specialised for the scene.

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

        texts = sources(tick, make=make)
        super().__init__(tick, {name: compiled(text, quick=quick, make=make) for name, text in texts.items()})
