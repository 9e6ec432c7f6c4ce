"""Programs as executable machine code."""

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
    """Program with fixed buffers.

    Args:
        brief: Function that takes the program's numbers and runs the program. It does not release the interpreter's
            lock, and is suitable for calls of a few microseconds.
        long: Function that does the same as `brief` and releases the interpreter's lock, so that other threads can run.
        pointers: Pointers to the buffers by name. Each pointer holds a reference to its buffer.
    """

    brief: Run
    long: Run
    pointers: Mapping[str, ctypes.c_void_p] = field(default_factory=dict)


class Native:
    """Machine code of a program.

    Args:
        description: Buffers, numbers and library functions of the program, from `description_of`.
        engine: LLVM's engine or shared library that contains the machine code.
        size: Size of the machine code [bytes].
        place: Folder from which the machine code was loaded; empty if this process has compiled it.
        note: Reason why the machine code could not be written to the cache; empty if there is none.
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
        """Whether the machine code was loaded from a file instead of being compiled by this process."""
        return bool(self.place)

    @property
    def callback(self) -> int:
        """Address of a function that other machine code can call; its argument is the address of a table.

        The table contains the addresses of the program's buffers, and then the program's numbers.
        """
        return address(self._engine, CALLBACK)

    def bind(self, *buffers: Any) -> Bound:
        """Return the program with fixed buffers.

        Args:
            buffers: Arrays or memoryviews of floats, which must not move in memory.

        Raises:
            InputError: If the number of buffers is wrong, or a buffer is not contiguous, not writable, or does not
                contain floats.
        """
        if len(buffers) != len(self.arrays):
            raise InputError("buffers", len(buffers), f"{len(self.arrays)}: {', '.join(self.arrays)}")
        return self._bound({name: _pointer(name, buffer) for name, buffer in zip(self.arrays, buffers, strict=True)})

    def rebind(self, bound: Bound, name: str, buffer: Any) -> Bound:
        """Return a copy of a binding with another buffer for the parameter `name`, ten times as fast as `bind`."""
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
    """Load the machine code of a program from the cache, or compile the program.

    Args:
        source: Text of the program in Python. The last function is the entry. Its parameters are buffers of floats,
            followed by numbers, and it returns an integer or nothing.
        floats: Names of the entry's parameters that are floats; all other numbers are integers.
        apart: Whether no two buffers overlap in memory.
        make: Whether a program that is not in the cache is compiled. If False, a LookupError is raised instead.

    Raises:
        MissingPackageError: If LLVM is not installed.
        InputError: If the program contains statements that cannot be compiled.
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
    """Load the machine code with a key from the cache; None if the cache does not contain it."""
    entry = disk.load(key)
    if entry is None:
        return None
    head, _, machine = entry.partition(b"\n")
    log.info("program %s: %d kB of machine code from the cache", key[:12], len(machine) // 1000)
    description = json.loads(head)
    engine = loaded([machine], description["libm"])
    return Native(description, engine, size=len(machine), place=disk.folder_text())


def description_of(program: LlvmProgram) -> dict[str, Any]:
    """Return the names of a program's buffers, the types of its numbers, and the C functions that it calls."""
    return {"arrays": list(program.arrays), "numbers": program.numbers, "libm": program.libm}


def text_of(program: LlvmProgram) -> str:
    """Return the LLVM text of a program, including the functions by which Python and machine code call its entry."""
    return f"{program.text}{method_text(ENTRY, len(program.arrays), program.numbers)}\n"


def _shared(name: str, buffer: Any) -> Any:
    """Return a ctypes array that shares the memory of a buffer and holds a reference to the buffer."""
    view = memoryview(buffer)
    if view.format != "d" or not view.c_contiguous or view.readonly or not view.nbytes:
        raise InputError(name, buffer, "a contiguous, writable, non-empty buffer of float64")
    return (ctypes.c_double * (view.nbytes // 8)).from_buffer(view)


def _pointer(name: str, buffer: Any) -> ctypes.c_void_p:
    """Return a pointer to a buffer. The pointer holds a reference to the buffer."""
    memory = _shared(name, buffer)
    pointer = ctypes.c_void_p(ctypes.addressof(memory))
    pointer.memory = memory  # type: ignore[attr-defined]
    return pointer
