"""Memory of a scene: the blocks of its parts, one after another in one array."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from mmap import mmap
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

ROOM = 1 << 21  # entries
LEAST = 1 << 12


class Memory:
    """An array from which blocks are taken one after another; its first entry is nobody's.

    Attributes:
        floats: all of it.
        used: entries that were taken.
    """

    def __init__(self, room: int = ROOM) -> None:
        self.floats: FloatArray = _pages(room)
        self.used = 1

    def take(self, size: int) -> FloatArray:
        """Take a block of zeros; one for which there is no room left stands by itself."""
        first, end = self.used, self.used + size
        if end > self.floats.size:
            return np.zeros(size)
        self.used = end
        return self.floats[first:end]

    def place(self, array: FloatArray) -> int:
        """Give the entry at which an array begins, counted from the first one of this memory, wherever it stands."""
        return (address_of(array) - address_of(self.floats)) // self.floats.itemsize


def _pages(room: int) -> FloatArray:
    """Make zeros for which the system gives pages where something is written; fewer of them where there is a limit."""
    try:
        return np.frombuffer(mmap(-1, 8 * room), np.float64)
    except OSError:
        return np.zeros(room) if room <= LEAST else _pages(room // 16)


_MEMORY: ContextVar[Memory | None] = ContextVar("memory", default=None)


def zeros(size: int) -> FloatArray:
    """Make a block of zeros, in the memory of the scene that is being built, or by itself."""
    memory = _MEMORY.get()
    return np.zeros(size) if memory is None else memory.take(size)


@contextmanager
def within(memory: Memory) -> Iterator[Memory]:
    """Let `zeros` take from a memory within a `with` block."""
    token = _MEMORY.set(memory)
    try:
        yield memory
    finally:
        _MEMORY.reset(token)


@contextmanager
def without() -> Iterator[None]:
    """Let `zeros` make arrays by themselves within a `with` block."""
    token = _MEMORY.set(None)
    try:
        yield
    finally:
        _MEMORY.reset(token)


def address_of(array: FloatArray) -> int:
    """Give the address of an array's first entry."""
    address: int = array.__array_interface__["data"][0]
    return address


class Scattered:
    """Arrays that stand apart, as one buffer for kernels that run interpreted.

    Args:
        memory: in whose entries indices count.
        arrays: all that a kernel may reach.
    """

    def __init__(self, memory: Memory, arrays: list[FloatArray]) -> None:
        self._near: Any = memory.floats.data
        starts = [memory.place(each) for each in arrays]
        self._far: list[tuple[int, int, Any]] = [
            (start, start + each.size, each.data) for start, each in zip(starts, arrays, strict=True)
        ]

    def _find(self, k: int) -> tuple[Any, int]:
        for first, end, view in self._far:
            if first <= k < end:
                return view, k - first
        return self._near, k

    def __getitem__(self, k: int) -> float:
        view, i = self._find(k)
        return float(view[i])

    def __setitem__(self, k: int, value: float) -> None:
        view, i = self._find(k)
        view[i] = value
