"""Recording of a run: its data, summary, figures and files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol, Self

import numpy as np

from graspfx.card import Card, Carded, counted, listed
from graspfx.errors import InputError, closest
from graspfx.recording.files import NAME
from graspfx.recording.history import History

if TYPE_CHECKING:
    import pandas
    import xarray

MEANT = {  # similar names, and the attributes that they mean
    **dict.fromkeys(("force", "forces", "f", "contact_force", "contact_forces"), "finger_force"),
    **dict.fromkeys(("position", "positions", "p", "x", "finger_positions", "tip", "tips"), "finger_position"),
    **dict.fromkeys(("velocity", "velocities", "v", "finger_velocities"), "finger_velocity"),
    **dict.fromkeys(("contacts", "contact", "contact_points"), "contact_position"),
    **dict.fromkeys(("times", "t", "timestamps"), "time"),
    **dict.fromkeys(("data", "values", "array"), "rows"),
    **dict.fromkeys(("normals", "normal"), "contact_normal"),
    **dict.fromkeys(("depth", "penetration", "gaps", "distance"), "gap"),
    **dict.fromkeys(("internal", "squeeze", "internal_forces"), "internal_force"),
    **dict.fromkeys(("external", "external_forces"), "external_force"),
    **dict.fromkeys(("fault", "errors"), "faults"),
    **dict.fromkeys(("object", "body", "pose"), "objects[name]"),
    **dict.fromkeys(("orientation", "wrench", "angular_velocity"), "objects[name].{}"),
    **dict.fromkeys(("dt", "period", "T"), "header.period"),
    "dataframe": "to_frame()",
    "df": "to_frame()",
    "csv": "to_csv(path)",
    "show": "plot()",
    "draw": "plot()",
}

MOST = 3  # largest number of faults or changes on a card
CALLS = (
    ".summary(), .plot(), .picture(time), .to_xarray(), .to_frame(), .to_csv(path), .save(path)\n"
    ".time, .finger_position, .finger_force, .internal_force, .external_force, .touching, .objects[name], ..."
)


class Drawing(Protocol):
    """Figure of a recording; notebooks show it, and `save` writes it.

    Attributes:
        notes: Parts that could not be drawn, with reasons.
    """

    notes: tuple[str, ...]

    @property
    def figure(self) -> Any:
        """The matplotlib figure."""

    def save(self, path: str | PathLike[str], form: str = "", dpi: int = 0) -> Path:
        """Write the figure in the format of the path's suffix, or of `form`: "png", "svg" or "pdf"."""


class Recording(Carded, History):
    """Data of a run tick by tick: row k of each array belongs to the time k T (k m T with one row every m ticks).

    A row contains the readings of its tick and the quantities computed from them.

    Args:
        rows: Rows (N, width), read-only afterwards; or a store from which they are read on demand.
        layout: Columns of the rows.
        header: Facts known before the run.
        outcome: Facts known after the run.
        start: Number of the first row, if the recording is a part of another recording.
    """

    def __new__(cls, rows: object = None, *args: object, **kwargs: object) -> Self:
        """Refuse paths, which `load` reads."""
        if rows is None or isinstance(rows, str | PathLike):
            remedy = "gx.Recording.load(path) reads a file, gx.run(scene) makes a recording"
            raise InputError("Recording", rows, "the rows of a run", remedy)
        return super().__new__(cls)

    if not TYPE_CHECKING:  # a visible __getattr__ would hide misspelt names from the type checker

        def __getattr__(self, name: str) -> Any:
            if name.startswith("_") or hasattr(type(self), name):
                return super().__getattribute__(name)  # raises the original error
            if name in self.layout.columns:
                return self.typed(name)
            names = [each for each in dir(self) if not each.startswith("_")]
            meant = MEANT.get(name, "").format(name) or closest(name, names)
            remedy = f"did you mean {meant}?" if meant else "dir(recording) lists its attributes"
            raise AttributeError(f"a recording has no {name!r}; {remedy}")

    def __reduce__(self) -> tuple[Callable[..., Recording], tuple[Any, ...]]:
        """Pickle or copy the recording as the bytes of a file; the copy has its rows in memory."""
        return from_bytes, (type(self), to_bytes(self.save), self.start)

    def _card(self) -> Card:
        header = self.header
        name = f"{header.scene or 'a scene'}{f': {header.title}' if header.title else ''}"
        return Card(f"Recording of {name}", [*_card_rows(self)], CALLS)

    def summary(self) -> dict[str, Any]:
        """Return a summary of the run in SI units, with the keys of `graspfx.recording.summary.summarise`."""
        from graspfx.recording.growth import losses
        from graspfx.recording.summary import summarise

        needs = {"finger_position", "contact_position", "touching", "true_position"}
        needs |= {f"objects/{name}/position" for name in self.layout.objects}
        is_seen = needs.isdisjoint(self.layout.omitted)
        return summarise(self, losses(self) if is_seen else [])

    def plot(
        self,
        *others: Recording,
        titles: Sequence[str] | None = None,
        width: Literal["screen", "page", "column"] = "screen",
    ) -> Drawing:
        """Plot the run over time, side by side with other recordings on the same axes.

        The figure shows positions, displacements and forces with their internal part (squeeze) and external part
        (push), and the rotation of the object. docs/how-to/figures.md explains the figure.

        Args:
            others: Recordings to plot beside this one.
            titles: Title of each recording; by default the overrides of each.
            width: Figure's width: that of a screen, or 7.2 ("page") or 3.5 ("column") inches for a journal.

        Returns:
            Drawing, which notebooks show; `.save(path)` writes it, `.figure` is the matplotlib figure.

        Raises:
            InputError: A recording has no ticks, the number of titles is wrong, or the width is unknown.
        """
        from graspfx.show.run_figures import sheet
        from graspfx.show.style import Drawing

        return Drawing(sheet([self, *others], titles, width=width))

    def picture(
        self,
        time: float | None = None,
        *,
        view: tuple[float, float] | None = None,
        forces: Literal["two", "total"] = "two",
        width: Literal["screen", "page", "column"] = "screen",
    ) -> Drawing:
        """Draw one instant of the run to scale, with forces as arrows.

        Args:
            time: Time [s]; by default the instant with most fingers in contact and the largest forces, or the end.
            view: Azimuth and elevation of the camera [degrees] for scenes in space; by default a view of the fingers.
            forces: Internal and external part of each force ("two"), or their sum ("total").
            width: Figure's width: that of a screen, or 7.2 ("page") or 3.5 ("column") inches for a journal.

        Returns:
            Drawing, which notebooks show; `.save(path)` writes it, `.figure` is the matplotlib figure, and `.notes`
            lists the parts that could not be drawn.

        Raises:
            InputError: The recording has no ticks, the time is outside of the recording, the view is not two numbers,
                or `forces` or `width` is not one of the values above.
        """
        from graspfx.show.picture.portrait import portrait

        return portrait(self, time, view=view, forces=forces, width=width)

    def save(
        self,
        path: str | PathLike[str],
        *,
        overwrite: bool = False,
        compression: Literal["none", "lzf", "gzip"] = "none",
    ) -> None:
        """Write the recording as HDF5; the file appears when it is complete.

        Args:
            path: Path of the file.
            overwrite: Whether to replace an existing file.
            compression: Compression of the rows: "lzf" is faster, "gzip" gives smaller files.

        Raises:
            InputError: The compression is unknown.
            RecordingError: The file exists or cannot be written.
        """
        from graspfx.recording.sink import save

        if compression not in ("none", "lzf", "gzip"):
            raise InputError("compression", compression, '"none", "lzf" or "gzip"')
        save(
            path, self.store, self.layout, self.header, self.outcome, overwrite=overwrite, compression=compression
        )  # fmt: skip

    def to_xarray(self) -> xarray.Dataset:
        """Convert to an xarray Dataset with dimensions time, finger, axis, ..., and `units` and `long_name`.

        Columns have the names, dimensions and attributes of the file. Columns of objects are combined, as in
        `object_position` with a dimension `object`; derived variables such as `displayed_force` are included. The
        attributes are those of the file: scene text, overrides, versions and outcome.

        Raises:
            MissingPackageError: xarray is not installed: `pip install 'graspfx[data]'`.
        """
        from graspfx.show.conversions import recording_dataset

        return recording_dataset(self)

    def to_frame(self) -> pandas.DataFrame:
        """Convert to a pandas DataFrame with one row per recorded tick, and one column per component.

        Columns have names such as `finger_force.thumb.x`. The index is the time [s]. `frame.attrs["units"]` has the SI
        units by quantity.

        Raises:
            MissingPackageError: pandas is not installed: `pip install 'graspfx[data]'`.
        """
        from graspfx.show.conversions import recording_frame

        return recording_frame(self)

    def to_csv(self, path: str | PathLike[str], *, overwrite: bool = False) -> None:
        """Write the columns of `to_frame`, with the time first, as comma-separated text; no package is needed.

        The first line contains the names of the columns. Numbers are in SI units and read back to the last bit; true is
        1, false is 0.

        Args:
            path: Path of the file; the file appears when it is complete.
            overwrite: Whether to replace an existing file.

        Raises:
            RecordingError: The file exists or cannot be written.
        """
        from graspfx.show.conversions import write_csv

        write_csv(self, path, overwrite=overwrite)

    def to_html(self, path: str | PathLike[str], *, overwrite: bool = False) -> Path:
        """Write a page that plays the run in a browser: objects, fingers, forces as arrows, and charts.

        The page is one file and needs no network. It shows at most 60 frames per second, with numbers rounded to
        24 bits; the charts show the minimum and maximum over all ticks.

        Args:
            path: Path of the file, which ends in .html; the file appears when it is complete.
            overwrite: Whether to replace an existing file.

        Raises:
            InputError: The recording has no ticks, or the path does not end in .html.
            RecordingError: The file exists or cannot be written.
        """
        from graspfx.live.page.document import write_page

        return write_page(self, path, overwrite=overwrite)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Recording:
        """Load a recording from a file.

        The recording of a run that is active or was killed is loaded as far as it was written.

        Args:
            path: Path of the file, or of the folder with recording.h5. If there is only recording.h5.part, which a run
                writes until it ends, that file is read; its outcome is not `complete`.

        Raises:
            RecordingError: The file has no recording, or its bytes were changed after it was written.
        """
        from graspfx.recording.file import read

        return cls(*read(path))


def _card_rows(recording: Recording) -> Iterator[tuple[str, str]]:
    header, layout, outcome, ticks = recording.header, recording.layout, recording.outcome, len(recording)
    engine = f", {outcome.engine}" if outcome.engine else ""
    broken = "" if outcome.complete else "; NOT complete: the run was interrupted, is active or was killed"
    seconds = f"{recording.end:g} s"
    fewer = f", one row per {header.every} ticks" if header.every > 1 else ""
    yield (
        "time",
        f"{seconds}, {counted(recording.ticks, 'tick')} of {1e3 * recording.period:g} ms{fewer}{engine}{broken}",
    )
    yield "left out", listed(layout.omitted)
    yield "set", listed(f"{key} = {value!r}" for key, value in header.overrides.items())
    devices = "simulated" if layout.simulated else "real"
    space = counted(layout.dimensions, "dimension")
    yield "fingers", f"{len(layout.fingers)} in {space}, {devices}: {listed(layout.fingers)}"
    if ticks and not {"touching", "finger_force"} & set(layout.omitted):
        touching = 100.0 * recording.touching.mean(axis=0)
        yield "touching", listed(f"{each:.0f} %" for each in touching) + " of the time"
        peak = np.linalg.norm(recording.finger_force, axis=2).max(axis=0)
        yield "peak force", listed(f"{each:.3g}" for each in peak) + " N"
    yield "objects", listed(layout.objects)
    yield "energies", "booked by mode: .energy[name]" if layout.observed else ""
    yield "changes", _some(recording.changes)
    yield "faults", _some(recording.faults) or "none"
    yield "made", " by ".join(each for each in (header.created, _maker(header.versions)) if each)


def _maker(versions: Any) -> str:
    return f"GraspFX {versions['graspfx']}" if "graspfx" in versions else ""


def _some(things: Any) -> str:
    lines = [str(each) for each in things[:MOST]]
    return "\n".join([*lines, *([f"and {len(things) - MOST} more"] if len(things) > MOST else [])])


# Transfer between processes: as the bytes of a file, with its checksums ---------------------------------------------


def to_bytes(save: Callable[[Path], object]) -> bytes:
    """Return the bytes of the file that `save` writes."""
    with TemporaryDirectory(prefix="graspfx-") as folder:
        place = Path(folder) / NAME
        save(place)
        return place.read_bytes()


def from_bytes(kind: type[Recording], content: bytes, start: int = 0) -> Recording:
    """Create a recording in memory from the bytes of a file; `start` is the number of its first row in a whole run.

    Raises:
        RecordingError: If the bytes were changed since they were written.
    """
    from graspfx.recording.file import read

    with TemporaryDirectory(prefix="graspfx-") as folder:
        place = Path(folder) / NAME
        place.write_bytes(content)
        rows, layout, header, outcome = read(place)
        return kind(rows.read(0, len(rows), slice(0, layout.width)), layout, header, outcome, start=start)


# Comparison with another recording, column by column and bit by bit ------------------------------------------------


class Difference(NamedTuple):
    """A column in which two recordings differ.

    Attributes:
        column: Name of the column.
        largest: Largest difference; infinite if only one of two values is NaN.
        tick: First tick in which they differ.
        unit: Unit of the column.
    """

    column: str
    largest: float
    tick: int
    unit: str

    def __str__(self) -> str:
        return f"{self.column}: up to {self.largest:.3g} {self.unit}, from tick {self.tick} on"


def compared(one: Recording, other: Recording) -> list[str]:
    """List the columns that two recordings share, except those that a real-time loop fills, such as times of ticks."""
    columns = [name for name in one.layout.columns if name in other.layout.columns]
    return [name for name in columns if one.layout.columns[name].filled != "loop"]


def differences(one: Recording, other: Recording) -> list[Difference]:
    """Compare the columns of two recordings with equal numbers of rows, except those that a real-time loop fills.

    Values are compared by their bits: zeros of different sign differ, and NaN differs from numbers.
    """
    each = (_difference(one, other, name) for name in compared(one, other))
    return [difference for difference in each if difference is not None]


def _difference(one: Recording, other: Recording, name: str) -> Difference | None:
    first, largest = -1, 0.0
    for start in range(0, len(one), one.store.step):
        stop = min(start + one.store.step, len(one))
        a, b = (np.ascontiguousarray(each.read(name, start, stop)) for each in (one, other))
        differ = a.view(np.int64) != b.view(np.int64)
        if differ.any():
            rows = differ.reshape(len(a), -1).any(axis=1)
            if first < 0:
                first = (start + int(np.flatnonzero(rows)[0])) * one.header.every
            with np.errstate(invalid="ignore"):
                gaps = np.abs(a[differ] - b[differ])
            largest = max(largest, float(np.where(np.isnan(gaps), np.inf, gaps).max()))
    return None if first < 0 else Difference(name, largest, first, one.layout.columns[name].unit)
