"""Recordings and batches as tables: a row per tick or variant, a column per component; pandas and CSV."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError, MissingPackageError
from graspfx.recording.files import placing, recording_path, require_vacancy
from graspfx.show.labelled import summary_numbers
from graspfx.show.quantities import Quantity, components, coordinates, quantities, works_of

if TYPE_CHECKING:
    from graspfx.batch.batch import Batch
    from graspfx.recording.record import Recording

BLOCK = 1000  # rows that are written at once


def recording_frame(recording: Recording) -> Any:
    """Convert a recording; its docstring is that of `Recording.to_frame`."""
    pandas = _pandas("Recording.to_frame")
    frame = pandas.DataFrame(dict(_columns(recording)), index=pandas.Index(recording.time, name="time"))
    frame.attrs = {"scene": recording.header.scene, "units": {each.name: each.unit for each in quantities(recording)}}
    return frame


def batch_frame(batch: Batch) -> Any:
    """Convert a batch; its docstring is that of `Batch.to_frame`."""
    pandas = _pandas("Batch.to_frame")
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
    """Write a recording; its docstring is that of `Recording.to_csv`."""
    place = recording_path(path, "path")
    if not place.name:
        raise InputError("path", str(path), "the path of a file, such as recording.csv")
    if not overwrite:
        require_vacancy([place])
    with placing(place) as draft, draft.open("w", encoding="utf-8", newline="") as file:
        file.writelines(csv_lines(recording))


def csv_lines(recording: Recording) -> Iterator[str]:
    """Write the lines of a CSV file, RFC 4180: numbers by the shortest digits that read back the same.

    Names of fingers and objects have no commas or quotes.
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


def _pandas(wanted_by: str) -> Any:
    try:
        import pandas
    except ImportError as error:
        raise MissingPackageError.of_extra("pandas", wanted_by, "data") from error
    return pandas
