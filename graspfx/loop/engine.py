"""Engines that run the program `steps` of ticks, either compiled to machine code or interpreted by Python.

The machine code is the same for all scenes.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from types import FunctionType
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from graspfx import log
from graspfx.compile.cache import lock_folder
from graspfx.compile.emission import require_llvm
from graspfx.compile.kernel import keep_lowerings, source_function, written
from graspfx.compile.kernel_checks import check, checked_function
from graspfx.compile.own_sources import is_own
from graspfx.errors import InputError, KernelError, MissingPackageError
from graspfx.loop.arena import Arena, ForeignKernel
from graspfx.loop.kernels import announce
from graspfx.loop.step_program import program_key, source
from graspfx.progress import is_heard, waiting
from graspfx.system.file_lock import alone

if TYPE_CHECKING:
    from graspfx.compile.native import Bound, Native

FloatArray = NDArray[np.float64]
Kernel = Callable[..., Any]

FIRST = 16  # number of ticks for which third-party kernels are interpreted and checked before machine code takes over


class Interpreted:
    """Engine that runs ticks in Python; it checks every index that a third-party kernel uses.

    Args:
        arena: Arena of the scene.

    Raises:
        KernelError: If a third-party kernel has a fault.
    """

    name = "interpreted"
    patience = 1  # largest number of ticks per call; it bounds the delay of a stop

    def __init__(self, arena: Arena) -> None:
        from graspfx.loop.step import steps

        kernels = [each.kernel for each in arena.foreign]
        functions = check(kernel for kernel in kernels if not is_own(_file(kernel)))
        self.is_checked = bool(functions)
        self._steps, self._buffer, self._world = source_function(steps), arena.buffer, arena.offset
        self._arena = arena
        self._foreign = [
            (each, _on_blocks(arena, each, checked_function(each.kernel, functions))) for each in arena.foreign
        ]
        self._rows: Any = None
        keep_lowerings()

    def write_to(self, rows: FloatArray) -> None:
        """Set the rows (r, width) to which the following ticks are recorded."""
        self._rows = memoryview(rows.reshape(-1))

    def run(self, k: int, count: int, row: int) -> int:
        """Run the ticks k, ..., k + count - 1, recorded from the row `row` on; return the number of completed ticks."""
        for each, function in self._foreign:
            for entry in each.entries:
                self._arena.world.buffer[entry] = float(announce(function))
        return int(self._steps(self._buffer, self._world, k, count, row, self._rows, 0))


class Compiled:
    """Engine that runs ticks in machine code.

    Args:
        arena: Arena of the scene.

    Raises:
        MissingPackageError: If the program has not been compiled in advance and LLVM is not installed.
        InputError: If a third-party kernel cannot be compiled.
        KernelError: If a third-party kernel has a fault.
    """

    name = "compiled"
    patience = 64

    def __init__(self, arena: Arena) -> None:
        if not is_machine_code():
            require_llvm()
        self._arena, self.world, self._program = arena, arena.offset, program()
        first = Interpreted(arena) if arena.foreign else None
        self._first = first if first is not None and first.is_checked else None
        self._left = FIRST if self._first is not None else 0  # number of ticks still to be checked
        self._machine = machine_codes(arena)  # keeps the code alive while it may be called
        self._bound: Bound | None = None
        self._rows: FloatArray | None = None
        self.keep: list[Any] = []  # keeps the memory behind the arena's addresses alive
        self._addressed = False

    def write_to(self, rows: FloatArray) -> None:
        """Set the rows (r, width) to which the following ticks are recorded."""
        if rows is self._rows:
            return
        self._rows, flat = rows, rows.reshape(-1)
        floats = self._arena.memory.floats
        self._bound = (
            self._program.bind(floats, flat) if self._bound is None else self._program.rebind(self._bound, "rows", flat)
        )
        self._brief, self._long = self._bound.brief, self._bound.long
        if self._first is not None:
            self._first.write_to(rows)

    def run(self, k: int, count: int, row: int) -> int:
        """Run ticks from k on, recorded from the row `row` on; return the number of completed ticks.

        At most `count` ticks are completed; fewer while third-party kernels are checked.
        """
        if self._left and self._first is not None:
            done = self._first.run(k, min(count, self._left), row)
            self._left -= done
            return done
        if not self._addressed:
            self._address()
        run = self._brief if count == 1 or self._arena.world.exchanging else self._long
        return run(self.world, k, count, row)

    @property
    def is_checking(self) -> bool:
        """Whether the next tick will be interpreted in order to check third-party kernels."""
        return self._left > 0

    @property
    def entry(self) -> int:
        """Address of the machine code, for calls from other machine code.

        The signature is i64 (arena, rows, world, k, count, row), with the arguments of `run`.
        """
        if not self._addressed:
            self._address()
        assert self._program.arrays == ["arena", "rows"]
        return self._program.entry

    def _address(self) -> None:
        """Write the addresses of third-party kernels into the world."""
        for each, native in self._machine:
            for entry in each.entries:
                self._arena.world.buffer[entry] = float(native.entry)
        self._addressed = True


Engine = Interpreted | Compiled


def engine_for(kind: str, arena: Arena) -> Engine:
    """Make an engine for an arena.

    Args:
        kind: "interpreted", "compiled", or "auto" for compiled ticks where possible and otherwise interpreted ticks.
        arena: Arena of the scene.

    Raises:
        MissingPackageError: If `kind` is "compiled", but LLVM is needed and not installed.
        InputError: If `kind` is "compiled", but a kernel cannot be compiled.
        KernelError: If a third-party kernel has a fault.
    """
    if kind == "interpreted":
        return Interpreted(arena)
    try:
        return Compiled(arena)
    except KernelError:
        raise
    except (MissingPackageError, InputError) as error:
        if kind != "auto":
            raise
        log.info("ticks are interpreted: %s", error)
        return Interpreted(arena)


@cache
def program() -> Native:
    """Load the compiled program that runs the ticks of all scenes; if it is not found, compile and store it."""
    from graspfx.compile.native import compiled

    kept = kept_program()
    if kept is not None:
        return kept
    text = "compiling kernels, once per version and machine"
    if not is_heard() and sys.stderr is not None and sys.stderr.isatty():
        print(f"{text} ...", file=sys.stderr, flush=True)  # compiling at the first use makes the user wait
    with waiting(text), alone(lock_folder(), "kernels") as waited:
        kept = kept_program() if waited else None  # another process may have compiled it in the meantime
        return kept or compiled(source())


def kept_program() -> Native | None:
    """Load the program that runs ticks, if it was compiled in advance or by an earlier run; otherwise return None."""
    from graspfx.compile import library

    if (shipped := library.find(program_key())) is not None:
        return shipped
    if find_spec("llvmlite") is None:
        return None
    from graspfx.compile.native import compiled

    try:
        return compiled(source(make=False), make=False)
    except LookupError:
        return None


def is_machine_code() -> bool:
    """Return whether ticks can be compiled: LLVM or the program compiled in advance is installed."""
    from graspfx.compile import library

    return find_spec("llvmlite") is not None or library.has(program_key())


def machine_codes(arena: Arena) -> list[tuple[ForeignKernel, Native]]:
    """Compile the third-party kernels of a scene.

    Raises:
        InputError: If a kernel cannot be compiled.
    """
    return [(each, _machine_code(each)) for each in arena.foreign]


def _on_blocks(arena: Arena, foreign: ForeignKernel, function: Kernel) -> Kernel:
    """Return a function that calls a third-party kernel with its own blocks instead of the arena's buffer."""
    views = [memoryview(each) for each in foreign.blocks]
    starts = [arena.place(each) for each in foreign.blocks]

    def run(buffer: Any, place: int, *rest: Any) -> Any:
        if "beside" in foreign.parameters:
            _, beside, T = rest
            return function(views[0], place - starts[0], views[1], beside - starts[1], T)
        return function(views[0], place - starts[0], *rest)

    return run


def _machine_code(foreign: ForeignKernel) -> Native:
    """Compile a third-party kernel to a function of the place of its block and of the kernel's other arguments."""
    from graspfx.compile.definitions import definition
    from graspfx.compile.native import compiled
    from graspfx.compile.program import program_source

    parameters = ", ".join(["place", *foreign.parameters])
    call = f"kernel(arena, {parameters})".replace("beside", "arena, beside")
    touch = "arena[place] = arena[place]"  # the buffer is the first argument even if the kernel does not use it
    tree = definition(cast("FunctionType", written(foreign.kernel)))
    gives = any(isinstance(node, ast.Return) and node.value is not None for node in ast.walk(tree))
    text = f"def run({parameters}):\n    {touch}\n    " + (f"return int({call})" if gives else f"{call}\n    return 0")
    floats = [name for name in foreign.parameters if name != "beside"]
    return compiled(program_source(text, {"kernel": foreign.kernel}, ["arena"]), floats)


def _file(kernel: Kernel) -> str:
    code = getattr(written(kernel), "__code__", None)
    return "" if code is None else str(code.co_filename)
