"""Kernels: functions on records and values, which run as they are written, or lowered to numbers and entries."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, update_wrapper
from types import FunctionType, UnionType
from typing import Annotated, Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from graspfx.compile.records import SCALARS, Floats, Many, Record, Table, is_value, parts_of

INLINE = "__inline__"  # mark of a function that is written out where it is called
LOWERED = "__kernel__"  # attribute of a kernel: the function as it is written


F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Mark a function on records and values as a kernel.

    Called from Python it runs lowered; `written(kernel)` is the function as it stands.
    """
    assert isinstance(function, FunctionType)
    original = function

    def run(*arguments: Any, **named: Any) -> Any:
        return call(original, arguments, named)

    update_wrapper(run, original)
    setattr(run, LOWERED, original)
    return cast("F", run)


def inline(function: F) -> F:
    """Mark a function of a few assignments and a return: it is written out where a kernel calls it."""
    setattr(function, INLINE, True)
    return function


def written(function: F) -> F:
    """Give a kernel's function as it stands in its file."""
    return cast("F", getattr(function, LOWERED, function))


def source_function(function: Callable[..., Any]) -> FunctionType:
    """Give the function on numbers and entries that is specialised, and that interpreted runs execute."""
    original = getattr(function, LOWERED, None)
    if original is None:
        assert isinstance(function, FunctionType)
        return function
    return _lowered(original)


@cache
def _lowered(function: FunctionType) -> FunctionType:
    from graspfx.compile.lower.lowering import lowered  # only where a kernel is asked for

    return lowered(function)


def call(function: FunctionType, arguments: tuple[Any, ...], named: dict[str, Any]) -> Any:
    """Call a kernel from Python: records as buffer and offset, values as their numbers."""
    run = _lowered(function)
    kinds = parameter_kinds(function)
    if len(arguments) + len(named) > len(kinds) - 1 or _is_flat(arguments, kinds):
        return run(*arguments, **named)  # numbers and buffers already
    order = list(kinds)[:-1]
    flat: list[Any] = []
    given = {**dict(zip(order, arguments, strict=False)), **named}
    blank = next((a.buffer for a in given.values() if isinstance(a, Record | Floats | Table | Many)), None)
    for name in order:
        if name not in given:
            break  # numbers with defaults come last
        flat += _flat(given[name], kinds[name], blank)
    return _whole(run(*flat), kinds["return"])


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


def _is_flat(arguments: tuple[Any, ...], kinds: dict[str, Any]) -> bool:
    """Tell whether a buffer is given where a kernel expects a record."""
    views = (Record, Floats, Table, Many, type(None))
    return any(
        optional(kind)[0] not in SCALARS and not isinstance(a, views) and not is_value(type(a))
        for a, kind in zip(arguments, kinds.values(), strict=False)
        if kind is not Any
    )


def _flat(value: Any, kind: Any, blank: Any) -> list[Any]:
    if value is None:
        kind = optional(kind)[0]
        return [blank, -1, *([0] * (2 if get_origin(kind) is Many else kind is Table))]
    if isinstance(value, Record | Floats):
        return [value.buffer, value.offset]
    if isinstance(value, Table):
        return [value.buffer, value.offset, value.columns]
    if isinstance(value, Many):
        return [value.buffer, value.offset, value.stride, value.count]
    if is_value(type(value)):
        return [number for part in parts_of(type(value)) for number in _flat(getattr(value, part), None, blank)]
    return [value]


def _whole(result: Any, kind: Any) -> Any:
    """A kernel's numbers as the values that it returns."""
    if get_origin(kind) is tuple:
        rest = list(result)
        return tuple(_take(part, rest) for part in get_args(kind))
    return _take(kind, list(result)) if is_value(kind) else result


def _take(kind: Any, rest: list[Any]) -> Any:
    if is_value(kind):
        return kind(*(_take(part, rest) for part in parts_of(kind).values()))
    return rest.pop(0)
