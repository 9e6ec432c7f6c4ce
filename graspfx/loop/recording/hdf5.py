"""The writer of recordings: one chunked HDF5 data set per variable, which is read back before anything else goes."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from io import FileIO
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from graspfx.loop.recording.checks import NUMBER, has_digest, seal
from graspfx.loop.recording.header import Header, Outcome, RunFault, conclusion, description
from graspfx.loop.recording.layout import Column, Layout
from graspfx.loop.recording.places import sync_folder
from graspfx.loop.recording.rows import RowStore
from graspfx.loop.recording.two_parts import RowSplit, splits_of
from graspfx.progress import waiting

FloatArray = NDArray[np.float64]

CHUNK, MOST_ROWS = 1 << 22, 1 << 15  # bytes of the rows, and rows, that the chunks of all variables hold together
LIBRARIES = ("v110", "v110")  # of HDF5 that can read the file: 1.10 and later
CACHE = 0  # bytes of chunks that a data set keeps in memory: each is written, and read back, whole


class Written(NamedTuple):
    """A variable of a file: its data set, how many of its numbers of a row come from where, and their type."""

    data: Any
    column: Column
    kind: np.dtype[Any]


class NotWhole(Exception):
    """A column of whole numbers has others."""


def write_recording(
    place: Path,
    rows: RowStore,
    layout: Layout,
    header: Header,
    outcome: Outcome,
    compression: str = "none",
    *,
    sync: bool = True,
) -> None:
    """Write rows and all that is known of them; a file that is there is replaced once the new one was read back.

    An exception that a signal raises must no more reach HDF5 than a failing write: `hold_signals` is to keep it away.

    Args:
        place: of the file, which is written beside it and moved there.
        rows: (N, width).
        layout, header, outcome: of the recording.
        compression: "gzip" or "lzf", or "none".
        sync: whether the disk is told to keep it before it is moved.

    Raises:
        OSError: the disk does not take it; nothing has changed then.
    """
    draft = place.with_name(place.name + ".tmp")
    size = chunk_rows(layout, len(rows))
    try:
        with waiting(f"writing {place.name}", 2 * len(rows), "rows") as wait:

            def done(count: int) -> None:
                wait.done += count

            try:
                _write(draft, rows, size, layout, header, outcome, compression, done, sync=sync)
            except NotWhole:  # as of rows that were lost, which are NaN
                wait.done = 0
                _write(draft, rows, size, layout, header, outcome, compression, done, sync=sync, plain=True)
            _read_back(draft, len(rows), size, done)
        draft.replace(place)
        if sync:
            sync_folder(place.parent)
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)


def chunk_rows(layout: Layout, count: int) -> int:
    """Count the rows of a chunk, the same ones in every variable."""
    return max(1, min(count, MOST_ROWS, CHUNK // (NUMBER.itemsize * max(layout.width, 1))))


def _write(
    draft: Path, rows: RowStore, size: int, layout: Layout, header: Header, outcome: Outcome, compression: str,
    done: Callable[[int], None], *, sync: bool, plain: bool = False,
) -> None:  # fmt: skip
    stream = Stream(draft)
    try:
        with h5py.File(stream, "w", driver="fileobj", libver=LIBRARIES, rdcc_nbytes=CACHE) as file:
            for name, value in (description(layout, header) | conclusion(outcome)).items():
                file.attrs[name] = value
            _write_faults(file, outcome.faults)
            storage: dict[str, Any] = {"chunks": size, "fletcher32": True}
            if compression != "none":
                storage |= {"compression": compression, "shuffle": True}
            time, variables = _make_variables(file, layout, header, len(rows), storage, plain=plain)
            splits = splits_of(header, outcome.changes) if header.split and layout.forces else []
            forces = [column.name for column in layout.forces]
            for first in range(0, len(rows), size):
                stop = min(first + size, len(rows))
                block = rows.read(first, stop, slice(0, layout.width))
                time[first:stop] = np.arange(first, stop) * header.every * header.period
                parts = RowSplit(block, layout, splits, first).derived(forces) if splits else {}
                for each in variables:
                    values = parts.get(each.column.name, block[:, each.column.where])
                    each.data[first:stop] = _as_stored(values, each.kind).reshape(stop - first, *each.column.shape)
                stream.require()
                done(stop - first)
            file.flush()
            stream.require()
            apart = _chunks([time, *(each.data for each in variables)])
        stream.seal(apart)
        stream.finish(sync=sync)
    finally:
        stream.close()


def _as_stored(values: FloatArray, kind: np.dtype[Any]) -> NDArray[Any]:
    """Convert numbers of a row to those of a file.

    Raises:
        NotWhole: they would not come back to the same bits.
    """
    if kind == NUMBER:
        return values
    with np.errstate(invalid="ignore"):
        stored = values.astype(kind)
    if not np.array_equal(stored.astype(NUMBER).view(np.int64), np.ascontiguousarray(values).view(np.int64)):
        raise NotWhole
    return stored


def _write_faults(file: Any, faults: Sequence[RunFault]) -> None:
    group = file.create_group("faults")
    messages = [fault.message.encode() for fault in faults]
    ticks = group.create_dataset("tick", data=np.array([fault.tick for fault in faults], np.int64))
    ticks.make_scale("tick")
    longest = max([1, *map(len, messages)])
    texts = group.create_dataset("message", data=np.array(messages, f"S{longest}"))
    texts.dims[0].attach_scale(ticks)


def _make_variables(
    file: Any, layout: Layout, header: Header, count: int, storage: dict[str, Any], *, plain: bool
) -> tuple[Any, list[Written]]:
    """Make the data sets of the time, of the columns and of the two forces, with units and scales of dimensions."""

    def made(name: str, shape: tuple[int, ...], kind: np.dtype[Any]) -> Any:
        if not count:
            return file.create_dataset(name, (0, *shape), kind)
        return file.create_dataset(name, (count, *shape), kind, **storage | {"chunks": (storage["chunks"], *shape)})

    time = made("time", (), NUMBER)
    time.attrs["units"] = "s"
    scales = {"time": time}
    for name, entries in layout.scales.items():
        scales[name] = file.create_dataset(name, data=list(entries), dtype=h5py.string_dtype())
    for name, scale in scales.items():
        scale.make_scale(name)
    variables = []
    for column in (*layout.columns.values(), *(layout.forces if header.split else ())):
        each = Written(made(column.name, column.shape, NUMBER if plain else column.stored), column,
                       NUMBER if plain else column.stored)  # fmt: skip
        for i, name in enumerate(("time", *column.dimensions)):
            each.data.dims[i].attach_scale(scales[name])
        each.data.attrs["units"], each.data.attrs["long_name"] = column.unit, column.meaning
        if column.kind == "bool" and not plain:
            each.data.attrs["dtype"] = "bool"  # as xarray marks it
        variables.append(each)
    return time, variables


def _chunks(variables: Sequence[Any]) -> list[tuple[int, int]]:
    """List where the chunks of data sets begin and end in the file, neighbours as one."""
    places: list[tuple[int, int]] = []
    for data in variables:
        if data.chunks is not None:
            data.id.chunk_iter(lambda chunk: places.append((chunk.byte_offset, chunk.byte_offset + chunk.size)))
    joined: list[tuple[int, int]] = []
    for start, end in sorted(places):
        if joined and joined[-1][1] == start:
            joined[-1] = joined[-1][0], end
        else:
            joined.append((start, end))
    return joined


def _read_back(draft: Path, count: int, size: int, done: Callable[[int], None]) -> None:
    """Read a file that was written: its digest, and every chunk with its checksum.

    Raises:
        OSError: it does not hold what was written.
    """
    if not has_digest(draft):
        raise OSError(f"{draft} does not end in its digest")
    with h5py.File(draft, "r", rdcc_nbytes=CACHE) as file:
        names: list[str] = []
        file.visit(names.append)
        variables = [data for name in names if isinstance(data := file[name], h5py.Dataset) and data.chunks]
        room = {data.name: np.empty((min(size, count), *data.shape[1:]), data.dtype) for data in variables}
        for first in range(0, count, size):
            stop = min(first + size, count)
            for data in variables:
                data.read_direct(room[data.name], np.s_[first:stop], np.s_[: stop - first])
            done(stop - first)


class Stream:
    """An open file for HDF5, which must not see that a write fails: what is written from then on stays in memory.

    HDF5 2.0 ends the process with a segmentation fault when it closes a file of which a write has failed. So it never
    sees one: the writer asks `require()` between blocks, and leaves.

    Args:
        path: of the file, replaced if it is there.
    """

    def __init__(self, path: Path) -> None:
        self._file = FileIO(path, "w+b")
        self._place = self._size = 0
        self._failure: OSError | None = None
        self._overlay: list[tuple[int, bytes]] = []

    def require(self) -> None:
        """Raise the first failure, if there was one."""
        if self._failure is not None:
            raise self._failure

    def seal(self, apart: Sequence[tuple[int, int]]) -> None:
        """Append the digest of all that was written but for stretches with checksums of their own."""
        size = self.seek(0, os.SEEK_END)
        line = seal(self, size, apart)
        self.seek(size)
        self.write(line)

    def finish(self, *, sync: bool = True) -> None:
        """Make sure that all of it was written, and that the disk keeps it.

        Raises:
            OSError: it does not.
        """
        self.require()
        if sync:
            os.fsync(self._file.fileno())

    def close(self) -> None:
        self._file.close()

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._place = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._place, os.SEEK_END: self._size}[whence]
        return self._place

    def tell(self) -> int:
        return self._place

    def read(self, size: int = -1, /) -> bytes:
        rest = max(0, self._size - self._place)
        buffer = bytearray(rest if size < 0 else min(size, rest))
        self.readinto(memoryview(buffer))
        return bytes(buffer)

    def readinto(self, buffer: memoryview) -> int:
        """Fill a buffer; with zeros where nothing was written."""
        start, end = self._place, self._place + len(buffer)
        self._file.seek(start)
        count = 0
        while count < len(buffer) and (more := self._file.readinto(buffer[count:])):
            count += more
        buffer[count:] = bytes(len(buffer) - count)
        for place, data in self._overlay:
            low, high = max(start, place), min(end, place + len(data))
            if low < high:
                buffer[low - start : high - start] = data[low - place : high - place]
        self._place = end
        return len(buffer)

    def write(self, data: bytes | memoryview) -> int:
        """Write all of it: into the file, or into memory after a failure."""
        size = len(data)
        if self._failure is None:
            try:
                self._push(memoryview(data))
            except OSError as error:
                self._failure = error
        if self._failure is not None:
            self._overlay.append((self._place, bytes(data)))
        self._place += size
        self._size = max(self._size, self._place)
        return size

    def truncate(self, size: int | None = None) -> int:
        self._size = self._place if size is None else size
        if self._failure is None:
            try:
                self._file.truncate(self._size)
            except OSError as error:
                self._failure = error
        return self._size

    def flush(self) -> None:
        """Flush nothing: writes go to the system at once."""

    def _push(self, data: memoryview) -> None:
        self._file.seek(self._place)
        while data:
            data = data[self._file.write(data) :]
