"""Quantities of a recording as named arrays: what it exports, with dimensions, units and meanings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import RecordingError
from graspfx.loop.columns import Column, Layout
from graspfx.recording.record import Recording

ENERGIES = {  # attributes of a recording by finger that are no columns of it
    "internal_energy": "work done so far on the fingertip by the displayed force's internal part",
    "external_energy": "work done so far on the fingertip by the displayed force's external part",
}


class Quantity(NamedTuple):
    """One quantity of all ticks: its array (N, ...), the names of its dimensions without time, its unit and meaning."""

    name: str
    values: NDArray[Any]
    dimensions: tuple[str, ...]
    unit: str
    meaning: str


def works_of(recording: Recording) -> dict[str, NDArray[Any]]:
    """Give what is added up over a recording, by its name; empty where it cannot be told."""
    values = {name: _derived(recording, name) for name in ENERGIES}
    return {name: each for name, each in values.items() if each is not None}


def quantities(recording: Recording, works: Mapping[str, NDArray[Any]] | None = None) -> Iterator[Quantity]:
    """List the columns of a recording, those of its objects together, and what follows from them.

    A column `objects/NAME/position` is `object_position` with a dimension `object`; an object that lacks a column which
    another has gets NaN.

    Args:
        recording: all of it, or a part.
        works: `works_of` the whole in the rows of a part, as it is added up from the beginning.
    """
    layout = recording.layout
    for column in layout.columns.values():
        if not column.name.startswith("objects/"):
            yield Quantity(
                column.name.replace("/", "_"),
                _stored(recording, column),
                column.dimensions,
                column.unit,
                column.meaning,
            )
    for column in layout.derived:
        if (values := _derived(recording, column.name)) is not None:
            yield Quantity(column.name, values, column.dimensions, column.unit, column.meaning)
    for name, meaning in ENERGIES.items():
        values = _derived(recording, name) if works is None else works.get(name)
        if values is not None:
            yield Quantity(name, values, ("finger",), "J", meaning)
    for part, column in parts_of_objects(layout).items():
        values = np.stack([_of_object(recording, name, part, column) for name in layout.objects], axis=1)
        yield Quantity(object_name(part), values, ("object", *column.dimensions), column.unit, column.meaning)


def rows_of(recording: Recording, name: str, first: int, stop: int) -> NDArray[Any]:
    """Give one of the `quantities` in some rows, of which nothing else is read than what it follows from."""
    columns = {column.name.replace("/", "_"): column for column in recording.layout.columns.values()}
    if name in ENERGIES:  # added up from the beginning
        return np.asarray(_derived(recording, name))[first:stop]
    if name in columns:
        return columns[name].typed(recording.read(columns[name].name, first, stop))
    for part, like in parts_of_objects(recording.layout).items():
        if object_name(part) == name:
            own = (recording.layout.columns.get(f"objects/{thing}/{part}") for thing in recording.layout.objects)
            nothing = np.full((stop - first, *like.shape), np.nan)
            return np.stack(
                [nothing if each is None else each.typed(recording.read(each.name, first, stop)) for each in own],
                axis=1,
            )
    source = recording if (first, stop) == (0, len(recording)) else recording.part(first, stop)
    return np.asarray(getattr(source, name))


def coordinates(layout: Layout) -> dict[str, tuple[str, ...]]:
    """Name the entries along each dimension, time apart."""
    return {**layout.scales, "object": layout.objects}


def parts_of_objects(layout: Layout) -> Mapping[str, Column]:
    """List what objects' columns are called below their names, as in `energy/work`, with the first of each."""
    parts: dict[str, Column] = {}
    for column in layout.columns.values():
        if column.name.startswith("objects/"):
            parts.setdefault(column.name.split("/", 2)[2], column)
    return parts


def object_name(part: str) -> str:
    """Name the quantity of all objects that a part of one object's columns belongs to."""
    return "object_" + part.replace("/", "_")


def components(quantity: Quantity, names: Mapping[str, tuple[str, ...]]) -> Iterator[tuple[str, NDArray[Any]]]:
    """List a quantity's columns (N,) one by one, as `finger_force.thumb.x`."""
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
    except RecordingError:  # of an earlier format, which does not say how
        return None
    return values


def _of_object(recording: Recording, name: str, part: str, like: Column) -> NDArray[Any]:
    own = recording.layout.columns.get(f"objects/{name}/{part}")
    return np.full((len(recording), *like.shape), np.nan) if own is None else _stored(recording, own)
