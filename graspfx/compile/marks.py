"""Marks of kernels and of functions that are written out in them, and the kinds of their parameters."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import FunctionType, UnionType
from typing import Annotated, Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

INLINE = "__inline__"  # mark of a function that is written out where it is called
LOWERED = "__kernel__"  # attribute of a kernel: the function as it is written
BOUND_LATE = "__bound_late__"  # mark of a function that a program defines in its own way

F = TypeVar("F", bound=Callable[..., Any])


def inline(function: F) -> F:
    """Mark a function of a few assignments and a return: it is written out where a kernel calls it."""
    setattr(function, INLINE, True)
    return function


def bound_late(function: F) -> F:
    """Mark a function of buffers and numbers that gives a whole number, and that a compiled program defines itself.

    Calls of it stay calls by its name; interpreted, the function runs as it is.
    """
    setattr(function, BOUND_LATE, True)
    return function


def written(function: F) -> F:
    """Give a kernel's function as it stands in its file."""
    return cast("F", getattr(function, LOWERED, function))


@cache
def parameter_kinds(function: FunctionType) -> dict[str, Any]:
    """Give the kinds of a function's parameters, in order, and that of its `return`; of numbers where none is said."""
    hints = get_type_hints(function, include_extras=True)
    code = function.__code__
    kinds = {name: hints.get(name, float) for name in code.co_varnames[: code.co_argcount]}
    return {**kinds, "return": hints.get("return", float)}


def optional(kind: Any) -> tuple[Any, bool]:
    """Split `X | None` into X and whether None is allowed."""
    if get_origin(kind) in (Union, UnionType):
        rest = [k for k in get_args(kind) if k is not type(None)]
        if len(rest) == 1 and len(rest) < len(get_args(kind)):
            return rest[0], True
    if get_origin(kind) is Annotated:
        return get_args(kind)[0], False
    return kind, False
