"""Engines of a tick's script, by the names that scenes have for them."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING

from graspfx import log
from graspfx.compile.background import Request, begin
from graspfx.compile.kernel_checks import check, foreign_kernels
from graspfx.errors import InputError, KernelError, MissingPackageError
from graspfx.loop.tick.engine_text import texts
from graspfx.loop.tick.first_ticks import CheckedScript, FirstTicks
from graspfx.loop.tick.programs import Compiled, Engine, FloatArray, Generic, Interpreted, Run
from graspfx.loop.tick.script import Tick

if TYPE_CHECKING:
    from subprocess import Popen

    from graspfx.compile.native import Spread

LOADING = 100_000  # ticks to come that are worth a look for a program that was specialised before,
SPECIALISING = 10_000_000  # and those that are worth specialising one
LOOKING = 1024  # ticks between two looks whether it is there


class AutoEngine:
    """Generic kernels from the first tick on; a program specialised for the scene where many ticks are to come.

    All compute the same bits, so that it does not matter to a recording when it changes. What is worth a program is
    counted in ticks: those to come of a call, or as many as there have been. Without LLVM the script runs as it stands.
    """

    def __init__(self, tick: Tick) -> None:
        self._tick = tick
        self._engine: Engine = _first(tick)
        self._rows: FloatArray | None = None
        self._asked_for, self._after, self._since = 0, 0, 0  # ticks: so far, before the program, since the last look
        self._left = [(LOADING, self._load), (SPECIALISING, self._specialise)] if self._is_generic else []
        self._process: Popen[bytes] | None = None

    @property
    def _is_generic(self) -> bool:
        return isinstance(self._engine, Generic)

    @property
    def patience(self) -> int:
        return self._engine.patience

    @property
    def name(self) -> str:
        return f"{self._engine.name} after {self._after} ticks" if self._after else self._engine.name

    def expect(self, ticks: int) -> None:
        worth = max(ticks, self._asked_for)
        while self._left and worth >= self._left[0][0]:
            self._left.pop(0)[1]()
        self._asked_for += ticks

    def write_to(self, rows: FloatArray) -> None:
        self._rows = rows
        self._engine.write_to(rows)

    def run(self, k: int, count: int, row: int) -> int:
        self._look(k, count)
        return self._engine.run(k, count, row)

    @property
    def each(self) -> Run:
        return self._engine.each if self._process is None else self.run

    def spread(self, k: int, count: int) -> Spread | None:
        self._look(k, count)
        return self._engine.spread(k, count)

    def begin(self, k: int) -> None:
        self._look(k, 1)
        self._engine.begin(k)

    def end(self, k: int, row: int) -> None:
        self._engine.end(k, row)

    def _look(self, k: int, count: int) -> None:
        """Take the specialised program before tick k if it is there by now."""
        if self._process is None:
            return
        self._since += count
        if self._since >= LOOKING:
            self._since = 0
            code = self._process.poll()
            if code is not None:
                self._process = None
                log.info("the process that specialises the tick ended with code %d", code)
                self._take(k)

    def _load(self) -> None:
        self._take(self._asked_for)

    def _specialise(self) -> None:
        """Let another process specialise the tick's program, unless it has been loaded."""
        if self._is_generic:
            script = self._tick.script
            arrays = [*script.arrays, "rows"]
            lines = texts(self._tick).values()
            self._process = begin([Request(text, script.kernels, arrays, script.frozen) for text in lines])

    def _take(self, k: int) -> None:
        """Go over to the specialised program before tick k, if it is in the cache."""
        with suppress(MissingPackageError, InputError, LookupError):
            engine = Compiled(self._tick, make=False)
            if self._rows is not None:
                engine.write_to(self._rows)
            self._engine, self._after = engine, k
            log.info("a specialised program takes over after %d ticks", k)


def _first(tick: Tick) -> Engine:
    """Choose the engine of the first tick."""
    try:
        return Generic(tick)
    except KernelError:
        raise
    except (MissingPackageError, InputError) as error:
        log.info("ticks are interpreted: %s", error)
        return Interpreted(tick)


ENGINES: dict[str, Callable[[Tick], Engine]] = {
    "auto": AutoEngine,
    "generic": Generic,
    "compiled": Compiled,
    "interpreted": Interpreted,
}


def engine_for(kind: str, tick: Tick) -> Engine:
    """Make the engine of a name; the first ticks of a scene with kernels of others are checked.

    Raises:
        MissingPackageError: an engine that needs LLVM, without it.
        InputError: a kernel that cannot be compiled, where that is asked for.
        KernelError: a kernel of others with a fault.
    """
    kernels = foreign_kernels(tick.script.kernels)
    if not kernels:
        return ENGINES[kind](tick)
    functions = check(kernels.values())
    return FirstTicks(ENGINES[kind](tick), CheckedScript(tick, kernels, functions))
