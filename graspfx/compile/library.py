"""Precompiled programs that a wheel contains, so that runs do not need LLVM.

Each program is a shared library. Programs are found by the digest of their sources, so that a program is not used if
its sources were edited. The digest of each shared library is also checked, so that a damaged file is not loaded.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import re
import subprocess
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from graspfx import log

if TYPE_CHECKING:
    from graspfx.compile.llvm.llvm import LlvmProgram
    from graspfx.compile.native import Native

FOLDER = Path(__file__).with_name("programs")
TABLE = "programs.json"
IMPORTS = "imports.json"
TRIPLE = "x86_64-unknown-linux-gnu"
PROCESSOR = "x86-64-v2"  # processors since 2009; also required by numpy's wheels


class SharedLibrary:
    """Shared library with the interface of LLVM's engine.

    Args:
        path: File of the library.
    """

    def __init__(self, path: Path) -> None:
        self._library = ctypes.CDLL(str(path))

    def get_function_address(self, name: str) -> int:
        """Return the address of a function by its name."""
        return ctypes.cast(getattr(self._library, name), ctypes.c_void_p).value or 0


def has(key: str) -> bool:
    """Return whether there is a precompiled program for a key, which identifies a program and its sources."""
    return key in _table()


def find(key: str) -> Native | None:
    """Load the precompiled program of a key; None if there is none, or its file has changed or cannot be loaded."""
    from graspfx.compile.native import Native

    content = read(key)
    if content is None:
        return None
    entry = _table()[key]
    try:
        engine = SharedLibrary(FOLDER / entry["file"])
    except OSError as error:
        _warn(FOLDER / entry["file"], error)
        return None
    log.info("program %s: %d kB of machine code, compiled ahead of time", key[:12], len(content) // 1000)
    return Native(entry["description"], engine, size=len(content), place=str(FOLDER))


def read(key: str) -> bytes | None:
    """Return the content of the file of a precompiled program; None if there is none, or the file has changed."""
    entry = _table().get(key)
    if entry is None:
        return None
    path = FOLDER / entry["file"]
    try:
        content: bytes = path.read_bytes()
        if hashlib.sha256(content).hexdigest() != entry["sha256"]:
            raise OSError("the file has changed since it was built")
    except OSError as error:
        _warn(path, error)
        return None
    return content


@cache
def imports() -> dict[str, list[str]]:
    """Return the modules of the package that each source file of the wheel imports, by the SHA-256 of the file.

    If a file was edited, its digest is not in the result.
    """
    return _read_json(IMPORTS)


@cache
def _table() -> dict[str, Any]:
    return _read_json(TABLE)


def _read_json(name: str) -> dict[str, Any]:
    """Return the content of a JSON file of the wheel; empty if the file is missing or damaged."""
    try:
        table: dict[str, Any] = json.loads((FOLDER / name).read_bytes())
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        _warn(FOLDER / name, error)
        return {}
    return table


def _warn(path: Path, error: Exception) -> None:
    log.warn(f"{path} is not used, and programs are compiled instead: {error}; install GraspFX again")


# Building -------------------------------------------------------------------------------------------------------------


def build(
    programs: Mapping[str, tuple[str, LlvmProgram]],
    folder: Path,
    modules: Mapping[str, tuple[str, bytes]] = MappingProxyType({}),
    sources: Mapping[str, list[str]] = MappingProxyType({}),
) -> str:
    """Compile programs for Linux on `x86-64-v2` processors, and link each program as a shared library.

    Args:
        programs: File name without ending, and program, by key.
        folder: New or empty folder for the files.
        modules: File name without ending, and content of a WebAssembly module, by key; the modules are also written.
        sources: Modules that each source file imports, by the SHA-256 of the file.

    Returns:
        Tag of the platforms whose C library has all functions that the programs call, such as "manylinux_2_29_x86_64".

    Raises:
        OSError: If there is no C compiler, or linking fails.
    """
    from graspfx.compile import cache as disk
    from graspfx.compile.emission import platform, portable
    from graspfx.compile.native import description_of, text_of

    folder.mkdir(parents=True, exist_ok=True)
    table, newest = {}, 17  # version of glibc: the oldest of the `manylinux` platforms
    for key, (name, program) in programs.items():
        file = f"{name}.so"
        text = text_of(program)
        kept = hashlib.sha256("\0".join([*platform()[:3], TRIPLE, PROCESSOR, text]).encode()).hexdigest()
        machine = disk.load(kept)
        if machine is None:
            disk.store(kept, machine := portable(text, TRIPLE, PROCESSOR))
        (folder / f"{name}.o").write_bytes(machine)
        (folder / f"{name}.s").write_text(_jumps(program.libm), encoding="ascii")
        words = ["cc", "-shared", "-Wl,-Bsymbolic,-z,now,--build-id=none", "-o", file, f"{name}.o", f"{name}.s", "-lm"]
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True)
        if done.returncode:
            raise OSError(f"{' '.join(words)}: {done.stderr.strip()}")
        content = (folder / file).read_bytes()
        newest = max([newest, *map(int, re.findall(rb"\0GLIBC_2\.(\d+)", content))])
        digest = hashlib.sha256(content).hexdigest()
        table[key] = {"file": file, "sha256": digest, "description": description_of(program)}
        for rest in (f"{name}.o", f"{name}.s"):
            (folder / rest).unlink()
    for key, (name, content) in modules.items():
        (folder / f"{name}.wasm").write_bytes(content)
        table[key] = {"file": f"{name}.wasm", "sha256": hashlib.sha256(content).hexdigest()}
    (folder / TABLE).write_text(json.dumps(table, indent=1) + "\n", encoding="ascii")
    (folder / IMPORTS).write_text(json.dumps(dict(sources)), encoding="ascii")
    return f"manylinux_2_{newest}_x86_64"


def _jumps(names: tuple[str, ...]) -> str:
    """Return the assembly text of functions such as `graspfx_sin`, which call C functions.

    LLVM does not know the new names, so that it cannot compute results of C functions when it compiles a program.
    """
    lines = ['.section .note.GNU-stack,"",@progbits', ".text"]
    for name in names:
        own = f"graspfx_{name}"
        lines += [f".globl {own}", f".hidden {own}", f".type {own}, @function", f"{own}: jmp {name}@PLT"]
    return "\n".join([*lines, ""])
