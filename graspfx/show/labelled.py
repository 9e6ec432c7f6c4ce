"""Recordings and batches as labelled data: an xarray Dataset with dimensions, units and meanings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from graspfx.errors import InputError, MissingPackageError
from graspfx.recording.header import conclusion, description
from graspfx.show.key_names import unit_of
from graspfx.show.quantities import Quantity, coordinates, quantities, rows_of

if TYPE_CHECKING:
    import xarray

    from graspfx.batch.batch import Batch
    from graspfx.recording.record import Recording


def recording_dataset(recording: Recording) -> xarray.Dataset:
    """Convert a recording; its docstring is that of `Recording.to_xarray`."""
    xr = _xarray("Recording.to_xarray")
    labels = coordinates(recording.layout)
    first = {each.name: each for each in quantities(recording.part(0, min(1, len(recording))))}
    variables = (
        {name: _lazy(xr, recording, each) for name, each in first.items()}
        if recording.is_stored
        else {each.name: _variable(xr, ("time", *each.dimensions), each) for each in quantities(recording)}
    )
    used = {name for variable in variables.values() for name in variable.dims}
    scales = {name: list(entries) for name, entries in labels.items() if name in used}
    time = xr.Variable("time", recording.time, {"units": "s"})
    attributes: dict[str, Any] = {**description(recording.layout, recording.header), **conclusion(recording.outcome)}
    attributes["faults"] = "\n".join(map(str, recording.faults))
    data: xarray.Dataset = xr.Dataset(variables, {"time": time, **scales}, attributes)
    return data


def _xarray(wanted_by: str) -> Any:
    try:
        import xarray
    except ImportError as error:
        raise MissingPackageError.of_extra("xarray", wanted_by, "data") from error
    return xarray


def _variable(xr: Any, dimensions: tuple[str, ...], quantity: Quantity) -> Any:
    return xr.Variable(dimensions, quantity.values, {"units": quantity.unit, "long_name": quantity.meaning})


def _lazy(xr: Any, recording: Recording, first: Quantity) -> Any:
    """Make a variable whose numbers are read from the disk, or computed from what is, when they are asked for."""
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

    about = {"units": first.unit, "long_name": first.meaning}
    return xr.Variable(("time", *first.dimensions), LazilyIndexedArray(Stored()), about)


class Labels(NamedTuple):
    """Labelled arrays, as xarray and netCDF have them.

    Attributes:
        variables: by name, the names of the dimensions, the values, and attributes as `units`.
        coordinates: likewise; one that is named as a dimension has its entries.
        attributes: of the whole.
    """

    variables: dict[str, tuple[tuple[str, ...], Any, dict[str, str]]]
    coordinates: dict[str, tuple[tuple[str, ...], Any, dict[str, str]]]
    attributes: dict[str, Any]


def batch_dataset(batch: Batch, labels: Labels | None = None) -> xarray.Dataset:
    """Convert a batch; its docstring is that of `Batch.to_xarray`.

    Args:
        batch: the batch.
        labels: its own if not given.
    """
    xr = _xarray("Batch.to_xarray")
    if labels is None:
        labels = batch_labels(batch)
    variables, scales = (
        {name: xr.Variable(*each) for name, each in part.items()} for part in (labels.variables, labels.coordinates)
    )
    data: xarray.Dataset = xr.Dataset(variables, scales, labels.attributes)
    return data


def batch_labels(batch: Batch) -> Labels:
    """Label the arrays of a batch."""
    grid, scales = grid_of(batch)
    names = {} if batch.layout is None else coordinates(batch.layout)
    meaning = {"long_name": "tick of the first fault; -1: none"}
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
    """Name a batch's axes, and give the values of each key along its own; with `zip` all keys have one, `variant`."""
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
    """Collect what is one number in every summary, of the grid's shape; None is NaN."""
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
        raise InputError("keep", "recordings", "recordings of the same columns and length", "convert them one by one")
    return {
        name: (
            (*grid, "time", *each.dimensions),
            np.array([table[name].values for table in tables]).reshape(*batch.shape, *each.values.shape),
            {"units": each.unit, "long_name": each.meaning},
        )
        for name, each in first.items()
    }
