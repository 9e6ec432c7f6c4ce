"""A kernel as machine code in this process, made by numba when first asked for."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import FunctionType, ModuleType
from typing import Any


@cache
def compiled(kernel: Any) -> Callable[..., Any]:
    """The kernel and the functions that it calls, also through a module's name, as machine code.

    It lets go of the interpreter's lock.
    """
    import numba

    named = {name: kernel.__globals__.get(name) for name in kernel.__code__.co_names}
    calls = {name: compiled(called) for name, called in named.items() if isinstance(called, FunctionType)}
    modules = {
        name: _twin(module)
        for name, module in named.items()
        if isinstance(module, ModuleType) and module.__name__.startswith("graspfx.")
    }
    twin = FunctionType(kernel.__code__, kernel.__globals__ | calls | modules)
    machine_code: Callable[..., Any] = numba.njit(nogil=True, error_model="numpy")(twin)
    return machine_code


@cache
def _twin(module: ModuleType) -> ModuleType:
    """A module's names, its own functions compiled."""
    twin = ModuleType(module.__name__)
    for name, value in vars(module).items():
        own = isinstance(value, FunctionType) and value.__module__ == module.__name__
        setattr(twin, name, compiled(value) if own else value)
    return twin
