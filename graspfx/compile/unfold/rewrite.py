"""Stages as functions that write programs, made once for each process or read from the disk cache."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import FunctionType
from typing import Any

from graspfx.compile.lower.store import Lowering, store
from graspfx.compile.unfold.stage import is_changed
from graspfx.errors import InputError


@cache
def rewrite(function: FunctionType) -> Callable[..., Any]:
    """Give the function of a frame and a stage's arguments that writes the stage down (`rewriter`).

    Raises:
        InputError: the stage holds something that no stage can, or its file has changed since it was imported.
    """
    file, line = function.__code__.co_filename, function.__code__.co_firstlineno
    if is_changed(file):
        expected = "the file as it was imported"
        raise InputError(f"{file}:{line}", function.__qualname__, expected, "it has changed since: start anew")
    lowering = store().find(function)
    if lowering is None:
        from graspfx.compile.unfold.rewriter import rewrite_code  # only for a stage that is not in the cache

        lowering = Lowering("", rewrite_code(function), {}, (file,))
        store().add(function, lowering)
    names: dict[str, Any] = {}
    exec(lowering.code, function.__globals__, names)
    result: Callable[..., Any] = names[function.__name__]
    return result


def keep_stages() -> None:
    """Write rewritten stages to the disk cache, so that the next process need not rewrite them."""
    store().save()
