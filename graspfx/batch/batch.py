"""Simulation of many variants of a scene (`run_batch`) and its results (`Batch`)."""

from __future__ import annotations

import builtins
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.provenance import header_of
from graspfx.assembly.resolve import resolve
from graspfx.assembly.session import warn_of_axes
from graspfx.batch.group_runs import Runs
from graspfx.batch.measured_columns import STATISTICS, Statistics, columns_of, is_quantity
from graspfx.card import Card, Carded, counted, listed
from graspfx.environment import processors
from graspfx.errors import InputError, UnknownNameError
from graspfx.loop.columns import Column, Layout
from graspfx.numeric import count
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
    """Results of the runs of many variants of a scene.

    The shape of the grid of variants has one axis per key, or a single axis if `run_batch` was called with `zip=True`.
    The first axes of each array are those of the grid.

    Attributes:
        values: Values of the variants by key, as arrays of the grid's shape; numbers are floats.
        fault_tick: Tick of the first fault of each variant, -1 for a variant without a fault, as an array of the grid's
            shape.
        measures: Statistics by name of the quantity and name of the statistic, (*grid, *quantity), in the unit of the
            quantity; growth has no unit. Empty if measures were not kept.
        recordings: Recordings as an array of the grid's shape; None if recordings were not kept.
        summaries: `Recording.summary()` of each run, as an array of the grid's shape; None if summaries were not kept.
        notes: Reasons why the batch took longer than usual.
        build_time, run_time: Times to build and to run the variants [s].
        scene: Name of the scene.
        layout: Columns of the rows of a run; if variants differ, those of one variant.
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
        zipped = ", their values combined one by one" if together else ""
        title = f"Batch of {self.scene or 'a scene'}: {counted(len(self), 'variant')}{grid}{zipped}"
        return Card(title, rows, calls)

    def _results(self) -> str:
        """Return a text with the calls that return the kept results."""
        if self.recordings is not None:
            return ".recordings, .stacked(quantity)"
        return "[quantity][statistic], .growth(quantity)" if self.summaries is None else ".summaries"

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the grid."""
        return self.fault_tick.shape

    def __len__(self) -> int:
        """Number of variants."""
        return self.fault_tick.size

    def __getitem__(self, quantity: str) -> dict[str, FloatArray]:
        """Return the statistics of a quantity, by name of the statistic.

        Raises:
            UnknownNameError: If the quantity was not measured, or measures were not kept.
        """
        if quantity in self.measures:
            return self.measures[quantity]
        name = str(quantity)
        if not self.measures:
            outcomes = "summaries" if self.recordings is None else "recordings"
            remedy = f"use batch.{outcomes}, or run the batch with keep='measures' for statistics"
            raise UnknownNameError("measure", name, (), f"this batch has only {outcomes}: {remedy}")
        if self.layout is not None and is_quantity(self.layout, name):
            raise UnknownNameError(
                "measure",
                name,
                (),
                f"it was not measured: run the batch with measure=[{name!r}] (measured: {', '.join(self.measures)})",
            )
        raise UnknownNameError("measure", name, self.measures)

    def growth(self, quantity: str = "finger_position") -> FloatArray:
        """Return the largest growth over the entries of a quantity for each variant, as an array of the grid's shape.

        The growth of an entry is the largest magnitude in the second half of the run divided by the largest magnitude
        in the first half; it exceeds 1 if the motion grows. The result is inf if the growth of every entry is nan.
        After a fault (`fault_tick`), all forces are zero, so that a small growth does not imply that the run was
        stable.

        Raises:
            UnknownNameError: If the quantity or its growth was not measured.
        """
        statistics = self[quantity]
        if "growth" not in statistics:
            raise UnknownNameError("statistic", "growth", statistics)
        values = statistics["growth"].reshape(*self.shape, -1)
        return np.asarray(np.nanmax(np.where(np.isnan(values).all(axis=-1, keepdims=True), np.inf, values), axis=-1))

    def stacked(self, quantity: str) -> FloatArray:
        """Return a quantity in the N rows of every recording, (*grid, N, *quantity).

        The recordings must have equal lengths and columns.

        Raises:
            InputError: If recordings were not kept.
        """
        if self.recordings is None:
            keep = "measures" if self.summaries is None else "summary"
            raise InputError("keep", keep, "'recordings'", "run the batch with keep='recordings'")
        stack = np.array([each.array(quantity) for each in self.recordings.ravel()])
        return stack.reshape(*self.shape, *stack.shape[1:])

    def column(self, quantity: str) -> Column:
        """Return dimensions, unit and meaning of a quantity.

        Raises:
            UnknownNameError: If the quantity does not exist.
        """
        if self.layout is None:
            raise UnknownNameError("measure", quantity, ())
        return columns_of(self.layout, [quantity])[0][quantity]

    def to_xarray(self) -> xarray.Dataset:
        """Convert to an xarray Dataset with one dimension per key, or the dimension `variant` if `zip` was True.

        Measures become variables such as `finger_force_rms`, recordings become the variables of `Recording.to_xarray`,
        and numbers in summaries become variables. Variables of measures and recordings have the attributes `units` and
        `long_name`.

        Raises:
            MissingPackageError: If xarray is not installed: `pip install 'graspfx[data]'`.
            InputError: If the recordings have different columns or lengths.
        """
        from graspfx.show.conversions import batch_dataset, batch_labels

        return batch_dataset(batch_labels(self))

    def to_frame(self) -> pandas.DataFrame:
        """Convert to a pandas DataFrame with one row per variant, and one column per key and component.

        Components have names such as `finger_force.rms.thumb.x`.

        Raises:
            MissingPackageError: If pandas is not installed: `pip install 'graspfx[data]'`.
        """
        from graspfx.show.conversions import batch_frame

        return batch_frame(self)

    def to_dict(self) -> dict[str, Any]:
        """Return values, fault ticks, measures, notes and summaries as a dictionary that JSON can represent."""
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
    """Simulate many variants of a scene, in which some values of the scene are replaced.

    The results of each run are bit-identical to those of `gx.run`, except for the sign of a zero. Every value is
    validated as in a scene file.

    If there are more than 16 variants, most of them are not built from the scene. Gains, coefficients of friction,
    masses and viscosities are computed for all variants at once and written into copies of one built variant; some
    other variants are built to verify the copies. Values of devices and hands take 1 to 2 ms per combination. For other
    keys, one variant is built for each value, other combinations are assembled from these variants, and up to 64
    combinations of extreme values and some others are built to verify the assembly. If keys interact, every combination
    is built.

    Each thread runs one variant at a time by the program that all scenes share; nothing is compiled for a batch.
    Measures require a few hundred bytes of memory per variant, and some megabytes per thread. Recordings require the
    memory of their rows.

    Args:
        scene: `Scene`, or name or path of a scene. All devices, hands and bodies must be kernels; variants of other
            scenes can be run with `gx.sweep`.
        values: Lists of values by dotted key, as for `scene.replace`. All combinations are run; the value of the last
            key changes fastest.
        duration: Duration [s], rounded to whole periods; the scene's duration if None.
        zip: Whether to run one variant for each index of the lists, instead of all combinations of values.
        keep: Results to keep: "measures" for statistics of the quantities in `measure`, "recordings", or "summary" for
            `Recording.summary()`, which takes a millisecond per run.
        measure: Names of quantities: columns of a recording; `internal_force`, `external_force`,
            `internal_displacement`, `external_displacement` and `displayed_force`, which take some microseconds per
            row; or `object_position`, `object_velocity`, `object_orientation` and `wrench` of the first object.
        statistics: Statistics of each entry of a quantity: first, last, mean, rms, min, max, peak (largest magnitude)
            and growth (peak of the second half of the run divided by the peak of the first half).
        threads: Number of threads, which does not affect results; the number of processors if None.

    Raises:
        SceneError: If a variant is not a valid scene; the message states the values of the variant.
        InputError: If there are no values, lists have different lengths and `zip` is True, or a part of the scene is
            not a kernel.
        UnknownNameError: If a quantity or statistic does not exist.
        MissingPackageError: If llvmlite is not installed, and the installation does not include the compiled program.
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
    runs = Runs(scene_, lists, numbers, duration, threads)
    warn_of_axes(resolve(scene_))
    if keep == "measures":
        measures = runs.measured(measure, statistics)
        results: dict[str, Any] = {
            "measures": {
                quantity: Statistics({name: each.reshape(*shape, *each.shape[1:]) for name, each in by_name.items()})
                for quantity, by_name in measures.items()
            }
        }
    elif keep == "recordings":
        results = {"recordings": as_objects(runs.recorded(lambda each: each, whole=True), shape)}
    else:
        results = {"summaries": as_objects(runs.recorded(Recording.summary, whole=False), shape)}
    return Batch(
        values={key: as_array(lists[key])[numbers[:, k]].reshape(shape) for k, key in enumerate(lists)},
        fault_tick=runs.faults.reshape(shape),
        notes=tuple(runs.variants.notes),
        build_time=perf_counter() - began - runs.run_time,
        run_time=runs.run_time,
        scene=header_of(resolve(scene_)).scene,
        layout=runs.groups[0].program.servo.layout,
        **results,
    )


def names_of(argument: str, names: Sequence[str]) -> Sequence[str]:
    """Return names, given as a list or as a single string, as a list."""
    if isinstance(names, str):
        return [names]
    if not isinstance(names, Iterable):
        raise InputError(argument, names, "a list of names")
    return [str(each) for each in names]


def require_known(kind: str, names: Sequence[str], choices: Sequence[str]) -> None:
    for name in names:
        if name not in choices:
            raise UnknownNameError(kind, name, choices)


# Values of the keys, and the combination of each variant --------------------------------------------------------------


def grid(
    values: Mapping[str, Sequence[Any] | NDArray[Any]], *, zip: bool
) -> tuple[tuple[int, ...], dict[str, list[Any]], IndexArray]:
    """Return the shape of the grid, the list of values of each key, and the index of each variant's value, (V, keys).

    Equal values of a key have the same index.
    """
    for key, items in values.items():
        if isinstance(items, str | bytes) or not isinstance(items, Iterable):
            raise InputError(f"values[{key!r}]", items, "a list of values")
    lists = {
        str(key): items.tolist() if isinstance(items, np.ndarray) else [_plain(value) for value in items]
        for key, items in values.items()
    }
    if not lists or not all(lists.values()):
        raise InputError("values", dict(values), "at least one key, each with a list of values")
    if "duration" in lists:
        raise InputError("values", "duration", "keys of the scene", "use the argument `duration` for the duration")
    lengths = [len(items) for items in lists.values()]
    if zip and len(set(lengths)) > 1:
        lengths_by_key = dict(builtins.zip(lists, lengths, strict=True))
        raise InputError("values", lengths_by_key, "lists of equal length, because zip is True")
    alike = [_first_alike(items) for items in lists.values()]
    axes = np.tile(np.arange(lengths[0]), (len(lengths), 1)) if zip else np.indices(lengths).reshape(len(lengths), -1)
    numbers = np.array([same[axis] for same, axis in builtins.zip(alike, axes, strict=True)]).T
    return (lengths[0],) if zip else tuple(lengths), lists, np.ascontiguousarray(numbers)


def _first_alike(items: Sequence[Any]) -> IndexArray:
    """Return, for each value, the index of the first value with the same `repr`."""
    if all(type(value) is float for value in items):
        _, first, choice = np.unique(np.array(items).view(np.int64), return_index=True, return_inverse=True)
        return np.asarray(first[choice.ravel()])
    written = {repr(value): k for k, value in reversed(list(enumerate(items)))}
    return np.array([written[repr(value)] for value in items])


def _plain(value: Any) -> Any:
    """Convert arrays in a value to lists, because NumPy abbreviates the `repr` of arrays."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items()}
    return type(value)(map(_plain, value)) if type(value) in (list, tuple) else value


def as_array(values: Sequence[Any]) -> NDArray[Any]:
    """Convert values to an array of floats if all values are numbers, otherwise to an array of objects."""
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return np.array(values, dtype=float)
    return as_objects(values, (len(values),))


def as_objects(values: Sequence[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    """Return an array of the given shape whose entries are the objects."""
    objects = np.empty(len(values), dtype=object)
    objects[:] = list(values)
    return objects.reshape(shape)
