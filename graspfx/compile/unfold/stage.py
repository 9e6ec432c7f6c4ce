"""Stages: functions over parts that are unfolded into programs, and also run as they stand."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

FRAME = "_frame"  # the name under which a rewritten stage knows what it writes to

Stage = TypeVar("Stage", bound=Callable[..., Any])


def stage(function: Stage) -> Stage:
    """Mark a function that is unfolded where another stage calls it."""
    function.is_stage = True  # type: ignore[attr-defined] # a function takes any attribute
    _stamp(function.__code__.co_filename)
    return function


def is_changed(file: str) -> bool:
    """Tell whether a file has changed since a stage of it was marked."""
    return _status(file) != _stamp(file)


@cache
def _stamp(file: str) -> tuple[int, int]:
    """Give time and size of a file when a stage of it was first marked."""
    return _status(file)


def _status(file: str) -> tuple[int, int]:
    try:
        status = Path(file).stat()
    except OSError:
        return 0, 0
    return status.st_mtime_ns, status.st_size
