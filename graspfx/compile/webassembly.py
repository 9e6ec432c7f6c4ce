"""A program as a WebAssembly module: the same text as native code, for one more target of LLVM.

Kernels call no library (`graspfx.elementary`), so that a module computes the bits of native code. A wheel brings the
module of `steps`; its linker is that of `ziglang`, which users of a wheel do not need. In a checkout the module is
made at first use and kept in the cache.
"""

from __future__ import annotations

import hashlib
import subprocess
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from graspfx.compile import cache as disk
from graspfx.compile import library
from graspfx.compile.emission import small
from graspfx.errors import InputError, MissingPackageError
from graspfx.progress import waiting

if TYPE_CHECKING:
    from collections.abc import Callable

    from graspfx.compile.llvm.llvm import LlvmProgram

TRIPLE = "wasm32-unknown-unknown"
FEATURES = "+bulk-memory,+nontrapping-fptoint,+sign-ext"  # that browsers have since 2021
LINK = ("--no-entry", "--gc-sections", "--strip-all", "--export=graspfx_entry", "--export=__heap_base")


def module(key: str, program: Callable[[], LlvmProgram]) -> bytes:
    """Give the WebAssembly module of a program: what the installation brings, what the cache has, or a new one.

    Args:
        key: Name of the program and its sources.
        program: Gives the program in LLVM's language, if the module has to be made.

    Raises:
        MissingPackageError: The module has to be made, and `ziglang` or llvmlite is not installed.
    """
    shipped = library.read(module_key(key))
    if shipped is not None:
        return shipped
    name = hashlib.sha256("\0".join([key, TRIPLE, FEATURES]).encode()).hexdigest()
    kept = disk.load(name)
    if kept is None:
        with waiting("compiling kernels for browsers, once per version"):
            disk.store(name, kept := build(program()))
    return kept


def module_key(key: str) -> str:
    """Name the WebAssembly module of a program in the library."""
    return f"{key} for browsers"


def build(program: LlvmProgram) -> bytes:
    """Compile and link a program.

    The module exports `graspfx_entry(arena, rows, world, k, count, r)`, its memory and `__heap_base`, from which on the
    memory is free.

    Raises:
        InputError: The program calls functions of a platform's library.
        MissingPackageError: `ziglang` or llvmlite is not installed.
    """
    from graspfx.compile.native import text_of

    if program.libm:
        names = ", ".join(program.libm)
        raise InputError("program", names, "kernels that call no library", "use graspfx.elementary in kernels")
    zig = _zig()
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "program.o").write_bytes(small(text_of(program), TRIPLE, FEATURES))
        words = [zig / "zig", "wasm-ld", *LINK, "-o", folder / "program.wasm", folder / "program.o"]
        done = subprocess.run([str(word) for word in words], capture_output=True, text=True)
        if done.returncode:
            raise OSError(f"zig wasm-ld: {done.stderr.strip()}")
        return (folder / "program.wasm").read_bytes()


@cache
def _zig() -> Path:
    """Give the folder of `ziglang`."""
    found = find_spec("ziglang")
    if found is None or found.origin is None:
        raise MissingPackageError(
            "ziglang", "a page that runs by itself", "run `pip install ziglang`, or install a wheel"
        )
    return Path(found.origin).parent
