"""Kernels as they are written, run by Python itself."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FunctionType

from graspfx.compile.kernel import written


@contextmanager
def plain_python() -> Iterator[None]:
    """Let kernels that are called by name run as they are written, in every module that is loaded."""
    modules = [module for name, module in sys.modules.items() if name.startswith("graspfx.")]
    lowered = [
        (module, name, member)
        for module in modules
        for name, member in list(vars(module).items())
        if isinstance(member, FunctionType) and hasattr(member, "__kernel__")
    ]
    try:
        for module, name, member in lowered:
            setattr(module, name, written(member))
        yield
    finally:
        for module, name, member in lowered:
            setattr(module, name, member)
