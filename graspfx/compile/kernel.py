"""Kernels: functions of records and values, which are also lowered to functions of numbers and buffers."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, update_wrapper
from types import FunctionType
from typing import Any, cast, get_args, get_origin

from graspfx.compile.kernel_marks import LOWERED, F, inline, optional, parameter_kinds, written
from graspfx.compile.records import SCALARS, Floats, Many, Record, Table, is_value, parts_of

__all__ = ["call", "inline", "keep_lowerings", "kernel", "source_function", "written"]


def kernel(function: F) -> F:
    """Decorate a function of records and values as a kernel.

    A call of the kernel from Python executes the lowered function. `written(kernel)` returns the original function.
    """
    assert isinstance(function, FunctionType)
    original = function

    def run(*arguments: Any, **keywords: Any) -> Any:
        return call(original, arguments, keywords)

    update_wrapper(run, original)
    setattr(run, LOWERED, original)
    return cast("F", run)


def source_function(function: Callable[..., Any]) -> FunctionType:
    """Return the lowered function of a kernel, which takes numbers and buffers; other functions are unchanged."""
    original = getattr(function, LOWERED, None)
    return cast("FunctionType", function) if original is None else _lowered(original)


@cache
def _lowered(function: FunctionType) -> FunctionType:
    from graspfx.compile.lower.lowering import lowered  # imported on demand

    return lowered(function)


def keep_lowerings() -> None:
    """Write the kernels that this process has lowered to the disk cache."""
    if _lowered.cache_info().currsize:
        from graspfx.compile.lower.lowering import store

        store().save()


def call(function: FunctionType, arguments: tuple[Any, ...], keywords: dict[str, Any]) -> Any:
    """Call the lowered function of a kernel with arguments of the original function, and convert the result.

    A record is passed as a buffer and an offset, and a value as its numbers. Arguments that are already buffers and
    numbers are passed unchanged, and the result is not converted.
    """
    run = _lowered(function)
    kinds = parameter_kinds(function)
    if len(arguments) + len(keywords) > len(kinds) - 1 or _is_flat(arguments, kinds):
        return run(*arguments, **keywords)  # arguments are numbers and buffers already
    order = list(kinds)[:-1]
    flat: list[Any] = []
    values = {**dict(zip(order, arguments, strict=False)), **keywords}
    blank = next((a.buffer for a in values.values() if isinstance(a, Record | Floats | Table | Many)), None)
    for name in order:
        if name not in values:
            break  # numbers with defaults come last
        flat += _flat(values[name], kinds[name], blank)
    return _whole(run(*flat), kinds["return"])


def _is_flat(arguments: tuple[Any, ...], kinds: dict[str, Any]) -> bool:
    """Return whether an argument is a buffer although the kernel's parameter is a record or a value."""
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
    """Convert the numbers that a lowered function returns to a result of the kind of the original function."""
    if get_origin(kind) is tuple:
        rest = list(result)
        return tuple(_take(part, rest) for part in get_args(kind))
    return _take(kind, list(result)) if is_value(kind) else result


def _take(kind: Any, rest: list[Any]) -> Any:
    if is_value(kind):
        return kind(*(_take(part, rest) for part in parts_of(kind).values()))
    return rest.pop(0)
