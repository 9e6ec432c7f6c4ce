"""The part of a recording, a file to which a run appends blocks of rows and faults, each with a digest.

Blocks are never changed after they are written. If a run is killed or the disk is full, all blocks before the last are
intact. The digest of a block includes the digest of the previous block, so that a changed, moved or missing block is
detected.
"""

from __future__ import annotations

import json
import os
import struct
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from hashlib import blake2b
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import RecordingError
from graspfx.loop.columns import Layout, RunFault
from graspfx.recording.files import claim, release, sync_folder
from graspfx.recording.header import (
    Header,
    KeyChange,
    Outcome,
    changes_of,
    conclusion,
    description,
    format_of,
    header_of,
    layout_of,
    outcome_of,
)
from graspfx.recording.rows import NUMBER, BlockRows, MemoryRows, Piece, RowStore, check_of, opened, rows_sum

FloatArray = NDArray[np.float64]

HEADER, ROWS, FAULTS, CHANGES, OUTCOME = b"GFXJ", b"blck", b"flts", b"chgs", b"done"
OLD_ROWS = b"rows"  # formats 1 to 3: digest of every byte, and no computed variables
HEAD = struct.Struct("<4sQ16s")  # kind, size of the content, digest of the previous digest and the content
CHECK = struct.Struct("<I")  # checksum of the head itself
HEADS = HEAD.size + CHECK.size
SYNC = 1.0  # interval of flushes to disk [s]
SECTOR = 512  # sector size; as many zeros at a file's end were never written


class Content(NamedTuple):
    """An open recording: rows, layout, header and outcome."""

    rows: RowStore
    layout: Layout
    header: Header
    outcome: Outcome


class PartWriter:
    """Writer that appends blocks to a part, which is locked until the part is closed or the process ends.

    Args:
        path: Path of the part. The part of a killed run at this path is replaced.
        layout: Layout of the columns.
        header: Header of the recording.

    Raises:
        RecordingError: Another run is writing this part, or the part cannot be written.
    """

    def __init__(self, path: Path, layout: Layout, header: Header) -> None:
        self.path, self.wide, self.rows = path, layout.width, 0
        self._end, self._digest = 0, b""
        self._pieces: list[Piece] = []
        self.is_synced, self._sync_time = False, time.monotonic()  # the file's name is not flushed to disk yet
        text = json.dumps(description(layout, header) | {"wide": self.wide}).encode()
        try:
            self.file = claim(path)
            while os.fstat(self.file.fileno()).st_size > 0:  # part of a killed run; truncating it would take longer
                release(self.file, path)
                self.file = claim(path)
            try:
                self._append(HEADER, text)
            except OSError:
                release(self.file, path)
                raise
        except OSError as error:
            raise RecordingError(f"{path}: cannot be written; {error.strerror}") from error

    def stored(self) -> BlockRows:
        """Return the rows written so far; a block is verified when it is read."""
        return BlockRows(self.path, os.dup(self.file.fileno()), self.wide, self._pieces)

    def write(self, rows: FloatArray, faults: Sequence[RunFault], changes: Sequence[KeyChange] = ()) -> None:
        """Append rows (r, width), and the faults and changes since the last call; flush the file once a second.

        Raises:
            OSError: The rows do not fit on the disk. The largest of the first half, quarter, ... of the rows that fits
                is kept, and so are all earlier blocks.
        """
        if faults:
            self._append(FAULTS, json.dumps(faults).encode())
        if changes:
            self._append(CHANGES, json.dumps([list(change) for change in changes]).encode())
        if len(rows):
            whole = np.ascontiguousarray(rows, NUMBER)
            try:
                self._append_rows(whole)
            except OSError:
                self._append_some(whole)
                raise
        if time.monotonic() - self._sync_time >= SYNC:
            self.sync()

    def conclude(self, outcome: Outcome) -> None:
        """Append the outcome of the run.

        Raises:
            OSError: The outcome does not fit on the disk.
        """
        self._append(OUTCOME, json.dumps(conclusion(replace(outcome, changes=()))).encode())  # changes precede it
        if self.is_synced:
            self.sync()

    def sync(self) -> None:
        """Flush the written data to disk."""
        os.fsync(self.file.fileno())
        if not self.is_synced:
            sync_folder(self.path.parent)
        self.is_synced, self._sync_time = True, time.monotonic()

    def _append_rows(self, rows: FloatArray) -> None:
        """Append a block of rows; the size of its head is a multiple of a row's size, so that all rows are aligned."""
        fill, total = bytes(_lead(self.wide) - HEADS), rows_sum(rows)
        head, digest = self._head(ROWS, len(fill) + rows.nbytes, fill + total)
        piece = Piece(self.rows, len(rows), self._end, len(head + fill), check_of(head + fill, total))
        self._put([head + fill, memoryview(rows).cast("B")])
        self._digest, self.rows = digest, self.rows + len(rows)
        self._pieces.append(piece)

    def _append_some(self, rows: FloatArray) -> None:
        """Append the largest of the first half, quarter, ... of the rows that fits on the disk."""
        while len(rows) > 1:
            rows = rows[: len(rows) // 2]
            with suppress(OSError):
                self._append_rows(rows)
                return

    def _append(self, kind: bytes, content: bytes) -> None:
        head, digest = self._head(kind, len(content), content)
        self._put([head, content])
        self._digest = digest

    def _head(self, kind: bytes, size: int, content: bytes) -> tuple[bytes, bytes]:
        digest = _digest(self._digest, kind, content)
        head = HEAD.pack(kind, size, digest)
        return head + CHECK.pack(crc32(head)), digest

    def _put(self, parts: Sequence[bytes | memoryview]) -> None:
        """Write at the end of the file; if the data do not fit, remove what was written."""
        try:
            self.file.seek(self._end)
            for part in parts:
                view = memoryview(part)
                while view:
                    view = view[self.file.write(view) :]
        except BaseException:
            with suppress(OSError):
                self.file.truncate(self._end)
            raise
        self._end += sum(map(len, parts))


def _lead(wide: int) -> int:
    """Return the size in bytes of the head of a block of rows, which is a multiple of the size of a row."""
    size = NUMBER.itemsize * max(wide, 1)
    return -(-HEADS // size) * size


def is_part_file(path: Path) -> bool:
    """Return whether a file begins like a part, or is empty, like a part that has just been created."""
    with path.open("rb") as file:
        return file.read(len(HEADER)) in (HEADER, b"")


def read_part(path: Path) -> Content:
    """Open the complete blocks of a part; the rows stay in the file.

    Raises:
        RecordingError: The part has no blocks, or a block was changed.
        ValueError: A later version of GraspFX has written the part.
    """
    attributes: dict[str, Any] = {}
    ending: dict[str, Any] = {"wall_time": "nan", "complete": 0}
    faults, changes = list[RunFault](), list[KeyChange]()
    old_rows, pieces, count = list[bytes](), list[Piece](), 0
    with path.open("rb") as file:
        for kind, content, start in _blocks(file):
            if kind == HEADER:
                attributes = json.loads(content)
                format_of(attributes)
            elif kind == OLD_ROWS:
                old_rows.append(content)
            elif kind == ROWS and attributes:
                wide = int(attributes["wide"])
                rows = (len(content) + HEADS - _lead(wide)) // (NUMBER.itemsize * max(wide, 1))
                pieces.append(Piece(count, rows, start, _lead(wide)))
                count += rows
            elif kind == FAULTS:
                faults += [RunFault(int(tick), str(message)) for tick, message in json.loads(content)]
            elif kind == CHANGES:
                changes += changes_of(content)
            elif kind == OUTCOME:
                ending = json.loads(content)
    if not attributes:
        raise RecordingError(f"{path}: is empty; its run ended before the first row")
    layout = layout_of(attributes)
    outcome = replace(outcome_of(ending, faults), changes=tuple(changes))
    if "wide" in attributes:
        store: RowStore = BlockRows(path, opened(path), int(attributes["wide"]), pieces)
    else:
        numbers = np.frombuffer(bytearray().join(old_rows), NUMBER).astype(np.float64, copy=False)
        store = MemoryRows(numbers.reshape(-1, layout.width))
    return Content(store, layout, header_of(attributes), outcome)


def _blocks(file: BinaryIO) -> Iterator[tuple[bytes, bytes, int]]:
    """Yield the kind, the content and the start of each complete block; an incomplete last block is omitted.

    Raises:
        RecordingError: A block was changed.
    """
    start, digest, size, wide = 0, b"", os.fstat(file.fileno()).st_size, 0
    while start + HEADS <= size:
        file.seek(start)
        head = file.read(HEADS)
        kind, length, next_digest = HEAD.unpack(head[: HEAD.size])
        is_whole = CHECK.pack(crc32(head[: HEAD.size])) == head[HEAD.size :]
        end = start + HEADS + length
        if is_whole and end > size:
            return  # incomplete, for example after a kill during a write
        content = file.read(length) if is_whole else b""
        if not is_whole or _digest(digest, kind, _digested(kind, content, wide)) != next_digest:
            if _ends_in_zeros(file, start):
                return
            raise RecordingError(f"{file.name!s}: its bytes were changed after byte {start}")
        if kind == HEADER:
            wide = int(json.loads(content).get("wide", 0))
        yield kind, content, start
        if kind == OUTCOME:
            return  # before format 5, GraspFX appended data that make the part an HDF5 file
        start, digest = end, next_digest


def _digested(kind: bytes, content: bytes, wide: int) -> bytes:
    """Return the bytes of a block that its digest covers: the content or, for rows, padding and their checksum."""
    if kind != ROWS or not wide:
        return content
    fill = _lead(wide) - HEADS
    return content[:fill] + rows_sum(np.frombuffer(content, NUMBER, offset=fill).reshape(-1, wide))


def _digest(before: bytes, kind: bytes, content: bytes) -> bytes:
    return blake2b(before + kind + content, digest_size=16).digest()


def _ends_in_zeros(file: BinaryIO, start: int) -> bool:
    """Return whether the bytes of a file from `start` on end in SECTOR zeros or more, as after a power failure."""
    file.seek(start)
    rest = file.read()
    return len(rest) - len(rest.rstrip(b"\0")) >= SECTOR
