"""Many variants of a scene at once: `run_batch`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx import plugins
from graspfx.analysis.arguments import count
from graspfx.assembly.provenance import header_of
from graspfx.assembly.resolve import resolve
from graspfx.assembly.session import warn_of_axes
from graspfx.batch.grid import as_array, as_objects, grid
from graspfx.batch.group_runs import Runs
from graspfx.batch.measured_columns import columns_of, is_quantity
from graspfx.batch.statistics import STATISTICS, Statistics
from graspfx.batch.variants import Variants
from graspfx.card import Card, Carded, counted, listed
from graspfx.environment import processors
from graspfx.errors import InputError, UnknownNameError
from graspfx.loop.columns import Column, Layout
from graspfx.progress import waiting
from graspfx.recording.record import Recording

if TYPE_CHECKING:
    import pandas
    import xarray

    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]

KEEP = ("measures", "recordings", "summary")
MEASURED = ("finger_position", "object_position", "finger_force")


@dataclass(frozen=True, repr=False)
class Batch(Carded):
    """The outcome of many runs. Every array begins with the grid's axes: one for each key, or one for all with `zip`.

    Attributes:
        values: by key, its value in each variant, arrays of the grid's shape; numbers as floats where all are.
        fault_tick: the tick at which each variant's first fault was, -1 for none, of the grid's shape.
        measures: by quantity and statistic, (*grid, *quantity): an entry per finger and axis, in the quantity's unit;
            growth in none.
        recordings: of each variant, an array of the grid's shape; None unless they were kept.
        summaries: `Recording.summary()` of each, likewise.
        notes: what took longer than it need have.
        build_time, run_time: that scenes and programs took, and that the runs took [s].
        scene: its name.
        layout: the columns of the runs' recordings, of the first variant where they differ.
    """

    values: dict[str, NDArray[Any]]
    fault_tick: IndexArray
    measures: dict[str, dict[str, FloatArray]] = field(default_factory=dict)
    recordings: NDArray[Any] | None = None
    summaries: NDArray[Any] | None = None
    notes: tuple[str, ...] = ()
    build_time: float = 0.0
    run_time: float = 0.0
    scene: str = ""
    layout: Layout | None = None

    def _card(self) -> Card:
        together = len(self.values) > len(self.shape)
        grid = f" ({' x '.join(map(str, self.shape))})" if len(self.shape) > 1 else ""
        faults = int((self.fault_tick >= 0).sum())
        results = {"recordings": self.recordings, "summaries": self.summaries}
        rows = [
            *(
                (key, listed(dict.fromkeys(f"{each}" for each in values.ravel())))
                for key, values in self.values.items()
            ),
            *((name, listed(by_name, len(by_name))) for name, by_name in self.measures.items()),
            ("kept", listed(name for name, values in results.items() if values is not None)),
            ("faults", f"in {counted(faults, 'variant')}" if faults else "none"),
            ("time", f"{self.build_time:.3g} s to build, {self.run_time:.3g} s to run"),
            ("notes", "\n".join(self.notes)),
        ]
        calls = f"{self._results()}, .fault_tick, .to_xarray(), .to_frame(), .to_dict()"
        zipped = ", their values taken together" if together else ""
        title = f"Batch of {self.scene or 'a scene'}: {counted(len(self), 'variant')}{grid}{zipped}"
        return Card(title, rows, calls)

    def _results(self) -> str:
        """Name the calls that lead to what was kept."""
        if self.recordings is not None:
            return ".recordings, .stacked(quantity)"
        return "[quantity][statistic], .growth(quantity)" if self.summaries is None else ".summaries"

    @property
    def shape(self) -> tuple[int, ...]:
        """The grid's."""
        return self.fault_tick.shape

    def __len__(self) -> int:
        """Count the variants."""
        return self.fault_tick.size

    def __getitem__(self, quantity: str) -> dict[str, FloatArray]:
        """Look up the statistics of a quantity, by name.

        Raises:
            UnknownNameError: the quantity was not measured, or something else was kept.
        """
        if quantity in self.measures:
            return self.measures[quantity]
        name = str(quantity)
        if not self.measures:
            outcomes = "summaries" if self.recordings is None else "recordings"
            remedy = f"batch.{outcomes} has one of each run; for statistics run the batch with keep='measures'"
            raise UnknownNameError("measure", name, (), f"this batch kept {outcomes}: {remedy}")
        if self.layout is not None and is_quantity(self.layout, name):
            raise UnknownNameError(
                "measure", name, (), f"not measured: pass measure=[{name!r}] (measured: {', '.join(self.measures)})"
            )
        raise UnknownNameError("measure", name, self.measures)

    def growth(self, quantity: str = "finger_position") -> FloatArray:
        """Find the largest growth of a quantity's entries in each variant, of the grid's shape: above 1 it grows.

        A run that ends in a fault (`fault_tick`) has no forces from there on, which is no sign that it calmed down.
        """
        statistics = self[quantity]
        if "growth" not in statistics:
            raise UnknownNameError("statistic", "growth", statistics)
        values = statistics["growth"].reshape(*self.shape, -1)
        return np.asarray(np.nanmax(np.where(np.isnan(values).all(axis=-1, keepdims=True), np.inf, values), axis=-1))

    def stacked(self, quantity: str) -> FloatArray:
        """Stack a quantity over time, (*grid, N, *quantity), where recordings were asked for and are alike."""
        if self.recordings is None:
            keep = "measures" if self.summaries is None else "summary"
            raise InputError("keep", keep, "recordings", "run the batch with keep='recordings'")
        stack = np.array([each.array(quantity) for each in self.recordings.ravel()])
        return stack.reshape(*self.shape, *stack.shape[1:])

    def column(self, quantity: str) -> Column:
        """Look up what a quantity is: its dimensions, unit and meaning.

        Raises:
            UnknownNameError: there is no such quantity.
        """
        if self.layout is None:
            raise UnknownNameError("measure", quantity, ())
        return columns_of(self.layout, [quantity])[0][quantity]

    def to_xarray(self) -> xarray.Dataset:
        """Convert to an xarray Dataset: a dimension per key, or `variant` for all with `zip`, then those of a quantity.

        Measures are variables as `finger_force_rms`, recordings those of `Recording.to_xarray`, each with `units` and
        `long_name`; of summaries there are their numbers.

        Raises:
            MissingPackageError: no xarray, which `pip install 'graspfx[data]'` brings.
            InputError: recordings of different columns or lengths.
        """
        from graspfx.show.export import batch_dataset

        return batch_dataset(self)

    def to_frame(self) -> pandas.DataFrame:
        """Convert to a pandas DataFrame: a row per variant, a column per key and per component.

        Components are called as `finger_force.rms.thumb.x`.

        Raises:
            MissingPackageError: no pandas, which `pip install 'graspfx[data]'` brings.
        """
        from graspfx.show.export import batch_frame

        return batch_frame(self)

    def to_dict(self) -> dict[str, Any]:
        """Write values, faults, measures and summaries as nested lists, for JSON."""
        table: dict[str, Any] = {
            "values": {key: each.tolist() for key, each in self.values.items()},
            "fault_tick": self.fault_tick.tolist(),
            "measures": {
                quantity: {name: each.tolist() for name, each in statistics.items()}
                for quantity, statistics in self.measures.items()
            },
            "notes": list(self.notes),
        }
        if self.summaries is not None:
            table["summaries"] = self.summaries.tolist()
        return table


def run_batch(
    scene: Scene | str | PathLike[str],
    values: Mapping[str, Sequence[Any] | NDArray[Any]],
    duration: float | None = None,
    *,
    zip: bool = False,
    keep: str = "measures",
    measure: Sequence[str] = MEASURED,
    statistics: Sequence[str] = STATISTICS,
    threads: int | None = None,
) -> Batch:
    """Simulate many variants of a scene at once; each is the scene with some values replaced.

    The runs are those of `gx.run`, to the last bit but for the sign of a zero. Values of gains that are numbers, of
    coefficients of friction, and of an object's mass and viscosities go to the fields that they reach as columns, all
    at once: one variant is built of each kind, as of equal gains, and two others to check the columns. Of numbers of
    devices and hands their blocks alone are made, a millisecond or two for each choice of values. Of another key one
    variant is built for every value, which takes some milliseconds; combinations are put together from what each value
    changes, and some of these, with all combinations of extremes, are built to check that they are the same, bit
    by bit; where keys act on one another their combinations are built too. Every value is checked as the scene's own.

    Variants run one by one on all processors, by the program of all scenes: nothing is compiled for a batch.

    Memory: of measures a few hundred bytes for each variant, and some megabytes for each processor, however many
    variants there are. Whole recordings take what their rows do.

    Args:
        scene: a Scene, a name or a path; native throughout: every device, hand and body a kernel.
        values: by dotted key, as for `scene.replace`; all combinations of them, the last key changing fastest.
        duration: instead of the scene's own [s]; rounded to whole periods.
        zip: take the keys' first values together, then their second ones, ..., instead of all combinations.
        keep: "measures", of the quantities in `measure`; "recordings", whole ones, a `Recording` of each; or
            "summary", `Recording.summary()` of each, which costs a millisecond apiece.
        measure: quantities: columns of a recording's layout; `internal_force`, `external_force`,
            `internal_displacement`, `external_displacement` and `displayed_force`, which are computed from recorded
            rows, some microseconds each; or `object_position`, `object_velocity`, `object_orientation` and `wrench` of
            the first object.
        statistics: of each number of these: first, last, mean, rms, min, max, peak (the largest magnitude) and growth
            (the peak of the second half of the run over that of the first).
        threads: as many as there are processors if not given; the result is the same.

    Raises:
        SceneError: a variant that is no scene, with its values.
        InputError: lists of different lengths with `zip`; no values; a part of the scene that is no kernel.
        UnknownNameError: a quantity or statistic that there is not.
        MissingPackageError: no LLVM.
    """
    from graspfx.scene.load import to_scene

    scene_ = to_scene(scene)
    if not isinstance(values, Mapping):
        raise InputError("values", values, "lists by dotted key", "as in {'coupling.internal.stiffness': [50.0, 60.0]}")
    measure, statistics = names_of("measure", measure), names_of("statistics", statistics)
    require_known("keep", [keep], KEEP)
    require_known("statistic", statistics, STATISTICS)
    threads = count("threads", threads, 1) if threads is not None else processors()
    began = perf_counter()
    shape, lists, numbers = grid(values, zip=zip)
    with plugins.unchanged():
        variants = Variants(scene_, lists, numbers)
        with waiting("building variants", unit="built", count=lambda: variants.builds):
            groups = variants.groups()
    warn_of_axes(resolve(scene_))
    runs = Runs(scene_, variants, len(numbers), duration, threads)
    if keep == "measures":
        measures = runs.measured(groups, measure, statistics)
        results: dict[str, Any] = {
            "measures": {
                quantity: Statistics({name: each.reshape(*shape, *each.shape[1:]) for name, each in by_name.items()})
                for quantity, by_name in measures.items()
            }
        }
    elif keep == "recordings":
        results = {"recordings": as_objects(runs.recorded(groups, lambda each: each, whole=True), shape)}
    else:
        results = {"summaries": as_objects(runs.recorded(groups, Recording.summary, whole=False), shape)}
    return Batch(
        values={key: as_array(lists[key])[numbers[:, k]].reshape(shape) for k, key in enumerate(lists)},
        fault_tick=runs.faults.reshape(shape),
        notes=tuple(variants.notes),
        build_time=perf_counter() - began - runs.run_time,
        run_time=runs.run_time,
        scene=header_of(resolve(scene_)).scene,
        layout=groups[0].program.servo.layout,
        **results,
    )


def names_of(argument: str, names: Sequence[str]) -> Sequence[str]:
    """List names, also where one stands alone."""
    if isinstance(names, str):
        return [names]
    if not isinstance(names, Iterable):
        raise InputError(argument, names, "a list of names")
    return [str(each) for each in names]


def require_known(kind: str, names: Sequence[str], choices: Sequence[str]) -> None:
    for name in names:
        if name not in choices:
            raise UnknownNameError(kind, name, choices)
