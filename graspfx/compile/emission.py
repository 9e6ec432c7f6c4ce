"""Emission of machine code from LLVM text, and loading of machine code."""

from __future__ import annotations

import ctypes
import ctypes.util
import hashlib
import sys
from collections.abc import Iterable, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from graspfx.compile.llvm.method import DECLARED, python_function
from graspfx.errors import MissingPackageError

NEEDED = ("floor", "ceil", "trunc", "memset", "memcpy", "memmove")  # functions that LLVM may call by itself
FULL = 1  # LLVM's level of optimisation
SMALL = 2  # a level with more passes, which reduce code size
_ENGINES: list[Any] = []  # engines whose functions LLVM finds by name at any time


def require_llvm() -> None:
    """Check that LLVM can be imported.

    Raises:
        MissingPackageError: If LLVM is not installed.
    """
    try:
        import_module("llvmlite")
    except ImportError as error:
        raise MissingPackageError("llvmlite", "a compiled loop", "run `pip install llvmlite`") from error


def emitted(text: str) -> bytes:
    """Return the machine code of a program, given as LLVM text, for this processor, as an object file."""
    return _emitted(text, _machine(), FULL)


def portable(text: str, triple: str, processor: str) -> bytes:
    """Return machine code of a program for another platform and processor, to be linked as a shared library."""
    return _emitted(text, _target(triple, cpu=processor, opt=FULL, reloc="pic"), FULL)


def small(text: str, triple: str, features: str) -> bytes:
    """Return machine code of a program for another platform, optimised for size, to be linked without other code."""
    machine = _target(triple, features=features, opt=SMALL, reloc="static", codemodel="default")
    head = f'target triple = "{triple}"\ntarget datalayout = "{machine.target_data}"\n'
    return _emitted(head + text.replace(" nounwind {", " nounwind optsize {"), machine, SMALL)


def _target(triple: str, **options: Any) -> Any:
    """Return LLVM's target machine for a platform; the options are those of `create_target_machine`."""
    import llvmlite.binding as llvm

    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    return llvm.Target.from_triple(triple).create_target_machine(**options)


def _emitted(text: str, machine: Any, level: int) -> bytes:
    import llvmlite.binding as llvm

    module = llvm.parse_assembly(text)
    module.verify()
    tuning = llvm.create_pipeline_tuning_options(speed_level=level)
    # Loops are short and are already unrolled where that helps. Vector loads of entries that were stored one by one
    # stall.
    tuning.loop_vectorization = tuning.slp_vectorization = tuning.loop_interleaving = tuning.loop_unrolling = False
    passes = llvm.create_pass_builder(machine, tuning)
    passes.getModulePassManager().run(module, passes)
    return bytes(machine.emit_object(module))


def loaded(objects: Iterable[bytes], libm: Iterable[str]) -> Any:
    """Load machine code and return LLVM's engine, to which a reference must exist as long as the code may be called.

    Args:
        objects: Object files, which may call functions of one another and functions registered by `show`.
        libm: Names of functions of the C library. Object files call the function NAME as `graspfx_NAME`.
    """
    import llvmlite.binding as llvm

    _define(libm)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _machine())
    for machine in objects:
        engine.add_object_file(llvm.object_file.ObjectFileRef.from_data(machine))
    engine.finalize_object()
    return engine


def address(engine: Any, name: str) -> int:
    """Return the address of a function by its name in the machine code of an engine.

    Raises:
        OSError: If the function does not exist.
    """
    place = int(engine.get_function_address(name))
    if not place:
        raise OSError(f"the machine code has no function {name}")
    return place


def show(engine: Any, names: Iterable[str]) -> None:
    """Make functions of an engine available by name to machine code that is loaded later. The engine is never freed."""
    import llvmlite.binding as llvm

    _ENGINES.append(engine)
    for name in names:
        llvm.add_symbol(name, address(engine, name))


@cache
def platform() -> tuple[str, ...]:
    """Return the digest of the back end, the version of LLVM and the processor, on which machine code depends."""
    import llvmlite
    import llvmlite.binding as llvm

    return _back_end(), llvmlite.__version__, str(llvm.llvm_version_info), *_processor()


@cache
def _back_end() -> str:
    """Return the digest of the source files of the back end, so that code from other versions is not used."""
    here = Path(__file__)
    sources = sorted([*here.with_name("llvm").glob("*.py"), here, here.with_name("native.py")])
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()


@cache
def _processor() -> tuple[str, str, str]:
    """Return the triple, the name and the features of this processor, as LLVM names them."""
    import llvmlite.binding as llvm

    return llvm.get_process_triple(), llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def _machine() -> Any:
    """Return a new target machine for this processor. An engine takes ownership of its target machine."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    triple, name, features = _processor()
    return llvm.Target.from_triple(triple).create_target_machine(
        cpu=name, features=features, opt=FULL, codemodel="jitdefault", jit=True
    )


def _define(libm: Iterable[str]) -> None:
    """Register the addresses of library functions that machine code calls.

    LLVM does not report missing functions; their calls would crash.

    Raises:
        MissingPackageError: If the C library lacks a function.
    """
    import llvmlite.binding as llvm

    for name, library in [(n, n) for n in NEEDED] + [(f"graspfx_{n}", n) for n in libm]:
        if llvm.address_of_symbol(name) is None:
            function = _function(library)
            if function is None:
                raise MissingPackageError(library, "a compiled loop", "the platform's C library lacks this function")
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
def _libraries() -> Sequence[ctypes.CDLL]:
    """Return the C libraries of the platform."""
    if sys.platform == "win32":
        return ctypes.CDLL("ucrtbase"), ctypes.CDLL("vcruntime140")
    names = [ctypes.util.find_library("m"), None]
    return tuple(ctypes.CDLL(name) for name in names)
