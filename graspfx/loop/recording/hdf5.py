"""Recordings as HDF5: rows in one data set, and each variable a virtual data set over its columns of it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from io import BytesIO
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import DTypeLike, NDArray

from graspfx.loop.recording.attributes import conclusion, description
from graspfx.loop.recording.check import NUMBER, check_of, rows_sum
from graspfx.loop.recording.header import Header, Outcome, RunFault
from graspfx.loop.recording.journal import Journal
from graspfx.loop.recording.layout import Column, Layout
from graspfx.loop.recording.places import sync_folder
from graspfx.loop.recording.row_store import Piece
from graspfx.loop.recording.scales import LOGICAL, scales_of, stored_type
from graspfx.loop.recording.seal import seal
from graspfx.loop.recording.stream import Graft, Stream

FloatArray = NDArray[np.float64]

TIMES = 1 << 16  # that are written at once
ROWS, BLOCKS, REST, PIECES = "rows/rows", "rows/blocks", "rows/rest", "rows/pieces"


class Misplaced(Exception):
    """HDF5 does not put a data set where the rows are."""


def convert(
    journal: Journal, place: Path, layout: Layout, header: Header, outcome: Outcome, compression: str = "none"
) -> None:
    """Make the recording of a part at its place: in the part itself where its blocks are alike, else as a copy.

    An exception that a signal raises must no more reach HDF5 than a failing write: `hold_signals` is to keep it away.

    Raises:
        OSError: the disk does not take it; nothing has changed then.
    """
    if compression == "none" and place.parent == journal.path.parent and _is_regular(journal):
        with suppress(Misplaced):
            _complete(journal, place, layout, header, outcome)
            return
    write_hdf5(place, journal.blocks(), journal.rows, journal.wide, layout, header, outcome, compression,
               sync=journal.is_synced)  # fmt: skip


def write_hdf5(
    place: Path,
    blocks: Iterable[FloatArray],
    count: int,
    wide: int,
    layout: Layout,
    header: Header,
    outcome: Outcome,
    compression: str = "none",
    *,
    sync: bool = True,
) -> None:
    """Write `count` rows, in blocks (r, wide), and all that is known of them; a file that is there is replaced.

    Args:
        place: of the file, which is written beside it and moved there.
        blocks: rows with what follows from them (`wide_rows`).
        count, wide: their shape, in all.
        layout, header, outcome: of the recording.
        compression: "gzip" or "lzf", or "none".
        sync: whether the disk is told to keep it before it is moved.

    Raises:
        OSError: the disk does not take it; nothing has changed then.
    """
    draft = place.with_name(place.name + ".tmp")
    stream = Stream(draft)
    try:
        pieces: list[Piece] = []
        with h5py.File(stream, "w", driver="fileobj", libver="latest") as file:
            _describe(file, layout, header, outcome)
            if compression == "none":
                offset = _room(file, ROWS, (count, wide)) if count else 0
            else:
                _pack(file, _tracked(blocks, stream.require), count, wide, compression)
            sources = [(file[ROWS], 0, count)] if count else []
            _variables(file, layout, header, count, sources)
            if compression == "none":
                for rows in _tracked(blocks, stream.require):
                    content = np.ascontiguousarray(rows, NUMBER)
                    first = pieces[-1].first + pieces[-1].count if pieces else 0
                    start = offset + first * wide * NUMBER.itemsize
                    total = rows_sum(memoryview(content.reshape(-1)), wide)
                    pieces.append(Piece(first, len(rows), start, 0, check_of(b"", total)))
                    stream.seek(start)
                    stream.write(memoryview(content.reshape(-1)).cast("B"))
                _list_pieces(file, pieces, wide)
            stream.require()
        _seal(stream, (offset, offset + count * wide * NUMBER.itemsize) if compression == "none" else None)
        stream.finish(sync=sync)
        stream.close()
        draft.replace(place)
        if sync:
            sync_folder(place.parent)
    finally:
        stream.close()
        with suppress(OSError):
            draft.unlink(missing_ok=True)


def _complete(journal: Journal, place: Path, layout: Layout, header: Header, outcome: Outcome) -> None:
    """Make a part HDF5: what HDF5 has to say goes behind it and into its first bytes, and its blocks are a data set."""
    pieces, wide = journal.pieces, journal.wide
    rooms, sources = _rooms_of(journal)
    front = _front(tuple(room.name for room in rooms))
    rooms[0] = Room(rooms[0].name, (journal.start - front,), np.uint8, front)
    stream = Graft(journal.file, journal.end, front)
    try:
        with h5py.File(stream, "w", driver="fileobj", libver="latest") as file:
            _lay_out(file, rooms)
            places = [(file[name], lead, count) for name, lead, count in sources]
            _describe(file, layout, header, outcome)
            _variables(file, layout, header, journal.rows, places)
            _list_pieces(file, pieces, wide)
            stream.require()
        _seal(stream, (journal.start, journal.outcome_start))
        stream.require()
        if journal.is_synced:
            os.fsync(journal.file.fileno())
        stream.complete()
        if journal.is_synced:
            os.fsync(journal.file.fileno())
        journal.path.replace(place)
    except BaseException:
        with suppress(OSError):
            stream.withdraw()
        raise
    if journal.is_synced:
        sync_folder(place.parent)


def _is_regular(journal: Journal) -> bool:
    """Tell whether the blocks of a part are all rows, of one size but for the last, one behind the other."""
    end = journal.start
    for piece in journal.pieces:
        if piece.offset != end or (piece.count != journal.pieces[0].count and piece is not journal.pieces[-1]):
            return False
        if piece.count > journal.pieces[0].count:
            return False
        end = piece.offset + piece.lead + piece.count * journal.wide * NUMBER.itemsize
    return journal.rows > 0 and end == journal.outcome_start


def _seal(stream: Stream, rows: tuple[int, int] | None) -> None:
    size = stream.seek(0, os.SEEK_END)
    line = seal(stream, size, rows)
    stream.seek(size)
    stream.write(line)


def _tracked(blocks: Iterable[FloatArray], require: Callable[[], None]) -> Iterator[FloatArray]:
    """Give blocks as long as nothing has failed."""
    for rows in blocks:
        yield rows
        require()


# What a file has ----------------------------------------------------------------------------------------------------


def _describe(file: Any, layout: Layout, header: Header, outcome: Outcome) -> None:
    for name, value in (description(layout, header) | conclusion(outcome)).items():
        file.attrs[name] = value
    _write_faults(file, outcome.faults)


def _write_faults(file: Any, faults: Sequence[RunFault]) -> None:
    group = file.create_group("faults")
    messages = [fault.message.encode() for fault in faults]
    ticks = group.create_dataset("tick", data=np.array([fault.tick for fault in faults], np.int64))
    ticks.make_scale("tick")
    longest = max([1, *map(len, messages)])
    texts = group.create_dataset("message", data=np.array(messages, f"S{longest}"))
    texts.dims[0].attach_scale(ticks)


def _variables(
    file: Any, layout: Layout, header: Header, count: int, sources: Sequence[tuple[Any, int, int]]
) -> None:  # fmt: skip
    """Make the variables: a time, a virtual data set per column, and those that follow from columns, if they do.

    Args:
        sources: data sets that have the rows, one after the other, (rows, wide) or (blocks, rows, wide); of each how
            many rows of a block are none, and how many are in all.
    """
    scales = _scales(file, layout, header, count)
    columns, start = list(layout.columns.values()), layout.width
    places = [column.where.start for column in columns]
    if header.split:
        for column in layout.forces:
            columns.append(column)
            places.append(start)
            start += prod(column.shape)
    for column, place in zip(columns, places, strict=True):
        _variable(file, column, stored_type(column.name, layout), place, scales, count, sources)


def _scales(file: Any, layout: Layout, header: Header, count: int) -> dict[str, Any]:
    time = file.create_dataset("time", (count,), np.float64)
    for first in range(0, count, TIMES):
        last = min(first + TIMES, count)
        time[first:last] = np.arange(first, last) * header.every * header.period
    time.attrs["units"] = "s"
    scales = {"time": time}
    for name, entries in scales_of(layout).items():
        scales[name] = file.create_dataset(name, data=list(entries), dtype=h5py.string_dtype())
    for name, scale in scales.items():
        scale.make_scale(name)
    return scales


def _variable(
    file: Any,
    column: Column,
    kind: DTypeLike,
    place: int,
    scales: Mapping[str, Any],
    count: int,
    sources: Sequence[tuple[Any, int, int]],
) -> None:
    shape = count, *column.shape
    if count:
        data = _virtual(file, column.name, shape, kind, slice(place, place + prod(column.shape)), sources)
    else:
        data = file.create_dataset(column.name, shape, kind)
    for i, name in enumerate(("time", *column.dimensions)):
        data.dims[i].attach_scale(scales[name])
    data.attrs["units"] = column.unit
    data.attrs["long_name"] = column.meaning
    if column.name in LOGICAL:
        data.attrs["dtype"] = "bool"  # as xarray marks it


def _virtual(
    file: Any, name: str, shape: tuple[int, ...], kind: DTypeLike, where: slice, sources: Sequence[tuple[Any, int, int]]
) -> Any:
    whole = h5py.VirtualLayout(shape, kind)
    first = 0
    for data, lead, count in sources:
        source = h5py.VirtualSource(data)
        part = source[:, where] if len(data.shape) == 2 else source[:, lead:, where]
        whole[first : first + count] = part
        first += count
    return file.create_virtual_dataset(name, whole)


def _list_pieces(file: Any, pieces: Sequence[Piece], wide: int) -> None:
    """Write where the blocks are and what their checks are, for readers of ours."""
    kind = [("first", "<i8"), ("count", "<i8"), ("offset", "<i8"), ("lead", "<i8"), ("check", "V16")]
    table = np.array([tuple(vars(piece).values()) for piece in pieces], kind)
    file.create_dataset(PIECES, data=table).attrs["wide"] = wide


# Room for rows ------------------------------------------------------------------------------------------------------


class Room(NamedTuple):
    """A data set whose bytes HDF5 lays out, and never writes: its name, shape and type, and where it is to begin."""

    name: str
    shape: tuple[int, ...]
    kind: DTypeLike
    start: int


def _rooms_of(journal: Journal) -> tuple[list[Room], list[tuple[str, int, int]]]:
    """List what a part consists of, in order: its header, blocks of rows of one size, a shorter one, and the outcome.

    Returns:
        The rooms; and those of rows, each with how many rows of a block are none, and how many are in all.
    """
    pieces, row = journal.pieces, NUMBER.itemsize * journal.wide
    lead, each = journal.lead // row, pieces[0].count
    full = sum(piece.count == each for piece in pieces)
    rooms = [
        Room("rows/header", (journal.start,), np.uint8, 0),
        Room(BLOCKS, (full, lead + each, journal.wide), NUMBER, journal.start),
    ]
    sources = [(BLOCKS, lead, full * each)]
    if full < len(pieces):
        rooms.append(Room(REST, (1, lead + pieces[-1].count, journal.wide), NUMBER, pieces[-1].offset))
        sources.append((REST, lead, pieces[-1].count))
    size = journal.end - journal.outcome_start
    return [*rooms, Room("rows/outcome", (size,), np.uint8, journal.outcome_start)], sources


def _lay_out(file: Any, rooms: Sequence[Room]) -> None:
    """Make rooms one behind the other.

    HDF5 takes the place for what it says of a data set when that is made, and the place for its bytes when the first of
    them is written: so all are made, and then one number is written into each.

    Raises:
        Misplaced: one is not where it was to be.
    """
    for room in rooms:
        properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        properties.set_layout(h5py.h5d.CONTIGUOUS)
        properties.set_alloc_time(h5py.h5d.ALLOC_TIME_LATE)
        properties.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
        file.require_group("rows")
        space, kind = h5py.h5s.create_simple(room.shape), h5py.h5t.py_create(np.dtype(room.kind), logical=True)
        h5py.h5d.create(file.id, room.name.encode(), kind, space, properties)
    for room in rooms:
        data = file[room.name]
        data[(0,) * len(room.shape)] = 0
        if data.id.get_offset() != room.start:
            raise Misplaced


@cache
def _front(names: tuple[str, ...]) -> int:
    """Find where the first of these rooms begins: HDF5 takes the bytes before for itself."""
    with h5py.File(BytesIO(), "w", libver="latest") as file:
        with suppress(Misplaced):
            _lay_out(file, [Room(name, (1 << 16,), np.uint8, -1) for name in names])
        return int(file[names[0]].id.get_offset())


def _room(file: Any, name: str, shape: tuple[int, ...]) -> int:
    """Make a data set of numbers that are not written yet; return where they begin."""
    properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    properties.set_layout(h5py.h5d.CONTIGUOUS)
    properties.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    properties.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    file.require_group("rows")
    space, kind = h5py.h5s.create_simple(shape), h5py.h5t.py_create(NUMBER, logical=True)
    return int(h5py.h5d.create(file.id, name.encode(), kind, space, properties).get_offset())


def _pack(file: Any, blocks: Iterable[FloatArray], count: int, wide: int, compression: str) -> None:
    chunk = max(1, min(count, (1 << 18) // (NUMBER.itemsize * max(wide, 1))))
    data = file.create_dataset(
        ROWS, (count, wide), NUMBER, chunks=(chunk, wide), compression=compression, shuffle=True, fletcher32=True
    )
    first, rest = 0, np.empty((0, wide))
    for block in blocks:
        rest = np.concatenate([rest, block]) if len(rest) else block
        whole = len(rest) // chunk * chunk
        if whole:
            data[first : first + whole] = rest[:whole]
        first, rest = first + whole, rest[whole:]
    if len(rest):
        data[first:] = rest
