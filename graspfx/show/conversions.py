"""Conversion of recordings, batches and linearisations for xarray, pandas, CSV files and python-control."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module
from math import prod
from os import PathLike
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.linearisation import Linearisation
from graspfx.analysis.stability.loop import open_loop
from graspfx.errors import InputError, MissingPackageError, RecordingError, UnknownNameError
from graspfx.loop.columns import Column, Layout
from graspfx.recording.files import placing, recording_path, require_vacancy
from graspfx.recording.header import conclusion, description
from graspfx.recording.record import Recording

if TYPE_CHECKING:
    import xarray

    from graspfx.batch.batch import Batch

UNITS = {
    "viscosity": "N s/m",
    "rotational_viscosity": "N m s/rad",
    "mass": "kg",
    "period": "s",
    "duration": "s",
    "stiffness": "N/m",
    "damping": "N s/m",
    "friction": "N s/m",
    "squeeze": "m",
    "radius": "m",
}
NO_UNIT = ("coupling.friction",)  # these keys have no unit, although other keys of the same last name have one


def unit_of(key: str) -> str:
    """Return the unit of the values of a key; empty if it is unknown."""
    last = key.rsplit(".", 1)[-1]
    return "" if key in NO_UNIT else UNITS.get(last, "")


ENERGIES = {  # attributes of a recording, one value per finger and tick, that are not columns
    f"{part}_energy": f"work that the {part} part of the displayed force has done on the fingertip so far"
    for part in ("internal", "external")
}


class Quantity(NamedTuple):
    """One quantity of a recording.

    Attributes:
        name: Name of the quantity.
        values: Values, (N, ...).
        dimensions: Names of the dimensions of `values` after the first, which is time.
        unit: Unit of the values.
        meaning: Description of the quantity.
    """

    name: str
    values: NDArray[Any]
    dimensions: tuple[str, ...]
    unit: str
    meaning: str


def works_of(recording: Recording) -> dict[str, NDArray[Any]]:
    """Return the work of the displayed force's parts, (N, fingers) [J], by name; empty if it cannot be computed."""
    values = {name: _derived(recording, name) for name in ENERGIES}
    return {name: each for name, each in values.items() if each is not None}


def quantities(
    recording: Recording, works: Mapping[str, NDArray[Any]] | None = None, only: str = ""
) -> Iterator[Quantity]:
    """Yield the columns of a recording and the variables that are derived from them.

    The columns `objects/NAME/position` of all objects become one quantity `object_position` with a dimension `object`.
    Its values are NaN for an object without the column.

    Args:
        recording: Complete recording, or a part of it.
        works: Rows of `works_of` for this part of a recording, because work accumulates from the start of the run; None
            for a complete recording.
        only: Name of the only quantity to yield; empty for all.
    """
    layout = recording.layout
    for column in (*layout.columns.values(), *layout.derived):
        name = column.name.replace("/", "_")
        if only in ("", name) and not column.name.startswith("objects/"):
            values = _stored(recording, column) if column.name in layout.columns else _derived(recording, name)
            if values is not None:
                yield Quantity(name, values, column.dimensions, column.unit, column.meaning)
    for name, meaning in ENERGIES.items():
        if only in ("", name):
            values = _derived(recording, name) if works is None else works.get(name)
            if values is not None:
                yield Quantity(name, values, ("finger",), "J", meaning)
    for part, column in parts_of_objects(layout).items():
        name = f"object_{part.replace('/', '_')}"
        if only in ("", name):
            values = _of_objects(recording, part, column)
            yield Quantity(name, values, ("object", *column.dimensions), column.unit, column.meaning)


def rows_of(recording: Recording, name: str, first: int, stop: int) -> NDArray[Any]:
    """Return the values of a quantity in the rows `first` to `stop - 1`, without reading other columns."""
    is_whole = name in ENERGIES or (first, stop) == (0, len(recording))  # energies accumulate from the beginning
    source = recording if is_whole else recording.part(first, stop)
    values = next(quantities(source, only=name)).values
    return values[first:stop] if is_whole else values


def coordinates(layout: Layout) -> dict[str, tuple[str, ...]]:
    """Return the names of the entries along each dimension except time, by dimension."""
    return {**layout.scales, "object": layout.objects}


def parts_of_objects(layout: Layout) -> Mapping[str, Column]:
    """Return the columns of objects by their names without the object, such as `energy/work`.

    If several objects have a column, the column of the first of these objects is returned.
    """
    parts: dict[str, Column] = {}
    for column in layout.columns.values():
        if column.name.startswith("objects/"):
            parts.setdefault(column.name.split("/", 2)[2], column)
    return parts


def components(quantity: Quantity, names: Mapping[str, tuple[str, ...]]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield each component of a quantity, (N,), with its name, such as `finger_force.thumb.x`."""
    shape = quantity.values.shape[1:]
    flat = quantity.values.reshape(len(quantity.values), prod(shape))
    for k, place in enumerate(np.ndindex(*shape)):
        entries = (names[name][i] for name, i in zip(quantity.dimensions, place, strict=True))
        yield ".".join([quantity.name, *entries]), flat[:, k]


def _stored(recording: Recording, column: Column) -> NDArray[Any]:
    return column.typed(recording.array(column.name))


def _derived(recording: Recording, name: str) -> NDArray[Any] | None:
    try:
        values: NDArray[Any] | None = getattr(recording, name, None)
    except RecordingError:  # an earlier format without split rules
        return None
    return values


def _of_objects(recording: Recording, part: str, like: Column) -> NDArray[Any]:
    """Return a column of all objects, (N, objects, ...), with NaN for objects without the column."""
    own = [recording.layout.columns.get(f"objects/{name}/{part}") for name in recording.layout.objects]
    nothing = np.full((1, *like.shape), np.nan)
    values = [nothing if each is None else _stored(recording, each) for each in own]
    if len(values) == 1:
        return values[0][:, None]  # a view
    return np.stack([np.broadcast_to(each, (len(recording), *like.shape)) for each in values], axis=1)


def recording_dataset(recording: Recording) -> xarray.Dataset:
    """Convert a recording as described in `Recording.to_xarray`."""
    xr = _package("xarray", "Recording.to_xarray")
    labels = coordinates(recording.layout)
    first = {each.name: each for each in quantities(recording.part(0, min(1, len(recording))))}
    if recording.is_stored:
        variables = {name: _lazy(xr, recording, each) for name, each in first.items()}
    else:
        variables = {
            each.name: xr.Variable(("time", *each.dimensions), each.values, _about(each))
            for each in quantities(recording)
        }
    used = {name for variable in variables.values() for name in variable.dims}
    scales = {name: list(entries) for name, entries in labels.items() if name in used}
    time = xr.Variable("time", recording.time, {"units": "s"})
    attributes: dict[str, Any] = {**description(recording.layout, recording.header), **conclusion(recording.outcome)}
    attributes["faults"] = "\n".join(map(str, recording.faults))
    data: xarray.Dataset = xr.Dataset(variables, {"time": time, **scales}, attributes)
    return data


def _package(name: str, wanted_by: str, extra: str = "data") -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        raise MissingPackageError.of_extra(name, wanted_by, extra) from error


def _lazy(xr: Any, recording: Recording, first: Quantity) -> Any:
    """Return an xarray variable whose values are read from disk or computed when they are accessed."""
    from xarray.backends import BackendArray
    from xarray.core.indexing import IndexingSupport, LazilyIndexedArray, explicit_indexing_adapter

    class Stored(BackendArray):
        shape, dtype = (len(recording), *first.values.shape[1:]), first.values.dtype

        def __getitem__(self, key: Any) -> Any:
            return explicit_indexing_adapter(key, self.shape, IndexingSupport.BASIC, self._read)

        def _read(self, key: tuple[Any, ...]) -> Any:
            rows, rest = key[0], key[1:]
            places = range(*rows.indices(len(recording))) if isinstance(rows, slice) else range(rows, rows + 1)
            low, high = (min(places[0], places[-1]), max(places[0], places[-1]) + 1) if places else (0, 0)
            values = rows_of(recording, first.name, low, high)
            chosen = slice(None, None, places.step) if isinstance(rows, slice) else 0
            return values[(chosen, *rest)]

    return xr.Variable(("time", *first.dimensions), LazilyIndexedArray(Stored()), _about(first))


def _about(quantity: Quantity) -> dict[str, str]:
    return {"units": quantity.unit, "long_name": quantity.meaning}


class Labels(NamedTuple):
    """Arrays with dimensions and attributes, for xarray and netCDF.

    Attributes:
        variables: For each variable, the names of its dimensions, its values, and attributes such as `units`.
        coordinates: The same for each coordinate; a coordinate with the name of a dimension contains its entries.
        attributes: Attributes of the whole data set.
    """

    variables: dict[str, tuple[tuple[str, ...], Any, dict[str, str]]]
    coordinates: dict[str, tuple[tuple[str, ...], Any, dict[str, str]]]
    attributes: dict[str, Any]


def batch_dataset(labels: Labels) -> xarray.Dataset:
    """Convert the arrays of a batch as described in `Batch.to_xarray`."""
    xr = _package("xarray", "Batch.to_xarray")
    variables, scales = (
        {name: xr.Variable(*each) for name, each in part.items()} for part in (labels.variables, labels.coordinates)
    )
    data: xarray.Dataset = xr.Dataset(variables, scales, labels.attributes)
    return data


def batch_labels(batch: Batch) -> Labels:
    """Return the arrays of a batch with their dimensions, units and descriptions."""
    grid, scales = grid_of(batch)
    names = {} if batch.layout is None else coordinates(batch.layout)
    meaning = {"long_name": "tick of the first fault; -1 if no fault occurred"}
    variables: dict[str, Any] = {"fault_tick": (grid, batch.fault_tick, meaning)}
    for quantity, by_name in batch.measures.items():
        column = batch.column(quantity)
        for name, values in by_name.items():
            unit = "1" if name in ("growth", "unstable") else column.unit
            about = {"units": unit, "long_name": f"{name} of {quantity}: {column.meaning}"}
            variables[f"{quantity}_{name}".replace("/", "_")] = ((*grid, *column.dimensions), values, about)
    if batch.recordings is not None:
        variables |= _stacked(batch, grid)
        scales["time"] = (("time",), batch.recordings.flat[0].time, {"units": "s"})
    if batch.summaries is not None:
        variables |= {name: (grid, values, {}) for name, values in summary_numbers(batch).items()}
    used = {name for dimensions, _, _ in variables.values() for name in dimensions}
    scales |= {name: ((name,), list(entries), {}) for name, entries in names.items() if name in used}
    attributes = {"scene": batch.scene, "notes": list(batch.notes), "build_time": batch.build_time}
    return Labels(variables, scales, {**attributes, "run_time": batch.run_time})


def grid_of(batch: Batch) -> tuple[tuple[str, ...], dict[str, Any]]:
    """Return the names of a batch's axes, and the values of each key along its axis.

    If the values of several keys change together (`zip`), the only axis is `variant`.
    """
    together = len(batch.values) > len(batch.shape)
    axes = ("variant",) if together else tuple(batch.values)
    scales: dict[str, Any] = {}
    for k, (key, values) in enumerate(batch.values.items()):
        alone = values if together else np.moveaxis(values, k, 0).reshape(values.shape[k], -1)[:, 0]
        plain = [each if isinstance(each, str | int | float) else repr(each) for each in alone.tolist()]
        unit = unit_of(key)
        scales[key] = ((axes[0 if together else k],), plain, {"units": unit} if unit else {})
    return axes, scales


def summary_numbers(batch: Batch) -> dict[str, np.ndarray[Any, np.dtype[np.float64]]]:
    """Return the numbers of all summaries by name, in the shape of the batch; None becomes NaN."""
    summaries = [] if batch.summaries is None else batch.summaries.ravel().tolist()
    numbers = {}
    for name in summaries[0]:
        values = [each.get(name) for each in summaries]
        if any(isinstance(value, int | float) for value in values) and all(
            value is None or isinstance(value, int | float) for value in values
        ):
            numbers[name] = np.array([np.nan if each is None else each for each in values]).reshape(batch.shape)
    return numbers


def _stacked(batch: Batch, grid: tuple[str, ...]) -> dict[str, Any]:
    tables = [
        {each.name: each for each in quantities(one)}
        for one in ([] if batch.recordings is None else batch.recordings.ravel().tolist())
    ]
    first = tables[0]
    shapes = {name: each.values.shape for name, each in first.items()}
    if any({name: each.values.shape for name, each in table.items()} != shapes for table in tables):
        expected = "recordings with the same columns and number of rows"
        raise InputError("keep", "recordings", expected, "convert the recordings one by one")
    return {
        name: (
            (*grid, "time", *each.dimensions),
            np.array([table[name].values for table in tables]).reshape(*batch.shape, *each.values.shape),
            _about(each),
        )
        for name, each in first.items()
    }


BLOCK = 1000  # number of rows that are written at once


def recording_frame(recording: Recording) -> Any:
    """Convert a recording as described in `Recording.to_frame`."""
    pandas = _package("pandas", "Recording.to_frame")
    frame = pandas.DataFrame(dict(_columns(recording)), index=pandas.Index(recording.time, name="time"))
    frame.attrs = {"scene": recording.header.scene, "units": {each.name: each.unit for each in quantities(recording)}}
    return frame


def batch_frame(batch: Batch) -> Any:
    """Convert a batch as described in `Batch.to_frame`."""
    pandas = _package("pandas", "Batch.to_frame")
    plain = {key: np.asarray(values, dtype=object).ravel() for key, values in batch.values.items()}
    columns: dict[str, Any] = {
        key: [each if isinstance(each, str | float) else repr(each) for each in values] for key, values in plain.items()
    }
    columns["fault_tick"] = batch.fault_tick.ravel()
    for quantity, by_name in batch.measures.items():
        column = batch.column(quantity)
        for name, values in by_name.items():
            flat = values.reshape(len(batch), *values.shape[len(batch.shape) :])
            each = Quantity(f"{quantity}.{name}", flat, column.dimensions, column.unit, column.meaning)
            columns |= dict(components(each, {} if batch.layout is None else coordinates(batch.layout)))
    if batch.summaries is not None:
        columns |= {name: values.ravel() for name, values in summary_numbers(batch).items()}
    return pandas.DataFrame(columns)


def write_csv(recording: Recording, path: str | PathLike[str], *, overwrite: bool = False) -> None:
    """Write a recording as described in `Recording.to_csv`."""
    place = recording_path(path, "path")
    if not place.name:
        raise InputError("path", str(path), "the path of a file, such as recording.csv")
    if not overwrite:
        require_vacancy([place])
    with placing(place) as draft, draft.open("w", encoding="utf-8", newline="") as file:
        file.writelines(csv_lines(recording))


def csv_lines(recording: Recording) -> Iterator[str]:
    """Yield the lines of a CSV file (RFC 4180), in which each number has the fewest digits that restore it exactly.

    Quotes are not needed, because the names of fingers and objects contain no commas or quotes.
    """
    together, first = works_of(recording), 0
    for part in recording.parts() if len(recording) else [recording]:
        late = {name: values[first : first + len(part)] for name, values in together.items()}
        table = {"time": part.time, **dict(_columns(part, late))}
        if not first:
            yield ",".join(table) + "\r\n"
        first += len(part)
        columns = [values.astype(np.int8) if values.dtype == bool else values for values in table.values()]
        for k in range(0, len(part), BLOCK):
            block = [values[k : k + BLOCK].tolist() for values in columns]
            yield "".join(",".join(map(repr, row)) + "\r\n" for row in zip(*block, strict=True))


def _columns(
    recording: Recording, works: Mapping[str, NDArray[Any]] | None = None
) -> Iterator[tuple[str, NDArray[Any]]]:  # fmt: skip
    names = coordinates(recording.layout)
    for quantity in quantities(recording, works):
        yield from components(quantity, names)


LOOPS = ("closed", "open")


def to_control(linear: Linearisation, loop: str = "closed") -> Any:
    """Convert a linearisation as described in `Linearisation.to_control`."""
    control = _package("control", "Linearisation.to_control", "control")
    if loop not in LOOPS:
        raise UnknownNameError("loop", str(loop), LOOPS)
    m, r = linear.coordinates
    opened = open_loop(linear)
    forces = [f"f[{i}]" for i in range(m)]
    if loop == "open":
        return control.StateSpace(
            opened.A, opened.B, -opened.C, np.zeros((m, m)), linear.period, remove_useless_states=False,
            inputs=[f"u[{i}]" for i in range(m)], outputs=[f"minus {name}" for name in forces], name="opened loop",
        )  # fmt: skip
    motion = np.zeros((m + r, len(opened.A)))
    motion[:m, :m], motion[m:, 2 * m : 2 * m + r] = np.eye(m), np.eye(r)
    C = np.vstack([motion, opened.C])
    names = [*(f"x[{i}]" for i in range(m)), *(f"q[{j}]" for j in range(r)), *forces]
    return control.StateSpace(
        opened.A + opened.B @ opened.C, opened.hand, C, np.zeros((len(C), m)), linear.period,
        remove_useless_states=False, inputs=[f"hand[{i}]" for i in range(m)], outputs=names, name="grasp",
    )  # fmt: skip
