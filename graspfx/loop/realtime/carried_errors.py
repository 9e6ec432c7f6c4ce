"""Exceptions on their way from one process to another: the same type, the same words, no traceback."""

from __future__ import annotations

import pickle
from typing import Any

from graspfx.errors import GraspFXError, message


def pack(error: BaseException) -> bytes:
    """Write an exception so that `unpack` makes it again; one that cannot be written leaves its words."""
    parts = type(error), error.args, _plain(vars(error))
    try:
        text = pickle.dumps(parts)
        pickle.loads(text)
    except Exception:  # noqa: BLE001 - others' exceptions may hold anything
        return pickle.dumps((GraspFXError, (f"{type(error).__name__}: {message(error)}",), {}))
    return text


def unpack(text: bytes) -> BaseException:
    """Make an exception again."""
    try:
        kind, arguments, values = pickle.loads(text)
    except Exception as error:  # noqa: BLE001 - a type that is only there in the other process
        return GraspFXError(f"the servo's process raised what this one does not know: {message(error)}")
    result: BaseException = kind.__new__(kind)
    result.args = arguments
    vars(result).update(values)
    return result


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    """Leave out attributes that cannot be written."""
    plain = {}
    for name, value in values.items():
        try:
            pickle.dumps(value)
        except Exception:  # noqa: BLE001 - as in `pack`
            value = message(value) if isinstance(value, BaseException) else f"a {type(value).__name__}"
        plain[name] = value
    return plain
