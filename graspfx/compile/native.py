"""Executable programs: machine code by LLVM."""

from __future__ import annotations

import ctypes
import hashlib
import json
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING, Any

from graspfx import log
from graspfx.compile import cache as disk
from graspfx.compile.emission import address, emitted, loaded, platform, require_llvm
from graspfx.compile.llvm.llvm_arithmetic import FLOAT
from graspfx.compile.llvm.method import CALLBACK, ENTRY, METHOD, method, method_text
from graspfx.errors import InputError

if TYPE_CHECKING:
    from graspfx.compile.llvm.llvm import LlvmProgram


Run = Callable[..., int]


@dataclass(frozen=True)
class Bound:
    """A program bound to its buffers.

    Args:
        brief: Function of the program's numbers that runs the program with the interpreter's lock held, for calls of a
            few microseconds.
        long: Same function with the lock released, so that other threads can run.
        pointers: Pointers to the buffers by name; each keeps its buffer alive.
    """

    brief: Run
    long: Run
    pointers: Mapping[str, ctypes.c_void_p] = field(default_factory=dict)


class Native:
    """A program as machine code.

    Args:
        description: Description of the program's arguments and library functions (`description_of`).
        engine: Engine that has loaded the machine code.
        size: Size of the machine code [bytes].
        place: Location from which the machine code was loaded; empty if it was compiled now.
        note: Reason why the machine code could not be cached; empty otherwise.
    """

    def __init__(self, description: dict[str, Any], engine: Any, *, size: int, place: str = "", note: str = "") -> None:
        self.size, self.place, self.note = size, place, note
        self.arrays: list[str] = description["arrays"]
        self._engine = engine  # keeps the code alive
        self.entry = entry = address(self._engine, ENTRY)  # arguments of the code: its buffers, then its numbers
        pointers = [ctypes.c_void_p] * len(self.arrays)
        numbers = [ctypes.c_double if type_ == FLOAT else ctypes.c_int64 for type_ in description["numbers"]]
        self._method = address(self._engine, METHOD)
        self._long = ctypes.CFUNCTYPE(ctypes.c_int64, *pointers, *numbers)(entry)
        self._long.engine = self._engine  # type: ignore[attr-defined] # keeps the code alive

    @property
    def cached(self) -> bool:
        """Whether the machine code was loaded from the cache or the library."""
        return bool(self.place)

    @property
    def callback(self) -> int:
        """Address of the function that takes the address of a table: the buffers' addresses, then the numbers."""
        return address(self._engine, CALLBACK)

    def bind(self, *buffers: Any) -> Bound:
        """Bind the program to buffers: arrays or memoryviews of floats with fixed addresses.

        Raises:
            InputError: If the number of buffers is wrong, or a buffer is not contiguous, not writable, or does not
                contain floats.
        """
        if len(buffers) != len(self.arrays):
            raise InputError("buffers", len(buffers), f"{len(self.arrays)}: {', '.join(self.arrays)}")
        return self._bound({name: _pointer(name, buffer) for name, buffer in zip(self.arrays, buffers, strict=True)})

    def rebind(self, bound: Bound, name: str, buffer: Any) -> Bound:
        """Replace one buffer of a binding, in a tenth of the time of `bind`."""
        return self._bound({**bound.pointers, name: _pointer(name, buffer)})

    def _bound(self, pointers: dict[str, ctypes.c_void_p]) -> Bound:
        brief: Run = method(self._method, list(pointers.values()), self._engine)
        long: Run = partial(self._long, *pointers.values())
        return Bound(brief, long, pointers)


def compiled(
    source: str,
    floats: Collection[str] = (),
    *,
    apart: bool = True,
    make: bool = True,
) -> Native:
    """Compile a program to machine code, or load it from the cache.

    Args:
        source: Program in Python. Its last function is the entry, which takes buffers of floats, then numbers, and
            returns an integer or nothing.
        floats: Float parameters of the entry; its other numbers are integers.
        apart: Whether all buffers are distinct memory.
        make: Whether to compile a program that is not cached; otherwise a LookupError is raised.

    Raises:
        MissingPackageError: If LLVM is not installed.
        InputError: If the program has unsupported statements.
    """
    require_llvm()
    parts = [str(apart), *platform(), ",".join(sorted(floats)), source]
    key = hashlib.sha256("\0".join(parts).encode()).hexdigest()
    native = from_cache(key)
    if native is not None:
        return native
    if not make:
        raise LookupError("not compiled yet")
    began = perf_counter()
    from graspfx.compile.llvm.llvm import llvm_program

    program = llvm_program(source, floats, apart=apart)
    description = description_of(program)
    machine = emitted(text_of(program))
    log.info("program %s: compiled in %.2f s, %d kB", key[:12], perf_counter() - began, len(machine) // 1000)
    note = disk.store(key, json.dumps(description).encode() + b"\n" + machine)
    return Native(description, loaded([machine], program.libm), size=len(machine), note=note)


def from_cache(key: str) -> Native | None:
    """Load a program from the cache; None if the cache has no program for the key."""
    entry = disk.load(key)
    if entry is None:
        return None
    head, _, machine = entry.partition(b"\n")
    log.info("program %s: %d kB of machine code from the cache", key[:12], len(machine) // 1000)
    description = json.loads(head)
    engine = loaded([machine], description["libm"])
    return Native(description, engine, size=len(machine), place=disk.folder_text())


def description_of(program: LlvmProgram) -> dict[str, Any]:
    """Return the description of a program's arguments and library functions, cached with its machine code."""
    return {"arrays": list(program.arrays), "numbers": program.numbers, "libm": program.libm}


def text_of(program: LlvmProgram) -> str:
    """Write a program and its entry functions in LLVM's language."""
    return f"{program.text}{method_text(ENTRY, len(program.arrays), program.numbers)}\n"


def _shared(name: str, buffer: Any) -> Any:
    """Share a buffer's memory with a ctypes array, which keeps it alive."""
    view = memoryview(buffer)
    if view.format != "d" or not view.c_contiguous or view.readonly or not view.nbytes:
        raise InputError(name, buffer, "a contiguous writable buffer of floats (float64)")
    return (ctypes.c_double * (view.nbytes // 8)).from_buffer(view)


def _pointer(name: str, buffer: Any) -> ctypes.c_void_p:
    """Return a pointer to a buffer, which keeps the buffer alive."""
    memory = _shared(name, buffer)
    pointer = ctypes.c_void_p(ctypes.addressof(memory))
    pointer.memory = memory  # type: ignore[attr-defined]
    return pointer
