"""Scenes as data: an object that cannot be written into a recording is named by its key."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic_core import PydanticSerializationError, to_jsonable_python

from graspfx.errors import InputError

EXPECTED = "numbers, texts, lists and tables: a recording has its whole scene as data"
DO = "make it in a driver of your own, a Python file whose `connect` takes settings (docs/how-to/device.md)"


def not_data(table: Any) -> InputError:
    """Make the error of a scene's table with an object that cannot be written as data."""
    return next((InputError(key, value, EXPECTED, DO) for key, value in _leaves(table, "") if not _is_data(value)),
                InputError("scene", table, EXPECTED, DO))  # fmt: skip


def _is_data(value: object) -> bool:
    try:
        to_jsonable_python(value)
    except PydanticSerializationError:
        return False
    return True


def _leaves(value: Any, key: str) -> Iterator[tuple[str, Any]]:
    """List all that is no table and no list, with its key."""
    if isinstance(value, Mapping):
        items = [(str(name), each) for name, each in value.items()]
    elif isinstance(value, list | tuple):
        items = [(str(i), each) for i, each in enumerate(value)]
    else:
        yield key, value
        return
    for name, each in items:
        yield from _leaves(each, f"{key}.{name}" if key else name)
