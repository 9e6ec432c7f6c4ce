"""Programs that run: compiled to machine code by LLVM, or interpreted."""

from __future__ import annotations

import ctypes
import ctypes.util
import hashlib
import json
import linecache
import math
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from time import perf_counter
from typing import Any

from graspfx import log
from graspfx.compile import cache as disk
from graspfx.compile.llvm.llvm import ENTRY, LlvmProgram, llvm_program
from graspfx.compile.llvm.llvm_arithmetic import FLOAT
from graspfx.compile.llvm.llvm_expressions import NAMES
from graspfx.compile.llvm.method import DECLARED, METHOD, method, method_text, python_function
from graspfx.errors import InputError, MissingPackageError

NEEDED = ("floor", "ceil", "trunc", "memset", "memcpy", "memmove")  # what LLVM may call of its own accord
FULL, QUICK = 1, 0  # LLVM's levels of optimisation; loops over lanes take LANES
LANES = 3
OUTSIDE = -(2**63)

Run = Callable[..., int]


@dataclass(frozen=True)
class Bound:
    """A program with its buffers, which it keeps.

    Args:
        brief: runs it, given its numbers; for calls of some microseconds, the interpreter's lock held.
        long: the same with the lock released: other threads run meanwhile.
        pointers: to the buffers, by name; each holds its own.
    """

    brief: Run
    long: Run
    pointers: Mapping[str, ctypes.c_void_p] = field(default_factory=dict)


class Native:
    """A program as machine code.

    Args:
        cached: whether it was found on disk, already compiled.
        note: what stood in the way of keeping it on disk; empty if nothing did.
    """

    def __init__(self, description: dict[str, Any], machine: bytes, *, cached: bool, note: str = "") -> None:
        import llvmlite.binding as llvm

        self.cached, self.note = cached, note
        self.size = len(machine)
        self.arrays: list[str] = description["arrays"]
        self.checked: bool = description["checked"]
        _define(description["libm"])
        target = _machine()
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), target)  # the code lives as long as this
        self._engine.add_object_file(llvm.object_file.ObjectFileRef.from_data(machine))
        self._engine.finalize_object()
        address = self._address(ENTRY)
        pointers = [ctypes.c_void_p] * len(self.arrays)
        numbers = [ctypes.c_double if type_ == FLOAT else ctypes.c_int64 for type_ in description["numbers"]]
        self._method = self._address(METHOD)
        self._long = ctypes.CFUNCTYPE(ctypes.c_int64, *pointers, *numbers)(address)
        self._long.engine = self._engine  # type: ignore[attr-defined] # whoever may call holds the code

    def _address(self, name: str) -> int:
        address = int(self._engine.get_function_address(name))
        if not address:
            raise OSError(f"the machine code has no {name}")
        return address

    def bind(self, *buffers: Any) -> Bound:
        """Bind the program to these buffers: arrays or memoryviews of floats that stay where they are.

        Raises:
            InputError: not so many buffers, or one that is not contiguous, writable and of floats.
        """
        if len(buffers) != len(self.arrays):
            raise InputError("buffers", len(buffers), f"{len(self.arrays)}: {', '.join(self.arrays)}")
        return self._bound({name: _pointer(name, buffer) for name, buffer in zip(self.arrays, buffers, strict=True)})

    def rebind(self, bound: Bound, name: str, buffer: Any) -> Bound:
        """Bind the program to the same buffers but for one, in a tenth of the time of `bind`."""
        return self._bound({**bound.pointers, name: _pointer(name, buffer)})

    def _bound(self, pointers: dict[str, ctypes.c_void_p]) -> Bound:
        brief: Run = method(self._method, list(pointers.values()), self._engine)
        long: Run = partial(self._long, *pointers.values())
        if self.checked:
            lengths = {name: len(pointer.memory) for name, pointer in pointers.items()}  # type: ignore[attr-defined]
            brief, long = self._watched(brief, lengths), self._watched(long, lengths)
        return Bound(brief, long, pointers)

    def _watched(self, run: Run, lengths: dict[str, int]) -> Run:
        """Check every index of a program: one outside of its buffer is an error."""
        places = {name: ctypes.c_int64.from_address(self._global(f"length.{name}")) for name in lengths}
        outside = ctypes.c_int64.from_address(self._global("graspfx_outside"))

        def checked(*numbers: float) -> int:
            for name, length in lengths.items():
                places[name].value = length
            outside.value = OUTSIDE
            result = run(*numbers)
            if outside.value != OUTSIDE:
                raise IndexError(f"entry {outside.value} of a buffer: {lengths}")
            return result

        return checked

    def _global(self, name: str) -> int:
        return int(self._engine.get_global_value_address(name))


class Interpreted:
    """A program that Python runs as it is."""

    def __init__(self, source: str) -> None:
        name = f"<program {hashlib.sha256(source.encode()).hexdigest()[:12]}>"
        linecache.cache[name] = len(source), None, source.splitlines(keepends=True), name  # for tracebacks
        namespace: dict[str, Any] = {"math": math, **NAMES}
        exec(compile(source, name, "exec"), namespace)
        self.arrays: list[str] = []
        self._entry = [f for f in namespace.values() if getattr(f, "__code__", None) is not None][-1]

    def bind(self, *buffers: Any) -> Bound:
        """Bind the program to these buffers; one that is no memoryview becomes one, since Python reads them faster."""
        views = [memoryview(buffer) for buffer in buffers]

        def run(*numbers: float) -> int:
            result = self._entry(*views, *numbers)
            return 0 if result is None else int(result)

        return Bound(run, run)


def interpreted(source: str) -> Interpreted:
    """Make a program that Python runs."""
    return Interpreted(source)


def compiled(
    source: str,
    floats: Collection[str] = (),
    *,
    checked: bool = False,
    quick: bool = False,
    wide: bool = False,
    lanes: int = 0,
    shared: Mapping[str, int] | None = None,
    make: bool = True,
) -> Native:
    """Compile a program to machine code, or take it from the cache.

    Args:
        source: the program as Python, its last function the entry, which takes buffers of floats and then numbers, and
            returns a whole number or nothing.
        floats: the entry's parameters that are floats; its other numbers are whole.
        checked: whether an index outside of its buffer is an error (`IndexError` after the call) and not a crash.
        quick: compile in a tenth of the time what then takes some times as long to run, the same bits; not if better
            code is in the cache.
        wide: with the longest vectors that the processor has, the same bits; worth it where loops over lanes are all
            that a program does.
        lanes: for so many side by side, each with buffers of its own (`graspfx.compile.lanes`), if any.
        shared: by buffer, the entry from which on lanes have the same ones.
        make: whether to compile what is not in the cache; else a LookupError.

    Raises:
        MissingPackageError: no LLVM.
        InputError: the program holds something that cannot be compiled.
    """
    require_llvm()
    import llvmlite
    import llvmlite.binding as llvm

    names = [llvmlite.__version__, str(llvm.llvm_version_info), *_processor()]
    parts = [_back_end(), *names, ",".join(sorted(floats)), str(checked), str(wide), source]
    if lanes:
        parts.append(f"{lanes} lanes {sorted((shared or {}).items())}")
    for effort in (FULL, QUICK) if quick else (FULL,):
        key = hashlib.sha256("\0".join([str(effort), *parts]).encode()).hexdigest()
        entry = disk.load(key)
        if entry is not None:
            head, _, machine = entry.partition(b"\n")
            log.info("program %s: %d kB of machine code from the cache", key[:12], len(machine) // 1000)
            return Native(json.loads(head), machine, cached=True)
    if not make:
        raise LookupError("not compiled yet")
    began = perf_counter()
    program = _program_text(source, floats, lanes, shared or {}, checked=checked)
    description = {"arrays": program.arrays, "numbers": program.numbers, "libm": program.libm, "checked": checked}
    machine = _emitted(program, effort, wide=wide)
    log.info("program %s: compiled in %.2f s, %d kB", key[:12], perf_counter() - began, len(machine) // 1000)
    note = disk.store(key, json.dumps(description).encode() + b"\n" + machine)
    return Native(description, machine, cached=False, note=note)


def _program_text(
    source: str, floats: Collection[str], lanes: int, shared: Mapping[str, int], *, checked: bool
) -> LlvmProgram:
    """Write a program in LLVM's language, for one or for many side by side."""
    if not lanes:
        return llvm_program(source, floats, checked=checked)
    from graspfx.compile.lanes.lane_program import lane_program

    return lane_program(source, lanes, shared)


def require_llvm() -> None:
    """Require LLVM.

    Raises:
        MissingPackageError: it is not installed.
    """
    try:
        import_module("llvmlite")
    except ImportError as error:
        raise MissingPackageError("llvmlite", "a compiled loop", "run `pip install llvmlite`") from error


def _emitted(program: LlvmProgram, effort: int = FULL, *, wide: bool = False) -> bytes:
    """Emit machine code."""
    import llvmlite.binding as llvm

    level = LANES if program.lanes and effort == FULL else effort
    machine = _machine(level, wide=wide)
    wrapper = method_text(ENTRY, len(program.arrays), program.numbers)
    module = llvm.parse_assembly(f"{program.text}{wrapper}\n")
    module.verify()
    tuning = llvm.create_pipeline_tuning_options(speed_level=level)
    # Else loops are short and were written out where that helps; and vectors read what was written entry by entry,
    # which waits.
    tuning.loop_vectorization = tuning.slp_vectorization = tuning.loop_interleaving = program.lanes
    tuning.loop_unrolling = program.lanes
    passes = llvm.create_pass_builder(machine, tuning)
    passes.getModulePassManager().run(module, passes)
    return bytes(machine.emit_object(module))


@cache
def _back_end() -> str:
    """Digest the sources of the back end: code that another version of it made is not used."""
    here = Path(__file__)
    sources = sorted([*(here.parent / "llvm").glob("*.py"), *(here.parent / "lanes").glob("*.py"), here])
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()


def _processor() -> tuple[str, str, str]:
    """Identify the processor: triple, name and features."""
    import llvmlite.binding as llvm

    return llvm.get_process_triple(), llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def side_by_side() -> int:
    """Count the lanes that fit this processor best: as many floats as its longest vectors hold.

    Raises:
        MissingPackageError: no LLVM.
    """
    require_llvm()
    _, _, features = _processor()
    return 8 if "+avx512f" in features.split(",") else 4


def _machine(effort: int = FULL, *, wide: bool = False) -> Any:
    """Make the machine that code is emitted for; an engine owns it, so that each needs one."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    triple, name, features = _processor()
    if wide and "avx512f" in features:
        features += ",-prefer-256-bit"  # of some processors LLVM has it that short vectors are the better choice
    return llvm.Target.from_triple(triple).create_target_machine(
        cpu=name, features=features, opt=effort, codemodel="jitdefault", jit=True
    )


def _define(libm: Sequence[str]) -> None:
    """Tell the loader where functions are; if it misses one, it silently leaves all calls undone."""
    import llvmlite.binding as llvm

    for name, library in [(n, n) for n in NEEDED] + [(f"graspfx_{n}", n) for n in libm]:
        if llvm.address_of_symbol(name) is None:
            function = _function(library)
            if function is None:
                raise MissingPackageError(library, "a compiled loop", "the platform's C library has no such function")
            llvm.add_symbol(name, function)
    for name in DECLARED:
        if llvm.address_of_symbol(name) is None:
            llvm.add_symbol(name, python_function(name))


def _function(name: str) -> int | None:
    for library in _libraries():
        with_name = getattr(library, name, None)
        if with_name is not None:
            return ctypes.cast(with_name, ctypes.c_void_p).value
    return None


@cache
def _libraries() -> tuple[ctypes.CDLL, ...]:
    """Load the C libraries that Python itself computes with."""
    if sys.platform == "win32":
        return ctypes.CDLL("ucrtbase"), ctypes.CDLL("vcruntime140")
    names = [ctypes.util.find_library("m"), None]
    return tuple(ctypes.CDLL(name) for name in names)


def _shared(name: str, buffer: Any) -> Any:
    """Share a buffer's memory with a ctypes array, which keeps it alive."""
    view = memoryview(buffer)
    if view.format != "d" or not view.c_contiguous or view.readonly or not view.nbytes:
        raise InputError(name, buffer, "a contiguous writable buffer of floats (float64)")
    return (ctypes.c_double * (view.nbytes // 8)).from_buffer(view)


def _pointer(name: str, buffer: Any) -> ctypes.c_void_p:
    """Take the address of a buffer, which lives as long as the address."""
    memory = _shared(name, buffer)
    pointer = ctypes.c_void_p(ctypes.addressof(memory))
    pointer.memory = memory  # type: ignore[attr-defined]
    return pointer
