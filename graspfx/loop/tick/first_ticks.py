"""The first ticks of a scene with kernels of others: interpreted, each index of theirs checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import FunctionType
from typing import TYPE_CHECKING, Any

from graspfx.compile.kernel_checks import checked_function
from graspfx.loop.tick.programs import Engine, FloatArray, Interpreted, Run
from graspfx.loop.tick.script import Tick

if TYPE_CHECKING:
    from graspfx.compile.native import Spread

FIRST = 16  # ticks


class CheckedScript(Interpreted):
    """The script as it stands, with kernels of others on checked buffers."""

    def __init__(
        self, tick: Tick, kernels: Mapping[str, Callable[..., Any]], functions: Mapping[str, FunctionType]
    ) -> None:
        super().__init__(tick)
        self._names.update({name: checked_function(kernel, functions) for name, kernel in kernels.items()})


class FirstTicks:
    """Checked ticks at the beginning of a run, then those of an engine: the same bits.

    Args:
        engine: takes over after `FIRST` ticks.
        checked: runs those before.
    """

    def __init__(self, engine: Engine, checked: CheckedScript) -> None:
        self._engine, self._checked = engine, checked
        self._left = FIRST

    @property
    def name(self) -> str:
        return self._engine.name

    @property
    def patience(self) -> int:
        return self._engine.patience

    def expect(self, ticks: int) -> None:
        self._engine.expect(ticks)

    def write_to(self, rows: FloatArray) -> None:
        self._engine.write_to(rows)
        if self._left:
            self._checked.write_to(rows)

    def run(self, k: int, count: int, row: int) -> int:
        if not self._left:
            return self._engine.run(k, count, row)
        ticks = min(count, self._left)
        self._left -= ticks
        return self._checked.run(k, ticks, row)

    @property
    def each(self) -> Run:
        return self.run if self._left else self._engine.each

    def spread(self, k: int, count: int) -> Spread | None:
        return None if self._left else self._engine.spread(k, count)

    def begin(self, k: int) -> None:
        (self._checked if self._left else self._engine).begin(k)

    def end(self, k: int, row: int) -> None:
        if not self._left:
            self._engine.end(k, row)
            return
        self._left -= 1
        self._checked.end(k, row)
