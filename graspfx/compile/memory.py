"""Memory of a scene: one array that contains the blocks of all parts of the scene."""

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
    """Array from which blocks are allocated one after another.

    Attributes:
        floats: Array. Its first entry is not part of a block.
        used: Number of entries that are allocated, including the first entry.
    """

    def __init__(self, room: int = ROOM) -> None:
        self.floats: FloatArray = _pages(room)
        self.used = 1

    def take(self, size: int) -> FloatArray:
        """Allocate a block of zeros. If the remaining memory is too small, the block is a separate array."""
        first, end = self.used, self.used + size
        if end > self.floats.size:
            return np.zeros(size)
        self.used = end
        return self.floats[first:end]

    def place(self, array: FloatArray) -> int:
        """Return the index of an array's first entry, counted from the first entry of this memory.

        The array may be outside of this memory.
        """
        return (address_of(array) - address_of(self.floats)) // self.floats.itemsize


def _pages(room: int) -> FloatArray:
    """Return an array of `room` zeros, or of fewer zeros if memory is limited.

    The system allocates memory only for the pages of the array that are written.
    """
    try:
        return np.frombuffer(mmap(-1, 8 * room), np.float64)
    except OSError:
        return np.zeros(room) if room <= LEAST else _pages(room // 16)


_MEMORY: ContextVar[Memory | None] = ContextVar("memory", default=None)


def zeros(size: int) -> FloatArray:
    """Return a block of zeros, from the memory of the enclosing `within`; without it, the block is a separate array."""
    memory = _MEMORY.get()
    return np.zeros(size) if memory is None else memory.take(size)


@contextmanager
def within(memory: Memory) -> Iterator[Memory]:
    """Make the function `zeros` allocate blocks from a memory within a `with` block."""
    token = _MEMORY.set(memory)
    try:
        yield memory
    finally:
        _MEMORY.reset(token)


@contextmanager
def without() -> Iterator[None]:
    """Make the function `zeros` return separate arrays within a `with` block."""
    token = _MEMORY.set(None)
    try:
        yield
    finally:
        _MEMORY.reset(token)


def address_of(array: FloatArray) -> int:
    """Return the address of an array's first entry."""
    address: int = array.__array_interface__["data"][0]
    return address


class Scattered:
    """Buffer for interpreted kernels that consists of a memory and of separate arrays.

    Args:
        memory: Memory. Indices are counted from its first entry.
        arrays: Arrays outside of the memory that a kernel may access.
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
