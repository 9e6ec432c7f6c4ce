"""Decorators of kernels and inlined functions, and the kinds of a kernel's parameters."""

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
    """Decorate a function that is inlined into kernels. It must consist of assignments and one return statement."""
    setattr(function, INLINE, True)
    return function


def bound_late(function: F) -> F:
    """Decorate a function that compiled programs define by themselves and that interpreted programs call.

    The arguments of the function must be buffers and numbers, and its result an integer.
    """
    setattr(function, BOUND_LATE, True)
    return function


def written(function: F) -> F:
    """Return the original function of a kernel; any other function is returned unchanged."""
    return cast("F", getattr(function, LOWERED, function))


@cache
def parameter_kinds(function: FunctionType) -> dict[str, Any]:
    """Return the annotated kind of each parameter, in order, and of `return`; `float` if there is no annotation."""
    hints = get_type_hints(function, include_extras=True)
    code = function.__code__
    kinds = {name: hints.get(name, float) for name in code.co_varnames[: code.co_argcount]}
    return {**kinds, "return": hints.get("return", float)}


def optional(kind: Any) -> tuple[Any, bool]:
    """Return X and True for a kind `X | None`; for any other kind, the kind itself and False."""
    if get_origin(kind) in (Union, UnionType):
        rest = [k for k in get_args(kind) if k is not type(None)]
        if len(rest) == 1 and len(rest) < len(get_args(kind)):
            return rest[0], True
    if get_origin(kind) is Annotated:
        return get_args(kind)[0], False
    return kind, False
