"""Marks of kernels and of inlined functions, and the kinds of their parameters."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import FunctionType, UnionType
from typing import Annotated, Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

INLINE = "__inline__"  # mark of an inlined function
LOWERED = "__kernel__"  # attribute of a kernel: the original function
BOUND_LATE = "__bound_late__"  # mark of a function that a program defines itself

F = TypeVar("F", bound=Callable[..., Any])


def inline(function: F) -> F:
    """Mark a function for inlining into kernels; it must consist only of assignments and a return."""
    setattr(function, INLINE, True)
    return function


def bound_late(function: F) -> F:
    """Mark a function of buffers and numbers with an integer result that compiled programs define themselves.

    Calls of the function remain calls by name. Interpreted programs run the function itself.
    """
    setattr(function, BOUND_LATE, True)
    return function


def written(function: F) -> F:
    """Return a kernel's original function."""
    return cast("F", getattr(function, LOWERED, function))


@cache
def parameter_kinds(function: FunctionType) -> dict[str, Any]:
    """Return the kinds of a function's parameters, in order, and of its `return`; the default is a number."""
    hints = get_type_hints(function, include_extras=True)
    code = function.__code__
    kinds = {name: hints.get(name, float) for name in code.co_varnames[: code.co_argcount]}
    return {**kinds, "return": hints.get("return", float)}


def optional(kind: Any) -> tuple[Any, bool]:
    """Split `X | None` into X and a flag for None."""
    if get_origin(kind) in (Union, UnionType):
        rest = [k for k in get_args(kind) if k is not type(None)]
        if len(rest) == 1 and len(rest) < len(get_args(kind)):
            return rest[0], True
    if get_origin(kind) is Annotated:
        return get_args(kind)[0], False
    return kind, False
