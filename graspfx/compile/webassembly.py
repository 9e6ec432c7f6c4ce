"""WebAssembly modules of programs, compiled from the same LLVM text as native code.

Kernels call `graspfx.elementary` instead of a platform's library, so a WebAssembly module computes the same bits as
native code. A wheel of GraspFX contains the module of `graspfx.loop.step.steps`, so users of a wheel do not need the
linker of `ziglang`. In a checkout, the module is built at first use and cached.
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
FEATURES = "+bulk-memory,+nontrapping-fptoint,+sign-ext"  # supported by browsers since 2021
LINK = ("--no-entry", "--gc-sections", "--strip-all", "--export=graspfx_entry", "--export=__heap_base")


def module(key: str, program: Callable[[], LlvmProgram]) -> bytes:
    """Return the WebAssembly module of a program: from the installed library, from the cache, or newly built.

    Args:
        key: Key of the program in the library and the cache; the key includes the program's sources.
        program: Function that returns the LLVM program; it is called only if the module must be built.

    Raises:
        MissingPackageError: If the module must be built, and `ziglang` or llvmlite is not installed.
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
    """Return the name under which the library contains the WebAssembly module of a program."""
    return f"{key} for browsers"


def build(program: LlvmProgram) -> bytes:
    """Compile and link a program; return the WebAssembly module.

    The module exports `graspfx_entry(arena, rows, world, k, count, r)`, its memory, and `__heap_base`, the address at
    which free memory begins.

    Raises:
        InputError: If the program calls functions of a platform's library.
        MissingPackageError: If `ziglang` or llvmlite is not installed.
        OSError: If linking fails.
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
    """Return the folder of the package `ziglang`."""
    found = find_spec("ziglang")
    if found is None or found.origin is None:
        raise MissingPackageError(
            "ziglang", "a page that runs without a server", "run `pip install ziglang`, or install a wheel"
        )
    return Path(found.origin).parent
