"""Recording of a run: data, summary, figures and files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol, Self

import numpy as np

from graspfx.card import Card, Carded, counted, listed, setting
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
    """Figure of a recording, which notebooks show and `save` writes.

    Attributes:
        notes: Parts that could not be drawn, with the reasons.
    """

    notes: tuple[str, ...]

    @property
    def figure(self) -> Any:
        """The matplotlib figure."""

    def save(self, path: str | PathLike[str], form: str = "", dpi: int = 0) -> Path:
        """Write the figure in the format of the path's suffix, or in the format `form`: "png", "svg" or "pdf"."""


class Recording(Carded, History):
    """Data of a run. Row k of each array belongs to tick k m, at time k m T, if one of m ticks is recorded.

    A row contains the readings of its tick and the quantities that the tick computed from them.

    Args:
        rows: Rows (N, width), which become read-only, or a store from which rows are read on demand.
        layout: Layout of the columns.
        header: Metadata that are known before the run.
        outcome: Metadata that are known after the run.
        start: Index of the first row in the complete recording, if this is a part.
    """

    def __new__(cls, rows: object = None, *args: object, **kwargs: object) -> Self:
        """Raise InputError for a path, because `load` reads files."""
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
        """Pickle or copy the recording as the bytes of a file; the rows of the copy are in memory."""
        return from_bytes, (type(self), to_bytes(self.save), self.start)

    def _card(self) -> Card:
        header = self.header
        name = f"{header.scene or 'a scene'}{f': {header.title}' if header.title else ''}"
        return Card(f"Recording of {name}", [*_card_rows(self)], CALLS)

    def summary(self) -> dict[str, Any]:
        """Return a summary of the run in SI units; `graspfx.recording.summary.summarise` describes its keys."""
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
        """Plot the run over time, beside other recordings on the same axes.

        The figure shows positions, displacements, forces and the rotation of the object. Displacements and forces are
        split into an internal part (squeeze) and an external part (push); see docs/how-to/figures.md.

        Args:
            others: Recordings to plot beside this one.
            titles: Title of each recording; by default the overrides of its scene.
            width: Width of the figure: "screen", or 7.2 ("page") or 3.5 ("column") inches for a journal.

        Returns:
            Figure, which notebooks show. `.save(path)` writes it, and `.figure` is the matplotlib figure.

        Raises:
            InputError: A recording has no rows, the number of titles is wrong, or the width is unknown.
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
            time: Time of the instant [s]. By default, the instant at which most fingers touch and, among these
                instants, the forces are largest; if no finger touches, the end of the run.
            view: Azimuth and elevation of the camera [degrees], for scenes in space; by default a view of the fingers.
            forces: "two" for the internal and external part of each force, "total" for their sum.
            width: Width of the figure: "screen", or 7.2 ("page") or 3.5 ("column") inches for a journal.

        Returns:
            Figure, which notebooks show. `.save(path)` writes it, `.figure` is the matplotlib figure, and `.notes`
            lists the parts that could not be drawn.

        Raises:
            InputError: The recording has no rows, the time is outside the recording, the view is not two numbers, or
                `forces` or `width` is not one of the values above.
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
        """Write the recording to an HDF5 file, which appears at its path when it is complete.

        Args:
            path: Path of the file.
            overwrite: Whether to replace an existing file.
            compression: Compression of the rows: "lzf" is faster, "gzip" gives smaller files; "none" is the default.

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
        """Convert to an xarray Dataset with dimensions such as `time`, `finger` and `axis`.

        Columns have the names, dimensions and attributes (such as `units` and `long_name`) that they have in a file. A
        column that each object has becomes one variable with a dimension `object`, such as `object_position`. Derived
        variables, such as `displayed_force`, are included. The attributes of the Dataset are those of a file: scene
        text, overrides, versions and outcome.

        Raises:
            MissingPackageError: xarray is not installed; `pip install 'graspfx[data]'` installs it.
        """
        from graspfx.show.conversions import recording_dataset

        return recording_dataset(self)

    def to_frame(self) -> pandas.DataFrame:
        """Convert to a pandas DataFrame with one row per recorded tick, and one column per component.

        Columns have names such as `finger_force.thumb.x`, and the index is the time [s]. `frame.attrs["units"]`
        contains the SI unit of each quantity.

        Raises:
            MissingPackageError: pandas is not installed; `pip install 'graspfx[data]'` installs it.
        """
        from graspfx.show.conversions import recording_frame

        return recording_frame(self)

    def to_csv(self, path: str | PathLike[str], *, overwrite: bool = False) -> None:
        """Write the time and the columns of `to_frame` as comma-separated text; no additional package is needed.

        The first line contains the names of the columns. Numbers are in SI units, with enough digits to restore each
        number exactly. True is written as 1, and false as 0.

        Args:
            path: Path of the file, which appears when it is complete.
            overwrite: Whether to replace an existing file.

        Raises:
            RecordingError: The file exists or cannot be written.
        """
        from graspfx.show.conversions import write_csv

        write_csv(self, path, overwrite=overwrite)

    def to_html(self, path: str | PathLike[str], *, overwrite: bool = False) -> Path:
        """Write a page that plays the run in a browser: objects, fingers, forces as arrows, and charts.

        The page is one file and needs no network. It shows at most 60 frames per second, with numbers rounded to 24
        bits. Its charts show the minimum and maximum over all rows.

        Args:
            path: Path of the file, which must end in .html. The file appears when it is complete.
            overwrite: Whether to replace an existing file.

        Raises:
            InputError: The recording has no rows, or the path does not end in .html.
            RecordingError: The file exists or cannot be written.
        """
        from graspfx.live.page.document import write_page

        return write_page(self, path, overwrite=overwrite)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Recording:
        """Load a recording from a file.

        If the run is still active or was killed, the rows that have been written are loaded.

        Args:
            path: Path of the file, or of the folder that contains recording.h5. If only recording.h5.part exists, which
                a run writes until its end, this file is read; the outcome is then not `complete`.

        Raises:
            RecordingError: The file is not a recording, or was changed after it was written.
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
    yield "set", listed(setting(key, value) for key, value in header.overrides.items())
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
    """Return a recording in memory from the bytes of a file; `start` is its first row's index in the whole recording.

    Raises:
        RecordingError: The bytes were changed after they were written.
    """
    from graspfx.recording.file import read

    with TemporaryDirectory(prefix="graspfx-") as folder:
        place = Path(folder) / NAME
        place.write_bytes(content)
        rows, layout, header, outcome = read(place)
        return kind(rows.read(0, len(rows), slice(0, layout.width)), layout, header, outcome, start=start)


# Comparison with another recording, column by column and bit by bit ------------------------------------------------


class Difference(NamedTuple):
    """Difference of one column in two recordings.

    Attributes:
        column: Name of the column.
        largest: Largest difference; infinite where only one of the two values is NaN.
        tick: First tick at which the values differ.
        unit: Unit of the column.
    """

    column: str
    largest: float
    tick: int
    unit: str

    def __str__(self) -> str:
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{self.column}: up to {self.largest:.3g}{unit}, from tick {self.tick} on"


def compared(one: Recording, other: Recording) -> list[str]:
    """Return the columns that both recordings have, except those that depend on real time, such as `wall`."""
    columns = [name for name in one.layout.columns if name in other.layout.columns]
    return [name for name in columns if one.layout.columns[name].filled != "loop"]


def differences(one: Recording, other: Recording) -> list[Difference]:
    """Compare the columns of two recordings with the same number of rows, except those that depend on real time.

    Values are compared bit by bit: zeros of opposite sign differ, and NaN differs from numbers.
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
