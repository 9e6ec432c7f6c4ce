"""Disk cache of lowered kernels: one entry for all kernels of this package, each with the digest of its sources."""

from __future__ import annotations

import hashlib
import marshal
import sys
from dataclasses import dataclass, field
from functools import cache
from types import CodeType, FunctionType
from typing import Any

from graspfx.compile import cache as disk
from graspfx.compile.own_sources import closure_digest, compiler_modules, is_own, source_folders


@dataclass(frozen=True)
class Lowering:
    """A kernel's lowered text, the functions that it calls (by their names in the text), and its source files."""

    text: str
    code: CodeType
    callees: dict[str, tuple[str, str]]  # module and qualified name
    files: tuple[str, ...]


@dataclass
class Store:
    """Lowered kernels by name; `save` writes new kernels."""

    key: str
    entries: dict[str, Any] = field(default_factory=dict)
    changed: bool = False

    def find(self, function: FunctionType) -> Lowering | None:
        """Look up a kernel of this package."""
        digest, *entry = self.entries.get(_name(function), ("",))
        if digest != _sources_of(function):
            return None
        text, code, callees, files = entry
        return Lowering(text, marshal.loads(code), dict(callees), tuple(files))

    def add(self, function: FunctionType, lowering: Lowering) -> None:
        """Add a kernel if all its sources belong to this package, because the key covers no other sources."""
        if all(is_own(file) for file in lowering.files):
            parts = lowering.text, marshal.dumps(lowering.code), tuple(lowering.callees.items()), lowering.files
            self.entries[_name(function)] = _sources_of(function), *parts
            self.changed = True

    def save(self) -> None:
        """Write new entries; if this fails, the next process lowers the kernels again."""
        if self.changed:
            disk.store(self.key, marshal.dumps(self.entries))
            self.changed = False


@cache
def store() -> Store:
    """Open the cache of this installation for this Python."""
    digest = hashlib.sha256(repr((sys.version, marshal.version, source_folders())).encode())
    key = f"lowered-{digest.hexdigest()}"
    content = disk.load(key)
    return Store(key, marshal.loads(content) if content is not None else {})


def _sources_of(function: FunctionType) -> str:
    return closure_digest(function.__module__, *compiler_modules())


def _name(function: FunctionType) -> str:
    return f"{function.__module__}.{function.__qualname__}"
