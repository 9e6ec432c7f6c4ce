"""Memory of scenes that were checked before: whoever has one lends it to the scenes that are made meanwhile."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, NamedTuple, Protocol

from graspfx.scene.source import Source


class CheckedTable(NamedTuple):
    """A scene that passed all its checks: its fields, the names of those that were set, and its written form."""

    fields: dict[str, Any]
    names: set[str]
    written: dict[str, Any]


class Memory(Protocol):
    """A memory of scenes."""

    def recall(self, table: Mapping[str, Any], source: Source) -> CheckedTable | None:
        """Recall what the checks made of this very table from this source; None if they have to be made."""
        ...

    def keep(self, table: Mapping[str, Any], source: Source, scene: Any) -> None:
        """Keep a scene that has just passed its checks."""
        ...


_memory: ContextVar[Memory | None] = ContextVar("memory", default=None)


@contextmanager
def remembering(memory: Memory) -> Iterator[None]:
    """Let the scenes that are made within the block use a memory."""
    token = _memory.set(memory)
    try:
        yield
    finally:
        _memory.reset(token)


def current_memory() -> Memory | None:
    """Give the memory in force; None for none."""
    return _memory.get()
