"""Stages: functions over parts that are unfolded into programs, and also run as they stand."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any, TypeVar

from graspfx.errors import InputError

FRAME = "_frame"  # the name under which a rewritten stage knows what it writes to

Stage = TypeVar("Stage", bound=Callable[..., Any])


def stage(function: Stage) -> Stage:
    """Mark a function that is unfolded where another stage calls it."""
    function.is_stage = True  # type: ignore[attr-defined] # a function takes any attribute
    _stamp(function.__code__.co_filename)
    return function


@cache
def rewritten(function: FunctionType) -> Callable[..., Any]:
    """Give the function of a frame and a stage's arguments that writes the stage down (`rewriter`).

    Raises:
        InputError: the stage holds something that no stage can, or its file has changed since it was imported.
    """
    from graspfx.compile.lower.store import Lowering, store  # only where something is unfolded

    file, line = function.__code__.co_filename, function.__code__.co_firstlineno
    if _changed(file) != _stamp(file):
        expected = "the file as it was imported"
        raise InputError(f"{file}:{line}", function.__qualname__, expected, "it has changed since: start anew")
    known = store().find(function)
    if known is None:
        from graspfx.compile.unfold.rewriter import rewritten_code  # only for a stage that is not in the cache

        known = Lowering("", rewritten_code(function), {}, (file,))
        store().add(function, known)
    names: dict[str, Any] = {}
    exec(known.code, function.__globals__, names)
    result: Callable[..., Any] = names[function.__name__]
    return result


def keep_stages() -> None:
    """Write rewritten stages to the disk cache, so that the next process need not rewrite them."""
    from graspfx.compile.lower.store import store

    store().save()


@cache
def _stamp(file: str) -> tuple[int, int]:
    """Time and size of a file when a stage of it was marked first."""
    return _changed(file)


def _changed(file: str) -> tuple[int, int]:
    try:
        status = Path(file).stat()
    except OSError:
        return 0, 0
    return status.st_mtime_ns, status.st_size
