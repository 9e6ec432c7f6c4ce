"""A kernel with everything that it calls as machine code, for the duration of a process."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import FunctionType, ModuleType
from typing import Any


def compiled(kernel: Any) -> Callable[..., Any]:
    """The compiled twin of a kernel: the same source, its callees compiled too, also those named through a module."""
    twin: Callable[..., Any] = _twin(kernel)
    return twin


@cache
def _twin(kernel: FunctionType) -> Any:
    import numba

    known = kernel.__globals__
    named = {name: known[name] for name in kernel.__code__.co_names if name in known}
    twins = {name: _twin(value) for name, value in named.items() if isinstance(value, FunctionType)}
    modules = {
        name: _twin_module(value)
        for name, value in named.items()
        if isinstance(value, ModuleType) and value.__name__.startswith("graspfx.")
    }
    return numba.njit(error_model="numpy")(FunctionType(kernel.__code__, known | twins | modules))


@cache
def _twin_module(module: ModuleType) -> ModuleType:
    """A module of constants and kernels, its kernels compiled when they are first asked for by name."""
    twin = ModuleType(module.__name__)
    for name, value in vars(module).items():
        own = isinstance(value, FunctionType) and value.__module__ == module.__name__
        setattr(twin, name, _twin(value) if own else value)
    return twin
