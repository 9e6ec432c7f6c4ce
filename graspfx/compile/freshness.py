"""Cache entries derived from kernels, valid only while the kernels' sources are unchanged."""

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
    """Sources of a program."""

    files: set[str]
    numbers_of_modules: dict[tuple[str, str], str]


def identity(kernel: Callable[..., Any]) -> list[str]:
    """Return a kernel's identity: its name and, for a third-party kernel, its file, because names may be ambiguous."""
    code = getattr(written(kernel), "__code__", None)
    file = "" if code is None or is_own(code.co_filename) else code.co_filename
    return [f"{kernel.__module__}.{kernel.__qualname__}", file]


def request_key(modules: Iterable[str], *parts: str) -> str:
    """Return the key of a request, which covers its parts, the sources of its modules, and those of the compiler."""
    digest = closure_digest(*sorted(set(modules)), *compiler_modules())
    return hashlib.sha256("\0".join([digest, *parts]).encode()).hexdigest()


def recall(key: str) -> str | None:
    """Load the result of a request if third-party files and numbers are unchanged; the key covers this package."""
    content = disk.load(key)
    if content is None:
        return None
    entry = json.loads(content)
    return str(entry["content"]) if _is_fresh(entry["sources"]) else None


def remember(key: str, program: Origins, content: str) -> None:
    """Store the result of a request."""
    disk.store(key, json.dumps({"sources": _foreign_sources(program), "content": content}).encode())


def _foreign_sources(program: Origins) -> dict[str, Any]:
    """Collect the files of third-party kernels and the numbers of their modules."""
    folders = {Path(file).parent for file in program.files if not is_own(file)}
    files = {str(file): _digest(str(file)) for folder in folders for file in folder.glob("*.py")}
    numbers = [[*where, number] for where, number in program.numbers_of_modules.items() if not _is_ours(where[0])]
    return {"files": files, "numbers": numbers}


def _is_fresh(sources: Mapping[str, Any]) -> bool:
    same = all(_digest(file) == digest for file, digest in sources["files"].items())
    return same and all(_number(module, name) == number for module, name, number in sources["numbers"])


def _is_ours(module: str) -> bool:
    """Return whether a module's numbers are constants of this package's sources, or mathematical constants."""
    return module.partition(".")[0] in ("math", __name__.partition(".")[0])


def _number(module: str, name: str) -> str:
    """Return a module's present number, which the module may have read from another source on import."""
    return repr(getattr(sys.modules.get(module), name, None))


def _digest(file: str) -> str:
    try:
        return hashlib.sha256(Path(file).read_bytes()).hexdigest()
    except OSError:
        return ""
