"""Memory that a servo shares with the recording process, without locks: rows, notes, new values (letters) and goals.

The memory begins with integers, each in a separate cache line (`Word`). They are followed by notes, letters, rows, the
goals of guided hands, and a log of applied goals. The writer of rows publishes `HEAD` after each row, so a reader that
sees the new value of `HEAD` also sees the row.
"""

from __future__ import annotations

import mmap
import pickle
import platform
from collections.abc import Mapping, Sequence
from contextlib import suppress
from enum import IntEnum
from io import BytesIO
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import GraspFXError, InputError, message
from graspfx.system import shared_memory

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Index = NDArray[np.intp]

SLOTS = 1 << 14  # rows of the ring: 16 s at 1 kHz
PAGE = 4096  # bytes of the integers
NOTES = 1 << 18  # bytes of notes
LETTERS = 1 << 18  # bytes of each of the two letters
NOTE_SIZE = 4  # bytes of the length before a note
LETTER_HEAD = 3  # 8-byte integers before the parts: number of parts, objects and plants
IN_ORDER = platform.machine().lower() in ("x86_64", "amd64", "i386", "i686")  # processors that do not reorder stores


class Word(IntEnum):
    """Positions of the integers at the start of the memory, in units of 8 bytes."""

    HEAD = 0  # number of ticks whose rows have been written; set by the servo
    TAIL = 8  # number of ticks whose rows have been read; set by the recorder
    STOP = 16  # nonzero if forces must decay; set by the recorder's process
    BEAT = 24  # time.monotonic_ns of the guard's last heartbeat
    PHASE = 32  # phase of the servo, a `Phase`
    NOTES = 40  # total number of bytes of notes written; set by the servo
    MAIL = 48  # number of the last letter; set by the recorder's process
    SKIPPED = 56  # number of skipped periods; set by the servo
    DONE = 64  # number of the last letter that was applied; set by the servo
    TICK = 72  # tick at which this letter was applied; set by the servo
    HALT = 80  # 1 + the tick before which a simulation pauses, or 0; set by the recorder's process
    GOAL = 88  # number of the last goals of guided hands; set by the recorder's process
    GOALS = 96  # number of times that goals were applied; set by the servo
    NOTED = 104  # total number of bytes of notes read; set by the recorder
    CALL = 112  # number of the Python device call in progress (`DevicePort.place`), or 0; set by the servo


class Phase(IntEnum):
    """Phases of a servo that runs in a separate process."""

    STARTING = 0
    OPEN = 1  # hardware is being opened or checked, at zero force
    RUNNING = 2  # hardware displays forces
    RESTED = 3  # the forces of all devices have been set to zero and remain zero
    CLOSED = 4


def fence() -> None:
    """Ensure that every thread that sees a later store also sees all earlier stores."""
    if not IN_ORDER:
        for _ in range(2):
            with _LOCK:
                pass


_LOCK = Lock()


class Notes:
    """Ring buffer of notes; a note becomes visible when it is complete, and is discarded if it does not fit.

    Args:
        buffer: Memory of the notes.
        words: Shared integers.
        place: Index in `words` of the total number of bytes written.
        read: Index in `words` of the total number of bytes read.
    """

    def __init__(self, buffer: memoryview, words: NDArray[np.int64], place: int, read: int) -> None:
        self._buffer, self._words, self._place, self._read = buffer, words, place, read

    def add(self, note: Any) -> None:
        """Add a note, which must be picklable."""
        text = pickle.dumps(note)
        text = len(text).to_bytes(NOTE_SIZE, "little") + text
        first, size = int(self._words[self._place]), len(self._buffer)
        if first + len(text) - int(self._words[self._read]) > size:
            return
        at = first % size
        piece = min(len(text), size - at)
        self._buffer[at : at + piece] = text[:piece]
        self._buffer[: len(text) - piece] = text[piece:]
        self._words[self._place] = first + len(text)

    def news(self) -> list[Any]:
        """Return the notes that were added since the last call."""
        first, end, notes = int(self._words[self._read]), int(self._words[self._place]), []
        while first < end:
            size = int.from_bytes(self._bytes(first, NOTE_SIZE), "little")
            notes.append(pickle.loads(self._bytes(first + NOTE_SIZE, size)))
            first += NOTE_SIZE + size
        self._words[self._read] = first
        return notes

    def _bytes(self, first: int, count: int) -> bytes:
        at = first % len(self._buffer)
        return bytes(self._buffer[at : at + count]) + bytes(self._buffer[: max(at + count - len(self._buffer), 0)])


class Ring:
    """Memory that a servo shares with the recorder.

    Args:
        file: Descriptor of the memory, from `create`.
        width: Number of values in a row.
        every: Number of ticks from one row to the next.
        goals: Number G of values in the goals of guided hands.

    Attributes:
        words: Integers (512,), with the indices of `Word`.
        rows: Rows (SLOTS, width). If `every` divides k, tick k is recorded in row k / every modulo SLOTS.
        notes: Notes of the servo.
        letters: Memory of the two letters, as bytes.
        goals: Goals (2, G); the k-th goals are in row k modulo 2.
        goal_log: Log of applied goals (SLOTS, 1 + G); a row contains the first tick and the values of goals.
    """

    def __init__(self, file: int, width: int, every: int = 1, goals: int = 0) -> None:
        self.file, self.width, self.every = file, width, every
        self.memory = mmap.mmap(file, size_of(width, goals))
        self.words: IntArray = np.frombuffer(self.memory, np.int64, PAGE // 8)
        self.notes = Notes(memoryview(self.memory)[PAGE : PAGE + NOTES], self.words, Word.NOTES, Word.NOTED)
        start = PAGE + NOTES
        self.letters = [memoryview(self.memory)[start + i * LETTERS : start + (i + 1) * LETTERS] for i in range(2)]
        rows = np.frombuffer(self.memory, np.float64, SLOTS * width, start + 2 * LETTERS)
        self.rows: FloatArray = rows.reshape(SLOTS, width)
        end = start + 2 * LETTERS + rows.nbytes
        self.goals: FloatArray = np.frombuffer(self.memory, np.float64, 2 * goals, end).reshape(2, goals)
        slots = SLOTS if goals else 0
        log = np.frombuffer(self.memory, np.float64, slots * (1 + goals), end + self.goals.nbytes)
        self.goal_log: FloatArray = log.reshape(slots, 1 + goals)

    @property
    def span(self) -> int:
        """Number of ticks after which a row is overwritten."""
        return SLOTS * self.every


def size_of(width: int, goals: int = 0) -> int:
    """Return the size of the memory of a ring [bytes]."""
    beside = 8 * (2 * goals + SLOTS * (1 + goals)) if goals else 0
    return PAGE + NOTES + 2 * LETTERS + 8 * SLOTS * width + beside


def create(width: int, goals: int = 0) -> int:
    """Allocate the memory of a ring and return its descriptor; it is freed when no process uses it any more."""
    return shared_memory.create("graspfx-ring", size_of(width, goals))


class RingRecorder:
    """Recorder that writes the rows of ticks to a ring, without waiting for the reader.

    If the reader is too slow, the oldest rows are overwritten.

    Args:
        ring: Ring to which rows are written.
    """

    def __init__(self, ring: Ring) -> None:
        self._ring, self.ticks = ring, 0
        self._words = memoryview(ring.memory).cast("q")

    @property
    def ring(self) -> Ring:
        """Ring of the recorder; a caller that writes rows directly to the ring must also set `ticks`."""
        return self._ring

    @property
    def row(self) -> FloatArray:
        """Row that was written last."""
        row: FloatArray = self._ring.rows[(max(self.ticks, 1) - 1) // self._ring.every % SLOTS]
        return row

    def space(self) -> tuple[FloatArray, int, int]:
        """Return all rows, the index of the next tick in the ring, and the number of ticks to the end of the ring."""
        place = self.ticks % self._ring.span
        return self._ring.rows, place, self._ring.span - place

    def take(self, count: int) -> None:
        """Publish the rows of the next `count` ticks."""
        self.ticks += count
        fence()
        self._words[Word.HEAD] = self.ticks

    def drain(self) -> None:
        """Do nothing, because the reader reads the rows from the ring."""

    def fault(self, k: int, message: str) -> None:
        self._ring.notes.add(("fault", k, message))

    def change(self, k: int, values: Mapping[str, Any]) -> None:
        self._ring.notes.add(("change", k, dict(values)))


# Letters --------------------------------------------------------------------------------------------------------------

# All values of a letter are applied between the same two ticks. The memory has space for two letters, which are used
# alternately. The number of a letter is published when the letter is complete, and the next letter is written after the
# servo has applied this letter. The servo never waits and never sees an incomplete letter.


class Letter(NamedTuple):
    """New values of entries in the memories of parts.

    Attributes:
        entries: Index of a memory, indices of entries in this memory, and new values of the entries.
        objects: Indices of the objects whose derived values must be computed again.
        plants: Indices of the plants whose method `hold` must be called again.
    """

    entries: Sequence[tuple[int, Index, FloatArray]]
    objects: Sequence[int]
    plants: Sequence[int] = ()


def write_letter(letter: Letter, place: memoryview) -> None:
    """Write a letter to a memory.

    Raises:
        InputError: If the letter is longer than the memory.
    """
    head: list[int] = [len(letter.entries), len(letter.objects), len(letter.plants), *letter.objects, *letter.plants]
    for memory, places, _ in letter.entries:
        head += [memory, len(places)]
    parts = [np.array(head, np.int64).tobytes()]
    parts += [np.asarray(places, np.int64).tobytes() for _, places, _ in letter.entries]
    parts += [np.asarray(numbers, np.float64).tobytes() for _, _, numbers in letter.entries]
    text = b"".join(parts)
    if len(text) > len(place):
        raise InputError("values", len(text), f"new values of at most {len(place)} bytes", "change fewer keys at once")
    place[: len(text)] = text


def read_letter(place: memoryview) -> Letter:
    """Return a copy of the letter in a memory."""
    whole = np.frombuffer(place, np.int64)
    parts, objects, plants = whole[:LETTER_HEAD].tolist()
    first = LETTER_HEAD + objects
    at = first + plants + 2 * parts
    heads = whole[first + plants : at].reshape(parts, 2).tolist()
    places = []
    for _, count in heads:
        places.append(whole[at : at + count].astype(np.intp))
        at += count
    numbers, floats = [], whole.view(np.float64)
    for _, count in heads:
        numbers.append(floats[at : at + count].copy())
        at += count
    entries = [(memory, p, n) for (memory, _), p, n in zip(heads, places, numbers, strict=True)]
    return Letter(entries, whole[LETTER_HEAD:first].tolist(), whole[first : first + plants].tolist())


# Exceptions sent to another process: same type, same message, no traceback --------------------------------------------


def pack_error(error: BaseException) -> bytes:
    """Convert an exception to bytes for `unpack_error`.

    Attributes that cannot be pickled are replaced by the names of their types. If this is not possible, the bytes
    contain a GraspFXError with the type and the message of the exception.
    """
    error = error.with_traceback(None)
    with suppress(Exception):  # exceptions of other libraries may contain anything
        text = _written(error)
        if type(pickle.loads(text)) is type(error):
            return text
    with suppress(Exception):  # likewise
        text = pickle.dumps((type(error), error.args, _plain(vars(error))))
        pickle.loads(text)
        return text
    return pickle.dumps(GraspFXError(f"{type(error).__name__}: {message(error)}"))


def unpack_error(text: bytes) -> BaseException:
    """Restore an exception from the bytes of `pack_error`."""
    try:
        content = pickle.loads(text)
    except Exception as error:  # noqa: BLE001 - a type that is only there in the other process
        return GraspFXError(f"the servo's process raised an exception of an unknown type: {message(error)}")
    if isinstance(content, BaseException):
        return content
    kind, arguments, values = content
    result: BaseException = kind.__new__(kind)
    result.args = arguments
    vars(result).update(values)
    return result


def _written(error: BaseException) -> bytes:
    """Pickle an exception by its method `__reduce__`, because methods registered by packages may omit attributes."""
    text = BytesIO()
    pickler = pickle.Pickler(text, pickle.HIGHEST_PROTOCOL)
    pickler.dispatch_table = {}
    pickler.dump(error)
    return text.getvalue()


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    """Replace each attribute that cannot be pickled by a text with the name of the attribute's type."""
    plain = {}
    for name, value in values.items():
        try:
            pickle.dumps(value)
        except Exception:  # noqa: BLE001 - as in `pack_error`
            value = f"a {type(value).__name__}"
        plain[name] = value
    return plain
