"""Cache of validated tables, shared within a `with` block."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, NamedTuple, Protocol

from graspfx.scene.source import Source


class CheckedTable(NamedTuple):
    """A scene that passed all checks: its fields, the names of the given fields, and the nested tables."""

    fields: dict[str, Any]
    names: set[str]
    written: dict[str, Any]


class Memory(Protocol):
    """A cache of scenes."""

    def recall(self, table: Mapping[str, Any], source: Source) -> CheckedTable | None:
        """Return the scene that passed the checks with this table and source; None if it is not cached."""
        ...

    def keep(self, table: Mapping[str, Any], source: Source, scene: Any) -> None:
        """Store a scene that has just passed its checks."""
        ...


_memory: ContextVar[Memory | None] = ContextVar("memory", default=None)


@contextmanager
def remembering(memory: Memory) -> Iterator[None]:
    """Let all scenes that are created within the block use a cache."""
    token = _memory.set(memory)
    try:
        yield
    finally:
        _memory.reset(token)


def current_memory() -> Memory | None:
    """Return the active cache; None for no cache."""
    return _memory.get()
