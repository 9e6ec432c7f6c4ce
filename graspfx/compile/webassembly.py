"""A program as a WebAssembly module: the same text as native code, one more target of LLVM, with musl's mathematics.

A wheel brings the module of `steps`. It is compiled with the pinned `ziglang`, which has a linker and musl's sources;
who installs a wheel needs neither. In a checkout the module is made at first use and kept in the cache.
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
from graspfx.errors import MissingPackageError
from graspfx.progress import waiting

if TYPE_CHECKING:
    from collections.abc import Callable

    from graspfx.compile.llvm.llvm import LlvmProgram

TRIPLE = "wasm32-unknown-unknown"
FEATURES = "+bulk-memory,+nontrapping-fptoint,+sign-ext"  # that browsers have since 2021
ZIG = "0.13.0"  # later ones have mathematics of their own, without musl's files
ARGUMENTS = {"sin": 1, "cos": 1, "tan": 1, "asin": 1, "acos": 1, "atan": 1, "exp": 1, "log": 1, "pow": 2, "atan2": 2}
SOURCES = (  # of musl/src/math: what those above are made of
    "ldexp", "scalbn", "fabs", "floor", "__sin", "__cos", "__tan", "__rem_pio2", "__rem_pio2_large", "exp_data",
    "pow_data", "log_data", "__math_divzero", "__math_invalid", "__math_oflow", "__math_uflow", "__math_xflow",
)  # fmt: skip
COMPILE = ("-c", "-O2", "-w", "-ffp-contract=off", "-fno-builtin", "-fPIC", "-fno-sanitize=all")
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
    name = hashlib.sha256("\0".join([key, TRIPLE, FEATURES, ZIG]).encode()).hexdigest()
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
        MissingPackageError: `ziglang` or llvmlite is not installed.
    """
    from graspfx.compile.native import text_of

    zig = _zig()
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "program.o").write_bytes(small(text_of(program), TRIPLE, FEATURES))
        maths = mathematics(program.libm, "wasm32-wasi", folder)
        words = [zig / "zig", "wasm-ld", *LINK, "-o", folder / "program.wasm", folder / "program.o", *maths]
        _call(words)
        return (folder / "program.wasm").read_bytes()


def mathematics(names: tuple[str, ...], target: str, folder: Path) -> list[Path]:
    """Compile the functions that kernels call from musl's sources for a target; nothing is contracted to FMA.

    Args:
        names: Functions of the C library.
        target: Target in Zig's words, as "wasm32-wasi" or "x86_64-linux-musl".
        folder: Folder of the object files.
    """
    zig = _zig()
    musl = zig / "lib/libc/musl"
    shim = [
        "double ldexp(double, int); double graspfx_ldexp(double x, int n) { return ldexp(x, n); }",
        "double sqrt(double x) { return __builtin_sqrt(x); }",
    ]  # an instruction
    for name in names:  # LLVM must not know the names in kernels: it would compute with its own
        if name != "ldexp":
            given = ", ".join(f"double x{k}" for k in range(ARGUMENTS[name]))
            own = ", ".join(f"x{k}" for k in range(ARGUMENTS[name]))
            shim.append(f"double {name}({given}); double graspfx_{name}({given}) {{ return {name}({own}); }}")
    (folder / "shim.c").write_text("\n".join(shim), encoding="ascii")
    arch = target.partition("-")[0]
    include = [
        f"-I{musl / each}" for each in ("src/internal", "src/include", f"arch/{arch}", "arch/generic", "include")
    ]
    files = [musl / f"src/math/{name}.c" for name in dict.fromkeys([*ARGUMENTS, *SOURCES])]
    for source in [folder / "shim.c", *files]:
        _call([zig / "zig", "cc", "-target", target, *COMPILE, *include, source, "-o", folder / f"m_{source.stem}.o"])
    return sorted(folder.glob("m_*.o"))


@cache
def _zig() -> Path:
    """Give the folder of `ziglang`."""
    found = find_spec("ziglang")
    if found is None or found.origin is None:
        raise MissingPackageError(
            "ziglang", "a page that runs by itself", f"run `pip install ziglang=={ZIG}.post1`, or install a wheel"
        )
    return Path(found.origin).parent


def _call(words: list[object]) -> None:
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True)
    if done.returncode:
        raise OSError(f"{words[0]}: {done.stderr.strip()}")
