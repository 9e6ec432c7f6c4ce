"""HDF5 files of recordings: writing of one chunked data set per variable, and reading of files of every format."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from io import FileIO
from os import PathLike
from pathlib import Path
from typing import Any
from weakref import finalize

import h5py
import numpy as np
from numpy.typing import NDArray

from graspfx.errors import RecordingError
from graspfx.loop.columns import Column, Layout, RunFault
from graspfx.progress import Wait, waiting
from graspfx.recording.files import PIECE, has_digest, recording_file, seal, sync_folder
from graspfx.recording.header import (
    Header,
    Outcome,
    conclusion,
    description,
    format_of,
    header_of,
    layout_of,
    outcome_of,
)
from graspfx.recording.part import Content, is_part_file, read_part
from graspfx.recording.recorded_split import RowSplit, splits_of
from graspfx.recording.rows import NUMBER, BlockRows, DataSetRows, Piece, RowStore, opened, step_of

CHUNK, MOST_ROWS = 1 << 22, 1 << 15  # bytes of rows, and number of rows, per set of chunks of all variables
LIBRARIES = ("v110", "v110")  # HDF5 versions that can read the file: 1.10 and later
SEALS = 2  # first format whose files end in a digest
BLOCKS = 4  # the only format that stores rows in blocks; its variables are virtual data sets over them
CACHE = 1 << 20  # chunk cache of a data set that is read, in bytes
MOST_PACKED = 1032  # largest expansion of one byte by deflate, https://zlib.net/zlib_tech.html
ROWS, PIECES, PLACE = "rows/rows", "rows/pieces", ("first", "count", "offset", "lead")
SUPERBLOCK, VERSION, FLAGS, END = 48, 8, 11, slice(28, 36)  # HDF5 File Format Specification 3.0, II.A
SPAN, ACROSS = 16, 512  # 16-bit words summed together: their sums are exact in 24 bits
SUMS = np.stack([np.ones(SPAN), np.arange(SPAN)]).astype(np.float32)
# errors of HDF5, JSON and the layout's constructor for a corrupt or foreign file
UNREADABLE = (OSError, RuntimeError, LookupError, ValueError, TypeError, AttributeError, OverflowError, MemoryError)


class NotWhole(Exception):
    """Error for a column of integers that contains a number that is not an integer."""


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
    """Write a recording to a file; an existing file is replaced only after the new file has been read back.

    Call this function within `hold_signals`, because an exception of a signal handler must not pass through HDF5.

    Args:
        place: Path of the file. The function writes a draft beside this path, and then moves the draft to the path.
        rows: Rows, (N, width).
        layout, header, outcome: Layout, header and outcome of the recording.
        compression: Filter of the data sets: "gzip", "lzf" or "none".
        sync: Whether to flush the draft to disk before it is moved.

    Raises:
        OSError: The file cannot be written; an existing file is unchanged.
    """
    draft = place.with_name(place.name + ".tmp")
    # the fewest chunks of equal length: a short last chunk would take the space of a full one
    most = max(1, min(MOST_ROWS, CHUNK // (NUMBER.itemsize * max(layout.width, 1))))
    size = max(1, -(-len(rows) // max(1, -(-len(rows) // most))))
    try:
        with waiting(f"writing {place.name}", len(rows), "rows") as wait:
            about = (layout, header, outcome, compression, wait)
            try:
                _write(draft, rows, size, *about, sync=sync)
            except NotWhole:  # for example for lost rows, which are NaN
                _write(draft, rows, size, *about, sync=sync, plain=True)
            _read_back(draft, 0 if compression != "none" else (len(rows) - 1) // size * size, len(rows), size)
        draft.replace(place)
        if sync:
            sync_folder(place.parent)
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)


def _write(
    draft: Path, rows: RowStore, size: int, layout: Layout, header: Header, outcome: Outcome, compression: str,
    wait: Wait, *, sync: bool, plain: bool = False,
) -> None:  # fmt: skip
    stream = Stream(draft)
    try:
        with h5py.File(stream, "w", driver="fileobj", libver=LIBRARIES, rdcc_nbytes=0) as file:
            for name, value in (description(layout, header) | conclusion(outcome)).items():
                file.attrs[name] = value
            _write_faults(file, outcome.faults)
            storage: dict[str, Any] = {"fletcher32": True}
            if compression != "none":
                storage |= {"compression": compression, "shuffle": True}
            forces = layout.forces if header.split else ()
            splits = splits_of(header, outcome.changes) if forces else []
            variables = _make_variables(file, layout, forces, (len(rows), size), storage, plain=plain)
            for first in range(0, len(rows), rows.step):
                block = rows.read(first, min(first + rows.step, len(rows)), slice(0, layout.width))
                times = header.every * np.arange(first, first + len(block), dtype=np.float64) * header.period
                parts = {"time": times, **RowSplit(block, layout, splits, first).derived([f.name for f in forces])}
                for name, variable in variables.items():
                    variable.add(parts[name] if name in parts else block[:, variable.where])
                stream.require()
                wait.done = first + len(block)
            for variable in variables.values():
                variable.flush()
            file.flush()
            stream.require()
            apart = _chunks([variable.data for variable in variables.values()])
        stream.seal(apart)
        stream.finish(sync=sync)
    finally:
        stream.close()


class Variable:
    """A data set that is written chunk by chunk.

    The checksum of a chunk is computed here, because HDF5 would copy the data more often.

    Args:
        data: Data set to write.
        where: Position of the variable's numbers in a row.
        direct: Whether to write chunks as they are stored, bypassing HDF5's filters.
    """

    def __init__(self, data: Any, where: slice, *, direct: bool) -> None:
        self.data, self.where, self._direct = data, where, direct
        shape = data.chunks or (0, *data.shape[1:])
        self._content = np.zeros(math.prod(shape) * data.dtype.itemsize + 4, np.uint8)
        self._values = self._content[:-4].view(data.dtype).reshape(shape)  # of the present chunk
        self._first = self._used = 0  # first row of the chunk, and number of its rows so far

    def add(self, values: NDArray[Any]) -> None:
        """Append rows, (r, ...).

        Raises:
            NotWhole: A number cannot be stored exactly in the type of the data set.
        """
        while len(values):
            part = self._values[self._used : self._used + len(values)]
            some, values = values[: len(part)].reshape(part.shape), values[len(part) :]
            if part.dtype == NUMBER:
                part[:] = some
            else:
                with np.errstate(invalid="ignore"):
                    part[:] = some.astype(part.dtype)
                if part.astype(NUMBER).tobytes() != some.tobytes():
                    raise NotWhole
            self._used += len(part)
            if self._used == len(self._values):
                self.flush()

    def flush(self) -> None:
        """Write the present chunk; the unused rows of the last chunk are filled with zeros."""
        if self._used and self._direct:
            self._values[self._used :] = 0
            self._content[-4:] = np.frombuffer(fletcher32(self._content[:-4]).to_bytes(4, "little"), np.uint8)
            self.data.id.write_direct_chunk((self._first, *[0] * (self._values.ndim - 1)), self._content)
        elif self._used:
            self.data[self._first : self._first + self._used] = self._values[: self._used]
        self._first, self._used = self._first + self._used, 0


def fletcher32(content: NDArray[np.uint8]) -> int:
    """Compute HDF5's checksum of m 16-bit words w_i: the sums of w_i and of (m - i) w_i, each modulo 65535.

    A nonzero sum gives a number between 1 and 65535. HDF5 reads words in big-endian order, which multiplies both sums
    by 256. Here the words are in the stored byte order, in groups of up to `SPAN` words, whose sums are exact in single
    precision.
    """
    m = -(-len(content) // 2)
    words = np.empty((-(-m // (SPAN * ACROSS)), SPAN, ACROSS), np.float32)
    flat = words.reshape(-1)
    flat[m - 1 :] = 0.0
    flat[m - 1 : m] = content[-1]  # pad an odd number of bytes with zero
    flat[: len(content) // 2] = content[: len(content) // 2 * 2].view("<u2")
    sums = (SUMS @ words).astype(np.float64)
    groups, across = sums.sum(axis=2).astype(np.int64), sums.sum(axis=0).astype(np.int64)
    total = int(groups[:, 0].sum())
    weighted = ACROSS * (SPAN * int(np.arange(len(groups)) @ groups[:, 0]) + int(groups[:, 1].sum()))
    weighted += int(np.arange(ACROSS) @ across[0])  # sum i w_i
    low, high = ((256 * each - 1) % 65535 + 1 if each else 0 for each in (total, m * total - weighted))
    return high << 16 | low


def _write_faults(file: Any, faults: Sequence[RunFault]) -> None:
    group = file.create_group("faults")
    messages = [fault.message.encode() for fault in faults]
    ticks = group.create_dataset("tick", data=np.array([fault.tick for fault in faults], np.int64))
    ticks.make_scale("tick")
    longest = max([1, *map(len, messages)])
    texts = group.create_dataset("message", data=np.array(messages, f"S{longest}"))
    texts.dims[0].attach_scale(ticks)


def _make_variables(
    file: Any, layout: Layout, forces: Sequence[Column], shape: tuple[int, int], storage: dict[str, Any], *, plain: bool
) -> dict[str, Variable]:
    """Create the data sets of the time, the columns, and the external and internal forces, with units and scales."""
    count, size = shape
    time = Column("time", slice(0, 0), (), (), "s", "")
    scales: dict[str, Any] = {}
    variables: dict[str, Variable] = {}
    for column in (time, *layout.columns.values(), *forces):
        kind = NUMBER if plain else column.stored
        chunked = storage | {"chunks": (size, *column.shape)} if count else {}
        data = file.create_dataset(column.name, (count, *column.shape), kind, **chunked)
        variables[column.name] = Variable(data, column.where, direct="compression" not in storage)
        data.attrs["units"] = column.unit
        if column is time:
            scales["time"] = data
            for name, entries in layout.scales.items():
                scales[name] = file.create_dataset(name, data=list(entries), dtype=h5py.string_dtype())
            for name, scale in scales.items():
                scale.make_scale(name)
            continue
        for i, name in enumerate(("time", *column.dimensions)):
            data.dims[i].attach_scale(scales[name])
        data.attrs["long_name"] = column.meaning
        if column.kind == "bool" and not plain:
            data.attrs["dtype"] = "bool"  # the mark that xarray uses
    return variables


def _chunks(variables: Sequence[Any]) -> list[tuple[int, int]]:
    """Return the byte ranges of all chunks of the data sets in the file, with adjacent ranges merged."""
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


def _read_back(draft: Path, first: int, count: int, size: int) -> None:
    """Verify the digest of a file that HDF5 wrote, and the checksums of the chunks from row `first` on.

    All bytes were read back and compared when they were written. Of the chunks whose checksums were computed by
    `Variable`, only the last is therefore read again.

    Args:
        draft: Path of the file.
        first: First row whose chunk is read.
        count, size: Number of rows, and number of rows per chunk.

    Raises:
        OSError: The file does not end in its digest, or a checksum does not match.
    """
    if not has_digest(draft):
        raise OSError(f"{draft} does not end in its digest, although it was written completely")
    with h5py.File(draft, "r", rdcc_nbytes=0) as file:
        names: list[str] = []
        file.visit(names.append)
        for name in names:
            if isinstance(data := file[name], h5py.Dataset) and data.chunks:
                for k in range(max(first, 0), count, size):
                    data[k : k + size]


class Stream:
    """An open file that hides failed writes from HDF5: after a failure, data are kept in memory.

    HDF5 2.0 crashes with a segmentation fault when it closes a file after a failed write. Therefore HDF5 never sees the
    failure; the caller of HDF5 calls `require()` between blocks, which raises the error. All bytes are read back and
    compared after they are written.

    Args:
        path: Path of the file. An existing file is replaced.
    """

    def __init__(self, path: Path) -> None:
        self._file, self._path = FileIO(path, "w+b"), path
        self._place = self._size = 0
        self._failure: OSError | None = None
        self._overlay: list[tuple[int, bytes]] = []

    def require(self) -> None:
        """Raise the error of the first failed operation, if any."""
        if self._failure is not None:
            raise self._failure

    def seal(self, apart: Sequence[tuple[int, int]]) -> None:
        """Append the digest of the file; the ranges `apart`, which have checksums, are not part of the digest."""
        size = self.seek(0, os.SEEK_END)
        line = seal(self, size, apart)
        self.seek(size)
        self.write(line)

    def finish(self, *, sync: bool = True) -> None:
        """Raise the error of the first failed operation, if any, and flush the file to disk if `sync` is True.

        Raises:
            OSError: An earlier operation or the flush failed.
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
        """Fill a buffer with the bytes from the present position on; bytes that are not written are zeros."""
        start, end = self._place, self._place + len(buffer)
        count = self._pull(start, buffer)
        buffer[count:] = bytes(len(buffer) - count)
        for place, data in self._overlay:
            low, high = max(start, place), min(end, place + len(data))
            if low < high:
                buffer[low - start : high - start] = data[low - place : high - place]
        self._place = end
        return len(buffer)

    def write(self, data: bytes | memoryview) -> int:
        """Write all bytes to the file, or keep them in memory if an operation has failed; return their number."""
        size = len(data)
        self._attempt(lambda: self._push(memoryview(data)))
        if self._failure is not None:
            self._overlay.append((self._place, bytes(data)))
        self._place += size
        self._size = max(self._size, self._place)
        return size

    def truncate(self, size: int | None = None) -> int:
        self._size = self._place if size is None else size
        self._attempt(lambda: self._file.truncate(self._size))
        return self._size

    def flush(self) -> None:
        """Do nothing, because writes are not buffered."""

    def _attempt(self, act: Callable[[], object]) -> None:
        try:
            if self._failure is None:
                act()
        except OSError as error:
            self._failure = error

    def _push(self, data: memoryview) -> None:
        self._file.seek(self._place)
        rest = data
        while rest:
            rest = rest[self._file.write(rest) :]
        for k in range(0, len(data), PIECE):
            part = data[k : k + PIECE]
            back = bytearray(len(part))
            if self._pull(self._place + k, memoryview(back)) < len(part) or back != part:
                raise OSError(f"{self._path} does not contain the bytes that were written to it")

    def _pull(self, place: int, buffer: memoryview) -> int:
        self._file.seek(place)
        count = 0
        while count < len(buffer) and (more := self._file.readinto(buffer[count:])):
            count += more
        return count


# Reading: every HDF5 format so far, and the part of a running or killed run ----------------------------


def read(path: str | PathLike[str]) -> tuple[RowStore, Layout, Header, Outcome]:
    """Open the rows of a recording, and read its layout, header and outcome.

    Of a run that was killed, the rows that were written can be read.

    Args:
        path: Path of the file, of its part, or of the folder that contains recording.h5. If the file does not exist,
            the part beside it is read.

    Raises:
        RecordingError: The file does not exist, is not a recording, or was changed after it was written.
    """
    place = recording_file(path)
    if not place.is_file():
        raise RecordingError(f"{place}: the file does not exist")
    if place.suffix == ".toml":
        raise RecordingError(f"{place}: is a scene, not a recording: run it first, and give the path of its recording")
    try:
        return read_part(place) if is_part_file(place) else _read_hdf5(place)
    except UNREADABLE as error:
        raise RecordingError(f"{place}: cannot be read as a recording; {_line(error)}") from error


def _read_hdf5(place: Path) -> Content:
    whole = has_digest(place)  # before HDF5 reads bytes that may have been changed
    stream = FileIO(place)  # HDF5 identifies an open file by its path, even if the file was replaced
    file = None
    try:
        file = _open(place, stream)
        require_contained(file, place)
        number = format_of(file.attrs)
        if number >= SEALS and not whole:
            raise ValueError("it was changed since it was written, because its digest is missing")
        layout = _drop_columns(layout_of(file.attrs), file, number)
        header, outcome = header_of(file.attrs), _outcome(file)
        rows = _rows(place, file, layout, number)
        if isinstance(rows, DataSetRows):
            finalize(rows, _close, file, stream)
        else:
            _close(file, stream)
        return Content(rows, layout, header, outcome)
    except BaseException:
        _close(file, stream)
        raise


def _close(*files: Any) -> None:
    for file in files:
        if file is not None:
            file.close()


def require_contained(file: Any, place: Path) -> None:
    """Require that all data of an open HDF5 file are stored in this file, and are not larger than it can contain.

    HDF5 reads other files through external links, external storage, and virtual data sets whose source is not the file
    itself ("."). GraspFX never writes any of these, but a crafted file could use them to read other files.

    Raises:
        ValueError: Data are stored in another file, or a data set is larger than the file can contain.
    """
    room = MOST_PACKED * place.stat().st_size

    links: list[tuple[bytes, int]] = []
    file.id.links.visit(lambda name, link: links.append((name, link.type)), info=True)
    sources = set[str]()
    for name, kind in links:
        text = name.decode(errors="replace")
        if kind not in (h5py.h5l.TYPE_HARD, h5py.h5l.TYPE_SOFT):
            raise ValueError(f"{text} is a link to another file, which is not read")
        if kind == h5py.h5l.TYPE_SOFT or h5py.h5o.get_info(file.id, name).type != h5py.h5o.TYPE_DATASET:
            continue
        data = h5py.h5d.open(file.id, name)
        storage = data.get_create_plist()
        if storage.get_external_count():
            raise ValueError(f"{text} is stored in another file (external storage), which is not read")
        if storage.get_layout() == h5py.h5d.VIRTUAL:
            maps = range(storage.get_virtual_count())
            if any(storage.get_virtual_filename(k) != "." for k in maps):
                raise ValueError(f"{text} is stored in another file (virtual data set), which is not read")
            sources.update(storage.get_virtual_dsetname(k) for k in maps)
        elif math.prod(data.shape) * data.get_type().get_size() > room:
            raise ValueError(f"{text} is {data.shape} of {data.dtype}, more than a file of this size can contain")
    for source in sources:  # HDF5 crashes if a virtual data set refers to itself
        if h5py.h5d.open(file.id, source.encode()).get_create_plist().get_layout() == h5py.h5d.VIRTUAL:
            raise ValueError(f"{source} is a virtual data set of virtual data sets, which is not read")


def _rows(place: Path, file: Any, layout: Layout, number: int) -> RowStore:
    """Open the rows: in format 4, blocks or one table of all columns; in other formats, one data set per variable.

    Raises:
        ValueError: A variable or the table of rows has a wrong shape or type.
        KeyError: A variable is missing.
    """
    (count,) = file["time"].shape
    forces = [each for each in layout.forces if each.name in file] if number > BLOCKS else []  # with checksums
    variables = {column.name: file[column.name] for column in (*layout.columns.values(), *forces)}
    for column in (*layout.columns.values(), *forces):
        variable = variables[column.name]
        if variable.shape != (count, *column.shape) or variable.dtype.kind not in "biuf":
            kind = f"{variable.shape} of {variable.dtype}"
            raise ValueError(f"{column.name} is {kind}, expected numbers {(count, *column.shape)}")
    table = file[PIECES] if number == BLOCKS and PIECES in file else None
    data = [(column.where, variables[column.name]) for column in layout.columns.values()]
    shape: tuple[int, ...] = count, layout.width
    if table is not None:
        shape = int(table["count"].sum()), int(table.attrs["wide"])
    elif number == BLOCKS and ROWS in file:
        shape = file[ROWS].shape
        data = [(slice(0, shape[-1]), file[ROWS])]
    if len(shape) != 2 or shape[0] != count or shape[1] < layout.width:
        raise ValueError(f"its rows are {shape}, expected {count} of {layout.width} numbers or more")
    if table is not None:
        pieces = [
            Piece(*(int(each[name]) for name in PLACE), each["check"].tobytes())  # type: ignore[call-arg, arg-type]
            for each in table[:]
        ]
        return BlockRows(place, opened(place), shape[1], pieces)
    step = next((each.chunks[0] for _, each in data if each.chunks), step_of(layout.width))
    return DataSetRows(place, data, count, max(1, step), {each.name: variables[each.name] for each in forces})


def _open(place: Path, stream: FileIO) -> Any:
    """Open an HDF5 file, including a file of format 1 that a killed run left marked as open for writing."""
    try:
        return h5py.File(stream, "r", driver="fileobj", rdcc_nbytes=CACHE)
    except OSError:
        if not _left_open(place):
            raise
        return h5py.File(place, "r", libver="latest", swmr=True, rdcc_nbytes=CACHE)


def _left_open(place: Path) -> bool:
    """Return whether a file is marked as open for writing and has its full length.

    The mark is in version 3 of the HDF5 superblock. In SWMR mode, HDF5 waits forever for the missing bytes of a
    truncated file; a truncated file must therefore not be opened in this mode.
    """
    with place.open("rb") as file:
        head = file.read(SUPERBLOCK)
    if len(head) < SUPERBLOCK or head[VERSION] != 3 or not head[FLAGS]:
        return False
    return place.stat().st_size >= int.from_bytes(head[END], "little")


def _drop_columns(layout: Layout, file: Any, number: int) -> Layout:
    """Return the layout without the optional columns that a file of an early format (below 3) does not contain."""
    if number >= 3:
        return layout
    absent = [name for name in layout.columns if name not in file and not layout.is_essential(name)]
    return replace(layout, absent=(*layout.absent, *absent)) if absent else layout


def _outcome(file: Any) -> Outcome:
    ticks, messages = file["faults/tick"][:], file["faults/message"][:]
    faults = [RunFault(int(tick), text.decode(errors="ignore")) for tick, text in zip(ticks, messages, strict=False)]
    return outcome_of(file.attrs, faults)


def _line(error: Exception) -> str:
    """Return the message of an exception as one line."""
    return " ".join(str(error).split())
