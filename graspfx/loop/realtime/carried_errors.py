"""Exceptions on their way from one process to another: the same type, the same words, no traceback."""

from __future__ import annotations

import pickle
from contextlib import suppress
from io import BytesIO
from typing import Any

from graspfx.errors import GraspFXError, message


def pack(error: BaseException) -> bytes:
    """Write an exception so that `unpack` makes it again; one that cannot be written leaves its words."""
    error = error.with_traceback(None)
    with suppress(Exception):  # others' exceptions may hold anything
        text = _written(error)
        if type(pickle.loads(text)) is type(error):
            return text
    with suppress(Exception):  # as above
        text = pickle.dumps((type(error), error.args, _plain(vars(error))))
        pickle.loads(text)
        return text
    return pickle.dumps(GraspFXError(f"{type(error).__name__}: {message(error)}"))


def unpack(text: bytes) -> BaseException:
    """Make an exception again."""
    try:
        content = pickle.loads(text)
    except Exception as error:  # noqa: BLE001 - a type that is only there in the other process
        return GraspFXError(f"the servo's process raised what this one does not know: {message(error)}")
    if isinstance(content, BaseException):
        return content
    kind, arguments, values = content
    result: BaseException = kind.__new__(kind)
    result.args = arguments
    vars(result).update(values)
    return result


def _written(error: BaseException) -> bytes:
    """Pickle an exception in its own way: packages such as dask register another one, which loses attributes."""
    text = BytesIO()
    pickler = pickle.Pickler(text, pickle.HIGHEST_PROTOCOL)
    pickler.dispatch_table = {}
    pickler.dump(error)
    return text.getvalue()


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    """Write attributes that are no data by their types alone."""
    plain = {}
    for name, value in values.items():
        try:
            pickle.dumps(value)
        except Exception:  # noqa: BLE001 - as in `pack`
            value = f"a {type(value).__name__}"
        plain[name] = value
    return plain
