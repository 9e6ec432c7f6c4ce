"""Whether what was made from kernels is still of their sources: those of the package, and those of others."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

from graspfx.compile.kernel import written
from graspfx.compile.own_sources import is_own


class Sources(Protocol):
    """Places that a program was made from."""

    files: set[str]
    numbers_of_modules: dict[tuple[str, str], str]


def identity(kernel: Callable[..., Any]) -> list[str]:
    """Identify a kernel by name, and a foreign one by its file too: another environment may have the same name."""
    code = getattr(written(kernel), "__code__", None)
    file = "" if code is None or is_own(code.co_filename) else code.co_filename
    return [f"{kernel.__module__}.{kernel.__qualname__}", file]


def foreign_sources(program: Sources) -> dict[str, Any]:
    """Note the files of others' kernels and the numbers of their modules, for `is_fresh`."""
    folders = {Path(file).parent for file in program.files if not is_own(file)}
    files = {str(file): _digest(str(file)) for folder in folders for file in folder.glob("*.py")}
    numbers = [[*where, number] for where, number in program.numbers_of_modules.items() if not _is_ours(where[0])]
    return {"files": files, "numbers": numbers}


def is_fresh(sources: Mapping[str, Any]) -> bool:
    """Tell whether files and numbers of others are what they were; what is of the package, keys tell."""
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
