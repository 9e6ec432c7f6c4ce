"""Notes of a servo in memory that outlives its process: what was noted is there, however the process ended."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
from numpy.typing import NDArray

SIZE = 4  # bytes before a note, with its length


class Notes:
    """Notes one behind the other, each published once all of it is there; one that has no room is left out.

    Args:
        buffer: for the notes.
        words: shared whole numbers.
        place: among them, of the count of bytes.
    """

    def __init__(self, buffer: memoryview, words: NDArray[np.int64], place: int) -> None:
        self._buffer, self._words, self._place = buffer, words, place
        self._read = 0

    def add(self, note: Any) -> None:
        """Add a note, of plain values."""
        text = pickle.dumps(note)
        first = int(self._words[self._place])
        end = first + SIZE + len(text)
        if end > len(self._buffer):
            return
        self._buffer[first : first + SIZE] = len(text).to_bytes(SIZE, "little")
        self._buffer[first + SIZE : end] = text
        self._words[self._place] = end

    def news(self) -> list[Any]:
        """Give the notes that came since the last time."""
        end, notes = int(self._words[self._place]), []
        while self._read < end:
            first = self._read + SIZE
            size = int.from_bytes(self._buffer[self._read : first], "little")
            notes.append(pickle.loads(bytes(self._buffer[first : first + size])))
            self._read = first + size
        return notes
