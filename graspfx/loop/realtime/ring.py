"""Memory that a servo shares with the process that records: rows, notes, letters and goals, and neither ever waits.

The memory begins with whole numbers, a line of the processor's cache each (`Word`); notes and letters follow, then the
rows, and goals of guided hands. Whoever writes rows publishes `HEAD` after the row, so that a reader who sees it sees
the row too.
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
PAGE = 4096  # bytes of the whole numbers
NOTES = 1 << 18  # bytes of notes
LETTERS = 1 << 18  # bytes of each of the two letters
NOTE_SIZE = 4  # bytes before a note, with its length
LETTER_HEAD = 3  # numbers of eight bytes before the parts: how many parts, objects and plants
IN_ORDER = platform.machine().lower() in ("x86_64", "amd64", "i386", "i686")  # processors that keep stores in order


class Word(IntEnum):
    """Places of the whole numbers at the beginning of the memory, counted in numbers of 8 bytes."""

    HEAD = 0  # ticks whose rows are there; the servo's
    TAIL = 8  # ticks whose rows were taken; the recorder's
    STOP = 16  # not zero: rest; the recorder's side
    BEAT = 24  # time.monotonic_ns of who recorded last; the recorder's side
    PHASE = 32  # of the servo, as `Phase`
    NOTES = 40  # bytes of notes that were ever there; the servo's
    MAIL = 48  # number of the last letter; the recorder's side
    SKIPPED = 56  # periods left out; the servo's
    DONE = 64  # number of the last letter that the servo has taken
    TICK = 72  # the tick from which on it holds; the servo's
    HALT = 80  # where it is not zero, one more than the tick before which simulations pause; the recorder's side
    GOAL = 88  # number of the last goals of guided hands; the recorder's side
    GOALS = 96  # how often goals were taken; the servo's
    NOTED = 104  # bytes of notes that were read; the recorder's
    CALL = 112  # of a device in Python that has the thread, as `DevicePort.place`; 0 for none; the servo's


class Phase(IntEnum):
    """Phases of a servo in a process of its own."""

    STARTING = 0
    OPEN = 1  # hardware is being opened, or settles: it is told zero
    RUNNING = 2  # hardware is told forces
    RESTED = 3  # every device was told zero, and none is told another force
    CLOSED = 4


def fence() -> None:
    """Let what was stored before be seen by whoever sees what is stored after."""
    if not IN_ORDER:
        for _ in range(2):
            with _LOCK:
                pass


_LOCK = Lock()


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
        """Give the notes that came since the last time."""
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
    """Memory that a servo and its recorder share.

    Args:
        file: descriptor of the memory, from `create`.
        width: numbers of a row.
        every: ticks from one row to the next.
        goals: G, numbers of the goals of guided hands.

    Attributes:
        words: (512,), at the places of `Word`.
        rows: (SLOTS, width); that of tick k is k / every modulo SLOTS, where `every` divides k.
        notes: of the servo.
        letters: the two halves of the mail box, bytes each.
        goals: (2, G), of which goals number k are row k modulo 2.
        goal_log: (SLOTS, 1 + G), a row for each time that goals were taken: the tick from which on they hold, and they.
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
        """Count the ticks after which a row is written over."""
        return SLOTS * self.every


def size_of(width: int, goals: int = 0) -> int:
    """Count the bytes of a ring."""
    beside = 8 * (2 * goals + SLOTS * (1 + goals)) if goals else 0
    return PAGE + NOTES + 2 * LETTERS + 8 * SLOTS * width + beside


def create(width: int, goals: int = 0) -> int:
    """Make the memory of a ring, which goes with the last process that has it; give its descriptor."""
    return shared_memory.create("graspfx-ring", size_of(width, goals))


class RingRecorder:
    """A recorder of ticks into a ring: it never waits, and who does not read in time loses the oldest rows.

    Args:
        ring: to write into.
    """

    def __init__(self, ring: Ring) -> None:
        self._ring, self.ticks = ring, 0
        self._words = memoryview(ring.memory).cast("q")

    @property
    def ring(self) -> Ring:
        """The ring; who writes into it himself sets `ticks`."""
        return self._ring

    @property
    def row(self) -> FloatArray:
        """The last row that a tick wrote."""
        row: FloatArray = self._ring.rows[(max(self.ticks, 1) - 1) // self._ring.every % SLOTS]
        return row

    def space(self) -> tuple[FloatArray, int, int]:
        """Give the rows, the place in them of the next tick, and how many ticks there are to the end."""
        place = self.ticks % self._ring.span
        return self._ring.rows, place, self._ring.span - place

    def take(self, count: int) -> None:
        """Publish what that many ticks more have written."""
        self.ticks += count
        fence()
        self._words[Word.HEAD] = self.ticks

    def drain(self) -> None:
        """Do nothing: the reader comes by himself."""

    def fault(self, k: int, message: str) -> None:
        self._ring.notes.add(("fault", k, message))

    def change(self, k: int, values: Mapping[str, Any]) -> None:
        self._ring.notes.add(("change", k, dict(values)))


# Letters --------------------------------------------------------------------------------------------------------------

# Each letter is taken whole between two ticks. There are two places for letters, taken in turn; a letter is published
# by its number once all of it stands there, and the next is written when the servo has taken it. The servo never waits,
# and finds no half of a letter.


class Letter(NamedTuple):
    """New numbers of memories.

    Attributes:
        entries: of each memory, by its number: places, and what is written there.
        objects: numbers of the objects that take over what follows from them.
        plants: numbers of the plants that take hold of their hands anew.
    """

    entries: Sequence[tuple[int, Index, FloatArray]]
    objects: Sequence[int]
    plants: Sequence[int] = ()


def write_letter(letter: Letter, place: memoryview) -> None:
    """Write a letter to its place.

    Raises:
        InputError: it is longer than there is room.
    """
    head: list[int] = [len(letter.entries), len(letter.objects), len(letter.plants), *letter.objects, *letter.plants]
    for memory, places, _ in letter.entries:
        head += [memory, len(places)]
    parts = [np.array(head, np.int64).tobytes()]
    parts += [np.asarray(places, np.int64).tobytes() for _, places, _ in letter.entries]
    parts += [np.asarray(numbers, np.float64).tobytes() for _, _, numbers in letter.entries]
    text = b"".join(parts)
    if len(text) > len(place):
        raise InputError("values", len(text), f"new numbers of {len(place)} bytes at most", "change fewer keys at once")
    place[: len(text)] = text


def read_letter(place: memoryview) -> Letter:
    """Read a letter, a copy."""
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


# Exceptions on their way to another process: the same type, the same words, no traceback ------------------------------


def pack_error(error: BaseException) -> bytes:
    """Write an exception so that `unpack_error` makes it again; one that cannot be written leaves its words."""
    error = error.with_traceback(None)
    with suppress(Exception):  # others' exceptions may hold anything
        text = _written(error)
        if type(pickle.loads(text)) is type(error):
            return text
    with suppress(Exception):  # as above
        text = pickle.dumps((type(error), error.args, _plain(vars(error))))
        pickle.loads(text)
        return text
    return pickle.dumps(GraspFXError(f"{type(error).__name__}: {message(error)}"))


def unpack_error(text: bytes) -> BaseException:
    """Make an exception again."""
    try:
        content = pickle.loads(text)
    except Exception as error:  # noqa: BLE001 - a type that is only there in the other process
        return GraspFXError(f"the servo's process raised what this one does not know: {message(error)}")
    if isinstance(content, BaseException):
        return content
    kind, arguments, values = content
    result: BaseException = kind.__new__(kind)
    result.args = arguments
    vars(result).update(values)
    return result


def _written(error: BaseException) -> bytes:
    """Pickle an exception in its own way: packages such as dask register another one, which loses attributes."""
    text = BytesIO()
    pickler = pickle.Pickler(text, pickle.HIGHEST_PROTOCOL)
    pickler.dispatch_table = {}
    pickler.dump(error)
    return text.getvalue()


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    """Write attributes that are no data by their types alone."""
    plain = {}
    for name, value in values.items():
        try:
            pickle.dumps(value)
        except Exception:  # noqa: BLE001 - as in `pack_error`
            value = f"a {type(value).__name__}"
        plain[name] = value
    return plain
