"""A kernel as machine code in this process, made by numba when first asked for."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import FunctionType
from typing import Any


@cache
def compiled(kernel: Any) -> Callable[..., Any]:
    """The kernel and the functions that it calls as machine code, which lets go of the interpreter's lock."""
    import numba

    named = {name: kernel.__globals__.get(name) for name in kernel.__code__.co_names}
    calls = {name: compiled(called) for name, called in named.items() if isinstance(called, FunctionType)}
    twin = FunctionType(kernel.__code__, kernel.__globals__ | calls)
    machine_code: Callable[..., Any] = numba.njit(nogil=True, error_model="numpy")(twin)
    return machine_code
