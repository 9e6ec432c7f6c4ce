"""The part of a recording that a run writes: rows and faults at the end of a file, each block with a digest.

What was written is never changed, so that a run that is killed, or a disk that is full, leaves every block before the
last as it was. Each block's digest is over the digest before it, too: none can be changed, moved or left out unnoticed.
"""

from __future__ import annotations

import json
import os
import struct
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from hashlib import blake2b
from io import FileIO
from pathlib import Path
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import RecordingError
from graspfx.loop.recording.attributes import (
    changes_of,
    changes_text,
    conclusion,
    description,
    format_of,
    header_of,
    layout_of,
    outcome_of,
)
from graspfx.loop.recording.header import Header, KeyChange, Outcome, RunFault
from graspfx.loop.recording.layout import Layout
from graspfx.loop.recording.lock import claim, release
from graspfx.loop.recording.places import sync_folder

FloatArray = NDArray[np.float64]

HEADER, ROWS, FAULTS, CHANGES, OUTCOME = b"GFXJ", b"rows", b"flts", b"chgs", b"done"
HEAD = struct.Struct("<4sQ16s")  # kind, bytes that follow, digest over the digest before and what follows
CHECK = struct.Struct("<I")  # of the head itself
NUMBER = np.dtype("<f8")
SYNC = 1.0  # [s] between two times that the disk is told to keep what it has
SECTOR = 512  # bytes that a disk writes at once: as many zeros at a file's end were never written


class Content(NamedTuple):
    """A part that was read: its rows, and what it says of them."""

    rows: FloatArray
    layout: Layout
    header: Header
    outcome: Outcome


class Journal:
    """Appends blocks to a part, under a lock that ends with the process.

    Args:
        path: of the part; one of a run that was killed is replaced.
        layout: the columns.
        header: of the recording.

    Raises:
        RecordingError: another run writes it, or it cannot be written.
    """

    def __init__(self, path: Path, layout: Layout, header: Header) -> None:
        self.path, self._width, self.rows = path, layout.width, 0
        self._end, self._digest = 0, b""
        self._is_new, self._sync_time = True, time.monotonic()  # the disk may not have its name yet
        text = json.dumps(description(layout, header)).encode()
        try:
            self.file = claim(path)
            while os.fstat(self.file.fileno()).st_size > 0:  # of a run that was killed: to empty it would take longer
                release(self.file, path)
                self.file = claim(path)
        except OSError as error:
            raise RecordingError(f"{path}: cannot be written; {error.strerror}") from error
        try:
            self._append([(HEADER, text)])
        except OSError as error:
            release(self.file, path)
            raise RecordingError(f"{path}: cannot be written; {error.strerror}") from error

    def write(self, rows: FloatArray, faults: Sequence[RunFault], changes: Sequence[KeyChange] = ()) -> None:
        """Append rows (r, width), the faults and the changes since the last ones; the disk gets them once a second.

        Raises:
            OSError: they do not fit; what was there before stays.
        """
        blocks = [(FAULTS, json.dumps(faults).encode())] if faults else []
        if changes:
            blocks.append((CHANGES, changes_text(changes).encode()))
        if len(rows):
            blocks.append((ROWS, np.ascontiguousarray(rows, NUMBER).tobytes()))
        self._append(blocks)
        self.rows += len(rows)
        if time.monotonic() - self._sync_time >= SYNC:
            self.sync()

    def conclude(self, outcome: Outcome) -> None:
        """Append how the run went.

        Raises:
            OSError: it does not fit.
        """
        self._append([(OUTCOME, json.dumps(conclusion(replace(outcome, changes=()))).encode())])  # they stand there
        self.sync()

    def sync(self) -> None:
        """Make the disk keep what was written so far."""
        os.fsync(self.file.fileno())
        if self._is_new:
            sync_folder(self.path.parent)
        self._is_new, self._sync_time = False, time.monotonic()

    def blocks(self) -> Iterator[FloatArray]:
        """Read the rows written so far, block by block; also of a part that was removed meanwhile."""
        for kind, content in _blocks(self.file):
            if kind == ROWS:
                yield np.frombuffer(content, NUMBER).reshape(-1, self._width)

    def _append(self, blocks: Sequence[tuple[bytes, bytes]]) -> None:
        digest, text = self._digest, bytearray()
        for kind, content in blocks:
            digest = _digest(digest, kind, content)
            head = HEAD.pack(kind, len(content), digest)
            text += head + CHECK.pack(crc32(head)) + content
        try:
            self.file.seek(self._end)
            view = memoryview(text)
            while view:
                view = view[self.file.write(view) :]
        except BaseException:
            with suppress(OSError):
                self.file.truncate(self._end)
            raise
        self._end, self._digest = self._end + len(text), digest


def is_journal(path: Path) -> bool:
    """Say whether a file begins as a part does, or is empty, as a part is at first."""
    with path.open("rb") as file:
        return file.read(len(HEADER)) in (HEADER, b"")


def read_journal(path: Path) -> Content:
    """Read all whole blocks of a part.

    Raises:
        RecordingError: there is none, or one was changed.
        ValueError: it is of a later GraspFX.
    """
    attributes: Mapping[str, Any] | None = None
    ending: Mapping[str, Any] = {"wall_time": "nan", "complete": 0}
    faults: list[RunFault] = []
    changes: list[KeyChange] = []
    rows: list[bytes] = []
    with FileIO(path) as file:
        for kind, content in _blocks(file):
            if kind == HEADER:
                attributes = json.loads(content)
            elif kind == ROWS:
                rows.append(content)
            elif kind == FAULTS:
                faults += [RunFault(int(tick), str(message)) for tick, message in json.loads(content)]
            elif kind == CHANGES:
                changes += changes_of(content)
            elif kind == OUTCOME:
                ending = json.loads(content)
    if attributes is None:
        raise RecordingError(f"{path}: holds nothing; its run ended before the first row")
    format_of(attributes)
    layout = layout_of(attributes)
    numbers = np.frombuffer(bytearray().join(rows), NUMBER).astype(np.float64, copy=False)
    outcome = replace(outcome_of(ending, faults), changes=tuple(changes))
    return Content(numbers.reshape(-1, layout.width), layout, header_of(attributes), outcome)


def _blocks(file: FileIO) -> Iterator[tuple[bytes, bytes]]:
    """Read each block's kind and content, as far as they are whole: the last one may have been cut short.

    Raises:
        RecordingError: a block was changed.
    """
    start, digest, size = 0, b"", os.fstat(file.fileno()).st_size
    while start + HEAD.size + CHECK.size <= size:
        file.seek(start)
        head, check = _read(file, HEAD.size), _read(file, CHECK.size)
        kind, length, next_digest = HEAD.unpack(head)
        is_whole = CHECK.pack(crc32(head)) == check
        end = start + HEAD.size + CHECK.size + length
        if is_whole and end > size:
            return  # cut short, as by a kill in the middle of a write
        content = _read(file, length) if is_whole else b""
        if not is_whole or _digest(digest, kind, content) != next_digest:
            if _ends_in_zeros(file, start):
                return
            raise RecordingError(f"{file.name!s}: its bytes were changed after byte {start}")
        yield kind, content
        start, digest = end, next_digest


def _digest(before: bytes, kind: bytes, content: bytes) -> bytes:
    digest = blake2b(before + kind, digest_size=16)
    digest.update(content)
    return digest.digest()


def _read(file: FileIO, count: int) -> bytes:
    parts = []
    while count > 0 and (part := file.read(count)):
        parts.append(part)
        count -= len(part)
    return b"".join(parts)


def _ends_in_zeros(file: FileIO, start: int) -> bool:
    """Say whether a file ends in zeros from there on, where power failed before the disk had all of it."""
    file.seek(start)
    rest = file.readall()
    return len(rest) - len(rest.rstrip(b"\0")) >= SECTOR
