"""Disk entries made from kernels, found by the sources that the kernels come from."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Protocol

from graspfx.compile import cache as disk
from graspfx.compile.kernel import written
from graspfx.compile.own_sources import closure_digest, compiler_modules, is_own


class Origins(Protocol):
    """Places that a program was made from."""

    files: set[str]
    numbers_of_modules: dict[tuple[str, str], str]


def identity(kernel: Callable[..., Any]) -> list[str]:
    """Identify a kernel by name, and a foreign one by its file too: another environment may have the same name."""
    code = getattr(written(kernel), "__code__", None)
    file = "" if code is None or is_own(code.co_filename) else code.co_filename
    return [f"{kernel.__module__}.{kernel.__qualname__}", file]


def request_key(modules: Iterable[str], *parts: str) -> str:
    """Name a request: what is asked for, the sources of the modules that it is made from, and those of the compiler."""
    digest = closure_digest(*sorted(set(modules)), *compiler_modules())
    return hashlib.sha256("\0".join([digest, *parts]).encode()).hexdigest()


def recall(key: str) -> str | None:
    """Load what a request led to, if files and numbers of others are what they were; the key tells of our own."""
    content = disk.load(key)
    if content is None:
        return None
    entry = json.loads(content)
    return str(entry["content"]) if _is_fresh(entry["sources"]) else None


def remember(key: str, program: Origins, content: str) -> None:
    """Store what a request led to."""
    disk.store(key, json.dumps({"sources": _foreign_sources(program), "content": content}).encode())


def _foreign_sources(program: Origins) -> dict[str, Any]:
    """Note the files of others' kernels and the numbers of their modules."""
    folders = {Path(file).parent for file in program.files if not is_own(file)}
    files = {str(file): _digest(str(file)) for folder in folders for file in folder.glob("*.py")}
    numbers = [[*where, number] for where, number in program.numbers_of_modules.items() if not _is_ours(where[0])]
    return {"files": files, "numbers": numbers}


def _is_fresh(sources: Mapping[str, Any]) -> bool:
    same = all(_digest(file) == digest for file, digest in sources["files"].items())
    return same and all(_number(module, name) == number for module, name, number in sources["numbers"])


def _is_ours(module: str) -> bool:
    """Tell whether a module's numbers are written in the package's sources, or are those of mathematics."""
    return module.partition(".")[0] in ("math", __name__.partition(".")[0])


def _number(module: str, name: str) -> str:
    """Read a module's number as it is now: the module may have read it from elsewhere when it was imported."""
    return repr(getattr(sys.modules.get(module), name, None))


def _digest(file: str) -> str:
    try:
        return hashlib.sha256(Path(file).read_bytes()).hexdigest()
    except OSError:
        return ""
