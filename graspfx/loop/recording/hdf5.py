"""Recordings as HDF5, written whole beside their place and moved there: what a reader finds is never half a file."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import DTypeLike, NDArray

from graspfx.loop.recording.attributes import conclusion, description
from graspfx.loop.recording.header import Header, Outcome, RunFault
from graspfx.loop.recording.layout import Column, Layout
from graspfx.loop.recording.places import sync_folder
from graspfx.loop.recording.scales import LOGICAL, scales_of, stored_type
from graspfx.loop.recording.seal import seal
from graspfx.loop.recording.stream import Stream
from graspfx.loop.recording.two_parts import RowSplit, splits_of

FloatArray = NDArray[np.float64]

CHUNK = 1024  # rows


def write_hdf5(
    place: Path, blocks: Iterable[FloatArray], count: int, layout: Layout, header: Header, outcome: Outcome
) -> None:
    """Write `count` rows, in blocks (r, width), and all that is known of them; a file that is there is replaced.

    A variable per column of the layout, with dimension scales `time`, `finger`, `axis` and units as attributes; objects
    are groups of their own under `objects`. Times are ticks x period. Each chunk has a checksum, and the file a digest.
    The two forces are variables too, for other programs: a reader of ours computes them again, to the same bits.

    An exception that a signal raises must no more reach HDF5 than a failing write: `hold_signals` is to keep it away.

    Raises:
        OSError: the disk does not take it; nothing has changed then.
    """
    draft = place.with_name(place.name + ".tmp")
    stream = Stream(draft)
    try:
        with h5py.File(stream, "w", driver="fileobj", libver="latest") as file:
            for name, value in (description(layout, header) | conclusion(outcome)).items():
                file.attrs[name] = value
            _write_faults(file, outcome.faults)
            scales = _scales(file, layout, count)
            columns = _columns(file, scales, layout.columns.values(), count)
            splits = splits_of(header, outcome.changes) if header.split else []
            forces = _columns(file, scales, layout.forces, count) if splits else []
            time, first = file["time"], 0
            for rows in _pieces(blocks, layout.width):
                last = first + len(rows)
                time[first:last] = np.arange(first, last) * header.every * header.period
                for column, data in columns:
                    data[first:last] = rows[:, column.where].reshape(len(rows), *column.shape)
                parts = RowSplit(rows, layout, splits, first).forces() if forces else {}
                for column, data in forces:
                    data[first:last] = parts[column.name]
                first = last
                stream.require()
        size = stream.seek(0, os.SEEK_END)
        stream.seek(0)
        line = seal(stream, size)
        stream.write(line)
        stream.finish()
        stream.close()
        draft.replace(place)
        sync_folder(place.parent)
    finally:
        stream.close()
        with suppress(OSError):
            draft.unlink(missing_ok=True)


def _pieces(blocks: Iterable[FloatArray], width: int) -> Iterator[FloatArray]:
    """Cut rows into pieces of whole chunks, so that each chunk is written once."""
    rest = np.empty((0, width))
    for block in blocks:
        rest = np.concatenate([rest, block]) if len(rest) else block
        whole = len(rest) // CHUNK * CHUNK
        for first in range(0, whole, CHUNK):
            yield rest[first : first + CHUNK]
        rest = rest[whole:]
    if len(rest):
        yield rest


def _write_faults(file: Any, faults: Sequence[RunFault]) -> None:
    group = file.create_group("faults")
    messages = [fault.message.encode() for fault in faults]
    ticks = group.create_dataset("tick", data=np.array([fault.tick for fault in faults], np.int64))
    ticks.make_scale("tick")
    longest = max([1, *map(len, messages)])
    texts = group.create_dataset("message", data=np.array(messages, f"S{longest}"))
    texts.dims[0].attach_scale(ticks)


def _columns(file: Any, scales: Mapping[str, Any], columns: Iterable[Column], count: int) -> list[tuple[Column, Any]]:
    return [(column, _column(file, column, scales, count)) for column in columns]


def _scales(file: Any, layout: Layout, count: int) -> dict[str, Any]:
    time = _rows(file, "time", (), np.float64, count)
    time.attrs["units"] = "s"
    scales = {"time": time}
    for name, entries in scales_of(layout).items():
        scales[name] = file.create_dataset(name, data=list(entries), dtype=h5py.string_dtype())
    for name, scale in scales.items():
        scale.make_scale(name)
    return scales


def _column(file: Any, column: Column, scales: Mapping[str, Any], count: int) -> Any:
    data = _rows(file, column.name, column.shape, stored_type(column.name), count)
    for i, name in enumerate(("time", *column.dimensions)):
        data.dims[i].attach_scale(scales[name])
    data.attrs["units"] = column.unit
    data.attrs["long_name"] = column.meaning
    if column.name in LOGICAL:
        data.attrs["dtype"] = "bool"  # as xarray marks it
    return data


def _rows(file: Any, name: str, shape: tuple[int, ...], kind: DTypeLike, count: int) -> Any:
    chunk = max(1, min(count, CHUNK))
    return file.create_dataset(
        name, (count, *shape), kind, maxshape=(None, *shape), chunks=(chunk, *shape), fletcher32=True
    )
