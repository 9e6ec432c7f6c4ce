"""Notes of a servo in memory that outlives its process: what was noted is there, however the process ended."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
from numpy.typing import NDArray

SIZE = 4  # bytes before a note, with its length


class Notes:
    """Notes one behind the other, each published once all of it is there; one that has no room is left out.

    They go round in their buffer: room is what the reader has read, so that a run of days has room for all of them.

    Args:
        buffer: for the notes.
        words: shared whole numbers.
        place: among them, of the count of bytes that were ever there.
        read: among them, of the count of bytes that the reader has read.
    """

    def __init__(self, buffer: memoryview, words: NDArray[np.int64], place: int, read: int) -> None:
        self._buffer, self._words, self._place, self._read = buffer, words, place, read

    def add(self, note: Any) -> None:
        """Add a note, of plain values."""
        text = pickle.dumps(note)
        text = len(text).to_bytes(SIZE, "little") + text
        first, size = int(self._words[self._place]), len(self._buffer)
        if first + len(text) - int(self._words[self._read]) > size:
            return
        at = first % size
        piece = min(len(text), size - at)
        self._buffer[at : at + piece] = text[:piece]
        self._buffer[: len(text) - piece] = text[piece:]
        self._words[self._place] = first + len(text)

    def news(self) -> list[Any]:
        """Give the notes that came since the last time."""
        first, end, notes = int(self._words[self._read]), int(self._words[self._place]), []
        while first < end:
            size = int.from_bytes(self._bytes(first, SIZE), "little")
            notes.append(pickle.loads(self._bytes(first + SIZE, size)))
            first += SIZE + size
        self._words[self._read] = first
        return notes

    def _bytes(self, first: int, count: int) -> bytes:
        at = first % len(self._buffer)
        return bytes(self._buffer[at : at + count]) + bytes(self._buffer[: max(at + count - len(self._buffer), 0)])
