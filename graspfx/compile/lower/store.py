"""Disk cache of lowered kernels: one entry for all of our kernels that were asked for, as long as no source changes."""

from __future__ import annotations

import base64
import hashlib
import json
import marshal
import os
import sys
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

from graspfx.compile import cache as disk


@dataclass(frozen=True)
class Lowering:
    """A kernel's lowered text, the functions that it calls by the names in the text, and its source files."""

    text: str
    code: CodeType
    callees: dict[str, tuple[str, str]]  # module and qualified name
    files: tuple[str, ...]


@dataclass
class Store:
    """Lowerings by the kernels' names; those that are new are written by `save`."""

    key: str
    entries: dict[str, Any] = field(default_factory=dict)
    changed: bool = False

    def find(self, function: FunctionType) -> Lowering | None:
        """Look up a kernel of ours."""
        entry = self.entries.get(_name(function))
        if entry is None:
            return None
        text, code, callees, files = entry
        loaded = marshal.loads(base64.b64decode(code))
        return Lowering(
            text, loaded, {alias: (module, name) for alias, (module, name) in callees.items()}, tuple(files)
        )

    def add(self, function: FunctionType, lowering: Lowering) -> None:
        """Add a kernel, if it is ours: the key says nothing of others' sources."""
        if all(_is_own(file) for file in lowering.files):
            code = base64.b64encode(marshal.dumps(lowering.code)).decode()
            self.entries[_name(function)] = [lowering.text, code, lowering.callees, lowering.files]
            self.changed = True

    def save(self) -> None:
        """Write what is new; a cache that cannot be written costs the next process the lowering again."""
        if self.changed:
            disk.store(self.key, json.dumps(self.entries).encode())
            self.changed = False


@cache
def store() -> Store:
    """Open the cache of this version of the sources, under this Python."""
    digest = hashlib.sha256(repr((sys.version, marshal.version, _stamps())).encode())
    key = f"lowered-{digest.hexdigest()}"
    content = disk.load(key)
    return Store(key, json.loads(content) if content is not None else {})


def _name(function: FunctionType) -> str:
    return f"{function.__module__}.{function.__qualname__}"


@cache
def _folders() -> tuple[str, ...]:
    """List the package's folder and, in a checkout, the shelves beside it."""
    return tuple(str(Path(place)) for place in sys.modules[__name__.partition(".")[0]].__path__)


def _is_own(file: str) -> bool:
    package, *beside = _folders()
    return file.startswith((package + os.sep, *(os.path.join(root, "devices") + os.sep for root in beside)))  # noqa: PTH118 (strings)


def _stamps() -> list[tuple[str, int, int]]:
    """List time and size of every source, as Python judges its own bytecode."""
    package, *beside = _folders()
    stamps = []
    for root in (package, *(os.path.join(place, "devices") for place in beside)):  # noqa: PTH118 (hundreds of files)
        for folder, _, names in os.walk(root):
            for name in sorted(names):
                if name.endswith(".py"):
                    status = os.stat(path := os.path.join(folder, name))  # noqa: PTH116, PTH118
                    stamps.append((path, status.st_mtime_ns, status.st_size))
    return stamps
