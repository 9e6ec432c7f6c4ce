"""Recordings as HDF5: one writer for live runs and saved ones, and the reader."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from os import PathLike
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError, RecordingError
from graspfx.loop.header import Header, Outcome, RunFault
from graspfx.loop.layout import WRENCH, Column, Layout

FloatArray = NDArray[np.float64]

NAME = "recording.h5"  # of the file in a run's folder
FORMAT = "graspfx recording 1"
CHUNK = 1024  # rows
ENGINE = 64  # bytes of what ran the ticks
LONGEST = 512  # bytes of a fault's message: of fixed length, as single-writer files want it
SUPERBLOCK, VERSION, FLAGS, END = 48, 8, 11, slice(28, 36)  # HDF5 File Format Specification 3.0, II.A
# what HDF5, JSON and the making of a layout from it raise where bytes have gone bad, or something else was put there
UNREADABLE = (OSError, RuntimeError, LookupError, ValueError, TypeError, AttributeError, OverflowError, MemoryError)
WHOLE = ("touching", "saturated", "status", "law")  # columns of whole numbers
SCALES = {
    "axis": ("x", "y", "z"),
    "turn": ("x", "y", "z"),
    "quaternion": ("x", "y", "z", "w"),
    "mode": ("internal", "translation", "rotation"),
}


def make_folder(path: str | PathLike[str]) -> Path:
    """A folder for files of a run, made if it is not there.

    Raises:
        RecordingError: it cannot be.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        why = "a file is in its way" if isinstance(error, FileExistsError | NotADirectoryError) else error.strerror
        raise RecordingError(f"{folder}: no folder can be made there; {why}") from error
    return folder


class FileSink:
    """Writes blocks of rows as they come, so that what was written can be read after the run was killed.

    A variable per column of the layout, with dimension scales `time`, `finger`, `axis` and units as attributes; objects
    are groups of their own under `objects`. Times are ticks x period.

    Args:
        path: of the file, replaced if it exists.
        layout: the columns.
        header: stands in the file's attributes.

    Raises:
        RecordingError: the file cannot be written.
    """

    def __init__(self, path: str | PathLike[str], layout: Layout, header: Header) -> None:
        place = _path(path)
        self._layout, self._period, self._count = layout, header.period, 0
        try:
            self._file = h5py.File(place, "w", libver="latest")
        except OSError as error:
            raise RecordingError(f"{place}: cannot be written; {_line(error)}") from error
        self._file.attrs.update(_attributes(layout, header))
        scales = self._make_scales()
        self._columns = [(column, self._make(column, scales)) for column in layout.columns.values()]
        self._time = scales["time"]
        faults = self._file.create_group("faults")
        self._ticks = faults.create_dataset("tick", (0,), np.int64, maxshape=(None,), chunks=(64,))
        self._ticks.make_scale("tick")
        self._messages = faults.create_dataset("message", (0,), f"S{LONGEST}", maxshape=(None,), chunks=(64,))
        self._messages.dims[0].attach_scale(self._ticks)
        self._file.swmr_mode = True  # from here on nothing is created, only extended

    def write(self, rows: FloatArray, faults: Sequence[RunFault]) -> None:
        """Adds rows (r, width) and faults, and sees them on their way to the disk.

        Raises:
            RecordingError: the disk takes no more.
        """
        try:
            self._extend(rows, faults)
        except OSError as error:
            raise RecordingError(f"{self._file.filename}: cannot be written; {_line(error)}") from error

    def _extend(self, rows: FloatArray, faults: Sequence[RunFault]) -> None:
        first, last = self._count, self._count + len(rows)
        for column, data in self._columns:
            data.resize(last, axis=0)
            data[first:last] = rows[:, column.where].reshape(len(rows), *column.shape)
        known = len(self._ticks)
        self._ticks.resize(known + len(faults), axis=0)
        self._messages.resize(known + len(faults), axis=0)
        for i, fault in enumerate(faults):
            self._ticks[known + i] = fault.tick
            self._messages[known + i] = fault.message.encode()[:LONGEST]
        self._file.flush()
        self._time.resize(last, axis=0)  # last: a reader takes as many rows as there are times
        self._time[first:last] = np.arange(first, last) * self._period
        self._file.flush()
        self._count = last

    def close(self, outcome: Outcome) -> None:
        """Notes how the run went, and closes the file.

        Raises:
            RecordingError: the disk takes no more.
        """
        wall_time = np.nan if outcome.wall_time is None else outcome.wall_time
        name = self._file.filename
        try:
            self._file.attrs.modify("wall_time", np.float64(wall_time))
            self._file.attrs.modify("complete", np.int8(outcome.complete))
            self._file.attrs.modify("engine", _fixed(outcome.engine))
            self._file.attrs.modify("fade_shortfall", np.float64(outcome.fade_shortfall))
            self._file.attrs.modify("fade_needed", np.float64(outcome.fade_needed))
            self._file.attrs.modify("blended", np.int64(outcome.blended))
            self._file.close()
        except (OSError, RuntimeError) as error:
            with suppress(OSError, RuntimeError):
                self._file.close()
            raise RecordingError(f"{name}: cannot be written; {_line(error)}") from error

    def _make_scales(self) -> dict[str, Any]:
        layout, d = self._layout, self._layout.dimensions
        names: dict[str, Sequence[str]] = {"finger": layout.fingers, **SCALES, "component": WRENCH[d]}
        names["axis"] = SCALES["axis"][:d]
        used = {name for column in layout.columns.values() for name in column.dimensions}
        time = self._file.create_dataset("time", (0,), np.float64, maxshape=(None,), chunks=(CHUNK,))
        time.attrs["units"] = "s"
        scales = {"time": time}
        for name in names:
            if name in used:
                scales[name] = self._file.create_dataset(name, data=list(names[name]), dtype=h5py.string_dtype())
        for name, scale in scales.items():
            scale.make_scale(name)
        return scales

    def _make(self, column: Column, scales: Mapping[str, Any]) -> Any:
        kind = np.int8 if column.name.rpartition("/")[2] in WHOLE else np.float64
        shape = column.shape
        data = self._file.create_dataset(
            column.name, (0, *shape), kind, maxshape=(None, *shape), chunks=(CHUNK, *shape)
        )
        for i, name in enumerate(("time", *column.dimensions)):
            data.dims[i].attach_scale(scales[name])
        data.attrs["units"] = column.unit
        data.attrs["long_name"] = column.meaning
        if column.name in ("touching", "saturated"):
            data.attrs["dtype"] = "bool"  # as xarray marks it
        return data


def read(path: str | PathLike[str]) -> tuple[FloatArray, Layout, Header, Outcome]:
    """Rows, layout, header and outcome of a recording; of a run that was killed, as far as it was written.

    Args:
        path: of the file, or of the folder in which it is recording.h5.

    Raises:
        RecordingError: there is no such file, or no recording in it.
    """
    place = recording_file(path)
    if not place.is_file():
        raise RecordingError(f"{place}: there is no such file")
    try:
        with _opened(place) as file:
            if file.attrs.get("format") != FORMAT:
                raise RecordingError(f"{place}: not a GraspFX recording, or one of another version")
            layout = _layout(file)
            return _rows(file, layout), layout, _header(file), _outcome(file)
    except UNREADABLE as error:
        raise RecordingError(f"{place}: cannot be read as a recording; {_line(error)}") from error


def recording_file(path: str | PathLike[str]) -> Path:
    """The file itself, or recording.h5 in a folder."""
    place = _path(path)
    return place / NAME if place.is_dir() else place


def _path(given: str | PathLike[str]) -> Path:
    if not isinstance(given, str | PathLike):
        raise InputError("recording", given, "the path of a file or of its folder")
    return Path(given)


def _opened(place: Path) -> Any:
    """The file as it is; one still marked open, by a run that goes on or was killed, as its single writer left it."""
    try:
        return h5py.File(place, "r")
    except OSError:
        if not _left_open(place):
            raise
        return h5py.File(place, "r", libver="latest", swmr=True)


def _left_open(place: Path) -> bool:
    """Whether a writer has the file open, or never closed it, and nothing of it was cut off since.

    From the HDF5 superblock, version 3. On a file that was cut short, a reader beside a writer waits for ever for what
    is missing: such a file must not get there.
    """
    with place.open("rb") as file:
        head = file.read(SUPERBLOCK)
    if len(head) < SUPERBLOCK or head[VERSION] != 3 or not head[FLAGS]:
        return False
    return place.stat().st_size >= int.from_bytes(head[END], "little")


def _attributes(layout: Layout, header: Header) -> dict[str, Any]:
    attributes: dict[str, Any] = {"format": FORMAT}
    for key, value in asdict(header).items():
        attributes[key] = value if isinstance(value, str | float) else _json(value)
    attributes["layout"] = _json(asdict(layout))
    attributes["wall_time"] = np.float64(np.nan)
    attributes["complete"] = np.int8(0)
    attributes["engine"] = _fixed("")
    attributes["fade_shortfall"] = attributes["fade_needed"] = np.float64(0.0)
    attributes["blended"] = np.int64(0)
    return attributes


def _fixed(text: str) -> Any:
    """Text of a length that a file keeps: nothing new may be made in it while it is read."""
    return np.array(text.encode(), dtype=f"S{ENGINE}")


def _json(value: Any) -> str:
    return json.dumps(value, default=_plain)


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)


def _layout(file: Any) -> Layout:
    described: dict[str, Any] = json.loads(file.attrs["layout"])
    for key in ("fingers", "objects", "finger_objects"):
        described[key] = tuple(described[key])
    return Layout(**described)


def _header(file: Any) -> Header:
    given: dict[str, Any] = {key: file.attrs[key] for key in Header.__dataclass_fields__ if key in file.attrs}
    for key in ("scene_table", "overrides", "versions", "machine", "frames"):
        given[key] = json.loads(given.get(key, "{}"))  # frames came later than the format
    given["period"] = float(given["period"])
    if not 0.0 < given["period"] < math.inf:
        raise ValueError(f"a period of {given['period']} s")
    return Header(**given)


def _outcome(file: Any) -> Outcome:
    wall_time = float(file.attrs["wall_time"])
    ticks, messages = file["faults/tick"][:], file["faults/message"][:]
    return Outcome(
        faults=tuple(
            RunFault(int(tick), text.decode(errors="ignore")) for tick, text in zip(ticks, messages, strict=False)
        ),
        wall_time=None if np.isnan(wall_time) else wall_time,
        complete=bool(int(file.attrs["complete"])),
        engine=bytes(file.attrs.get("engine", b"")).decode(),  # came later than the format
        fade_shortfall=float(file.attrs["fade_shortfall"]),
        fade_needed=float(file.attrs.get("fade_needed", 0.0)),
        blended=int(file.attrs.get("blended", 0)),
    )


def _rows(file: Any, layout: Layout) -> FloatArray:
    count = len(file["time"])
    rows = np.empty((count, layout.width))
    for column in layout.columns.values():
        rows[:, column.where] = file[column.name][:count].reshape(count, math.prod(column.shape))
    return rows


def _line(error: Exception) -> str:
    """What HDF5 says, on one line."""
    return " ".join(str(error).split())
