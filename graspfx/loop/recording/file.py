"""The reader of recordings: HDF5 of every format there was, and the part of a run that goes on or was killed."""

from __future__ import annotations

import math
from dataclasses import replace
from io import FileIO
from os import PathLike
from pathlib import Path
from typing import Any
from weakref import finalize

import h5py

from graspfx.errors import RecordingError
from graspfx.loop.recording.checks import has_digest
from graspfx.loop.recording.header import Header, Outcome, RunFault, format_of, header_of, layout_of, outcome_of
from graspfx.loop.recording.layout import Layout
from graspfx.loop.recording.part import Content, is_part_file, read_part
from graspfx.loop.recording.places import recording_file
from graspfx.loop.recording.rows import BLOCK, BlockRows, DataSetRows, Piece, RowStore, opened

SEALS = 2  # the first format whose files end in a digest
BLOCKS = 4  # the only one with its rows in blocks, over which the variables are virtual data sets
CACHE = 1 << 20  # bytes of chunks that a data set keeps in memory
MOST_PACKED = 1032  # bytes that deflate makes of one at most, https://zlib.net/zlib_tech.html
ROWS, PIECES = "rows/rows", "rows/pieces"
SUPERBLOCK, VERSION, FLAGS, END = 48, 8, 11, slice(28, 36)  # HDF5 File Format Specification 3.0, II.A
# what HDF5, JSON and the making of a layout from it raise where bytes have gone bad, or something else was put there
UNREADABLE = (OSError, RuntimeError, LookupError, ValueError, TypeError, AttributeError, OverflowError, MemoryError)


def read(path: str | PathLike[str]) -> tuple[RowStore, Layout, Header, Outcome]:
    """Open rows, read layout, header and outcome of a recording; of a run that was killed, as far as it was written.

    Args:
        path: of the file, of its part, or of the folder in which it is recording.h5; a part is read where there is no
            recording beside it.

    Raises:
        RecordingError: there is no such file, no recording in it, or its bytes were changed.
    """
    place = recording_file(path)
    if not place.is_file():
        raise RecordingError(f"{place}: there is no such file")
    if place.suffix == ".toml":
        raise RecordingError(f"{place}: is a scene, not a recording: run it first")
    try:
        return read_part(place) if is_part_file(place) else _read_hdf5(place)
    except UNREADABLE as error:
        raise RecordingError(f"{place}: cannot be read as a recording; {_line(error)}") from error


def _read_hdf5(place: Path) -> Content:
    whole = has_digest(place)  # before HDF5 looks at bytes that may have been changed
    stream = FileIO(place)  # HDF5 takes a path that it has open already for the same file, whatever it is by now
    file = None
    try:
        file = _open(place, stream)
        require_contained(file, place)
        number = format_of(file.attrs)
        if number >= SEALS and not whole:
            raise ValueError("it was changed since it was written: its digest is gone")
        layout = _drop_columns(layout_of(file.attrs), file, number)
        header, outcome = header_of(file.attrs), _outcome(file)
        _require_variables(file, layout, number)
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
    """Require that all data of an open HDF5 file stand in it, and no more of them than it can hold.

    HDF5 reads bytes of other files where a data set has external storage, where a virtual one has another source than
    this file ("."), and behind external links; a recording has none of them, and whoever made one chose the files.

    Raises:
        ValueError: something stands elsewhere, or a data set is larger than a file of this size can hold.
    """
    room = MOST_PACKED * place.stat().st_size

    links: list[tuple[bytes, int]] = []
    file.id.links.visit(lambda name, link: links.append((name, link.type)), info=True)
    sources = set[str]()
    for name, kind in links:
        text = name.decode(errors="replace")
        if kind not in (h5py.h5l.TYPE_HARD, h5py.h5l.TYPE_SOFT):
            raise ValueError(f"{text} is a link to another file; nothing of that is read")
        if kind == h5py.h5l.TYPE_SOFT or h5py.h5o.get_info(file.id, name).type != h5py.h5o.TYPE_DATASET:
            continue
        data = h5py.h5d.open(file.id, name)
        storage = data.get_create_plist()
        if storage.get_external_count():
            raise ValueError(f"{text} stands in another file (external storage); nothing of that is read")
        if storage.get_layout() == h5py.h5d.VIRTUAL:
            maps = range(storage.get_virtual_count())
            if any(storage.get_virtual_filename(k) != "." for k in maps):
                raise ValueError(f"{text} stands in another file (a virtual data set); nothing of that is read")
            sources.update(storage.get_virtual_dsetname(k) for k in maps)
        elif math.prod(data.shape) * data.get_type().get_size() > room:
            raise ValueError(f"{text} claims to be {data.shape} of {data.dtype}, more than its file can hold")
    for source in sources:  # HDF5 ends the process where a virtual data set is one of itself
        if h5py.h5d.open(file.id, source.encode()).get_create_plist().get_layout() == h5py.h5d.VIRTUAL:
            raise ValueError(f"{source} is virtual, and so is what stands in it; nothing of that is read")


def _require_variables(file: Any, layout: Layout, number: int) -> None:
    """Require the time and a variable of numbers for each column of the layout, of as many ticks each.

    Raises:
        ValueError: one of another shape or kind.
        KeyError: there is none.
    """
    (count,) = file["time"].shape
    for column in layout.columns.values():
        variable = file[column.name]
        if variable.shape != (count, *column.shape) or variable.dtype.kind not in "biuf":
            kind = f"{variable.shape} of {variable.dtype}"
            raise ValueError(f"{column.name} is {kind}, expected numbers {(count, *column.shape)}")
    shape: tuple[int, ...] = count, layout.width
    if number == BLOCKS and PIECES in file:
        shape = int(file[PIECES]["count"].sum()), int(file[PIECES].attrs["wide"])
    elif number == BLOCKS and ROWS in file:
        shape = file[ROWS].shape
    if len(shape) != 2 or shape[0] != count or shape[1] < layout.width:
        raise ValueError(f"its rows are {shape}, expected {count} of {layout.width} numbers or more")


def _rows(place: Path, file: Any, layout: Layout, number: int) -> RowStore:
    """Open the rows: in blocks or packed together in format 4, else in the data sets of the variables."""
    (count,) = file["time"].shape
    if number == BLOCKS and PIECES in file:
        table = file[PIECES]
        pieces = [
            Piece(
                int(each["first"]), int(each["count"]), int(each["offset"]), int(each["lead"]), each["check"].tobytes()
            )
            for each in table[:]
        ]
        return BlockRows(place, opened(place), int(table.attrs["wide"]), pieces)
    data = [(column.where, file[column.name]) for column in layout.columns.values()]
    if number == BLOCKS and ROWS in file:
        data = [(slice(0, file[ROWS].shape[1]), file[ROWS])]
    step = next((each.chunks[0] for _, each in data if each.chunks), BLOCK // (8 * max(layout.width, 1)))
    return DataSetRows(place, data, count, max(1, step))


def _open(place: Path, stream: FileIO) -> Any:
    """Open the file; one of format 1 still marked open, by a run that was killed, as its single writer left it."""
    try:
        return h5py.File(stream, "r", driver="fileobj", rdcc_nbytes=CACHE)
    except OSError:
        if not _left_open(place):
            raise
        return h5py.File(place, "r", libver="latest", swmr=True, rdcc_nbytes=CACHE)


def _left_open(place: Path) -> bool:
    """Tell whether a writer has the file open, or never closed it, and nothing of it was cut off since.

    From the HDF5 superblock, version 3. On a file that was cut short, a reader beside a writer waits for ever for what
    is missing: such a file must not get there.
    """
    with place.open("rb") as file:
        head = file.read(SUPERBLOCK)
    if len(head) < SUPERBLOCK or head[VERSION] != 3 or not head[FLAGS]:
        return False
    return place.stat().st_size >= int.from_bytes(head[END], "little")


def _drop_columns(layout: Layout, file: Any, number: int) -> Layout:
    """Leave columns out of a layout that came later than the file's format."""
    if number >= 3:
        return layout
    absent = [name for name in layout.columns if name not in file and not layout.is_essential(name)]
    return replace(layout, absent=(*layout.absent, *absent)) if absent else layout


def _outcome(file: Any) -> Outcome:
    ticks, messages = file["faults/tick"][:], file["faults/message"][:]
    faults = [RunFault(int(tick), text.decode(errors="ignore")) for tick, text in zip(ticks, messages, strict=False)]
    return outcome_of(file.attrs, faults)


def _line(error: Exception) -> str:
    """Write HDF5's message on one line."""
    return " ".join(str(error).split())
