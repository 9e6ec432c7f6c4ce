"""Grid of a batch: the values of each key, and the combination of each variant."""

from __future__ import annotations

import builtins
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError

IndexArray = NDArray[np.intp]


def grid(
    values: Mapping[str, Sequence[Any] | NDArray[Any]], *, zip: bool
) -> tuple[tuple[int, ...], dict[str, list[Any]], IndexArray]:
    """Return the grid's shape, the values of each key, and the indices of each variant's values."""
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
        raise InputError("values", "duration", "keys of the scene", "pass it as the argument `duration`")
    lengths = [len(items) for items in lists.values()]
    if zip and len(set(lengths)) > 1:
        raise InputError("values", {key: len(items) for key, items in lists.items()}, "lists of equal length with zip")
    alike = [_first_alike(items) for items in lists.values()]
    axes = np.tile(np.arange(lengths[0]), (len(lengths), 1)) if zip else np.indices(lengths).reshape(len(lengths), -1)
    numbers = np.array([same[axis] for same, axis in builtins.zip(alike, axes, strict=True)]).T
    return (lengths[0],) if zip else tuple(lengths), lists, np.ascontiguousarray(numbers)


def _first_alike(items: Sequence[Any]) -> IndexArray:
    """Return for each value the index of the first value with the same text."""
    if all(type(value) is float for value in items):
        _, first, choice = np.unique(np.array(items).view(np.int64), return_index=True, return_inverse=True)
        return np.asarray(first[choice.ravel()])
    written = {repr(value): k for k, value in reversed(list(enumerate(items)))}
    return np.array([written[repr(value)] for value in items])


def _plain(value: Any) -> Any:
    """Convert arrays in a value to lists, because numpy abbreviates the text of arrays."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items()}
    return type(value)(map(_plain, value)) if type(value) in (list, tuple) else value


def as_array(values: Sequence[Any]) -> NDArray[Any]:
    """Convert values to an array, of floats if all are numbers, else of objects."""
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return np.array(values, dtype=float)
    objects = np.empty(len(values), dtype=object)
    objects[:] = list(values)
    return objects


def as_objects(values: Sequence[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    """Put objects in an array of a shape."""
    objects = np.empty(len(values), dtype=object)
    objects[:] = list(values)
    return objects.reshape(shape)
