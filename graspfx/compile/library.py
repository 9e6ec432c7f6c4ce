"""Library of precompiled programs in a wheel, with which ticks need no LLVM.

Each program is a shared library. A table maps the digest of a program's sources to the program, so edited sources are
compiled as if there were no library. The table also contains the digest of each file, so a damaged file is not loaded.
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
    """Machine code loaded by the system's loader, with the interface of LLVM's engine."""

    def __init__(self, path: Path) -> None:
        self._library = ctypes.CDLL(str(path))

    def get_function_address(self, name: str) -> int:
        """Return the address of a function."""
        return ctypes.cast(getattr(self._library, name), ctypes.c_void_p).value or 0


def has(key: str) -> bool:
    """Return whether the library has a program for a key.

    Args:
        key: Key of the program and its sources.
    """
    return key in _table()


def find(key: str) -> Native | None:
    """Load a program of the library; None if the library has no program of these sources, or the file has changed."""
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
    """Read the file of a program; None if it is not in the library, or the file has changed since it was built."""
    entry = _table().get(key)
    if entry is None:
        return None
    path = FOLDER / entry["file"]
    try:
        content: bytes = path.read_bytes()
        if hashlib.sha256(content).hexdigest() != entry["sha256"]:
            raise OSError("it has changed since it was built")
    except OSError as error:
        _warn(path, error)
        return None
    return content


@cache
def imports() -> dict[str, list[str]]:
    """Return which modules of the package each source file of the wheel imports, by the SHA-256 of its content.

    An edited file is not included; the caller has to parse it.
    """
    return _read_json(IMPORTS)


@cache
def _table() -> dict[str, Any]:
    return _read_json(TABLE)


def _read_json(name: str) -> dict[str, Any]:
    """Read a JSON file of the library; an empty table if it is missing or damaged."""
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
    """Compile programs for `x86-64-v2` processors and Linux, and link each as a shared library.

    Args:
        programs: File name and program, by key.
        modules: File name and WebAssembly module, by key; the modules are also written.
        sources: Imports of each source file, by the SHA-256 of its content.
        folder: New or empty folder for the files.

    Returns:
        Tag of the platforms on which the programs run, such as "manylinux_2_29_x86_64". The C library of these
            platforms has all functions that the programs call.

    Raises:
        OSError: If there is no C compiler for linking, or linking fails; the message states the reason.
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
    """Write functions such as `graspfx_sin`, which hide C functions from LLVM to prevent the folding of their calls."""
    lines = ['.section .note.GNU-stack,"",@progbits', ".text"]
    for name in names:
        own = f"graspfx_{name}"
        lines += [f".globl {own}", f".hidden {own}", f".type {own}, @function", f"{own}: jmp {name}@PLT"]
    return "\n".join([*lines, ""])
