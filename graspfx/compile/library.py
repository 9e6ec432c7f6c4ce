"""The library of programs that a wheel brings, compiled when it was built: ticks need no LLVM then.

Each program is a shared library of its own. The table names it by the digest of the sources that it was made from, so
that an edited source is compiled as if there were no library, and holds the digest of its file, so that a damaged one
is not loaded.
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
PROCESSOR = "x86-64-v2"  # of 2009 and later; numpy's own wheels ask for it too


class SharedLibrary:
    """Machine code that the system's loader has loaded, asked as LLVM's engine is asked."""

    def __init__(self, path: Path) -> None:
        self._library = ctypes.CDLL(str(path))

    def get_function_address(self, name: str) -> int:
        """Give the address of a function."""
        return ctypes.cast(getattr(self._library, name), ctypes.c_void_p).value or 0


def has(key: str) -> bool:
    """Tell whether the library has a program that was made from these sources.

    Args:
        key: that tells the program and its sources.
    """
    return key in _table()


def find(key: str) -> Native | None:
    """Load a program of the library; None if it has none of these sources, or its file is not what was built."""
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
    """Read the file of a program; None if the library does not have it, or if the file is not what was built."""
    entry = _table().get(key)
    if entry is None:
        return None
    path = FOLDER / entry["file"]
    try:
        content: bytes = path.read_bytes()
        if hashlib.sha256(content).hexdigest() != entry["sha256"]:
            raise OSError("it is not what was built")
    except OSError as error:
        _warn(path, error)
        return None
    return content


@cache
def imports() -> dict[str, list[str]]:
    """List what each source file of the wheel imports of the package, by the SHA-256 of its content.

    A file that was edited is not in the list: whoever asks parses it.
    """
    return _read_json(IMPORTS)


@cache
def _table() -> dict[str, Any]:
    return _read_json(TABLE)


def _read_json(name: str) -> dict[str, Any]:
    """Read a file of the library; an empty table if there is none, or if it is damaged."""
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


# How it is built ------------------------------------------------------------------------------------------------------


def build(
    programs: Mapping[str, tuple[str, LlvmProgram]],
    folder: Path,
    modules: Mapping[str, tuple[str, bytes]] = MappingProxyType({}),
    sources: Mapping[str, list[str]] = MappingProxyType({}),
) -> str:
    """Compile programs for all processors of the kind, and link each as a shared library.

    Args:
        programs: by key, a name for the file and the program.
        modules: by key, a name for the file and a WebAssembly module, which are put there too.
        sources: imports of each source file, by the SHA-256 of its content.
        folder: new or empty, where they are put.

    Returns:
        The tag of platforms that they run on, such as "manylinux_2_29_x86_64": the C library has the functions that
        they call.

    Raises:
        OSError: there is no C compiler to link with, or it failed; the text says why.
    """
    from graspfx.compile import cache as disk
    from graspfx.compile.emission import platform, portable
    from graspfx.compile.native import description_of, text_of

    folder.mkdir(parents=True, exist_ok=True)
    table, newest = {}, 17  # of glibc: the least that `manylinux` platforms have
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
    """Write `graspfx_sin` and its like: LLVM must not know what they are, or it would reckon with them itself."""
    lines = ['.section .note.GNU-stack,"",@progbits', ".text"]
    for name in names:
        own = f"graspfx_{name}"
        lines += [f".globl {own}", f".hidden {own}", f".type {own}, @function", f"{own}: jmp {name}@PLT"]
    return "\n".join([*lines, ""])
