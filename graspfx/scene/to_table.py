"""A scene as data: what cannot be written into a recording is named by its key."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel
from pydantic_core import PydanticSerializationError, to_jsonable_python

from graspfx.errors import InputError

EXPECTED = "numbers, texts, lists and tables: a recording has its whole scene as data"
DO = "make it in a driver of your own, a Python file whose `connect` takes settings (docs/how-to/real-board.md)"


def to_table(scene: BaseModel) -> dict[str, Any]:
    """Write a scene as nested tables, without defaults.

    Raises:
        InputError: an object in it that is no data, by its key.
    """
    try:
        table: dict[str, Any] = scene.model_dump(mode="json", exclude_unset=True)
    except PydanticSerializationError as error:
        for key, value in _leaves(scene.model_dump(exclude_unset=True), ""):
            try:
                to_jsonable_python(value)
            except PydanticSerializationError:
                raise InputError(key, value, EXPECTED, DO) from error
        raise InputError("scene", scene, EXPECTED, DO) from error
    return table


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
