"""Registration of a compiled kernel as a symbol that other machine code can call."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from inspect import signature
from typing import Any

from graspfx.compile import cache as disk
from graspfx.compile.emission import emitted, loaded, platform, show
from graspfx.compile.kernel import source_function


@cache
def symbol_of(kernel: Callable[..., Any], types: tuple[str, ...]) -> str:
    """Load the machine code of a kernel for the given argument types; return the name of the symbol.

    Args:
        kernel: Kernel function.
        types: LLVM types of the kernel's arguments: `ptr` for a buffer, `i64`, `double`.

    Raises:
        MissingPackageError: If LLVM is not installed.
        InputError: If the kernel has unsupported statements.
    """
    from graspfx.compile.llvm.llvm import function_text
    from graspfx.compile.program import Program

    function = source_function(kernel)
    names = ", ".join([*signature(function).parameters][: len(types)])
    program = Program()
    program.add_text(f"def run({names}):\n    return kernel({names})", {"kernel": kernel})
    symbol = f"graspfx.{function.__module__}.{function.__name__}"
    text = function_text(program.source(), symbol, types)
    key = hashlib.sha256("\0".join([*platform(), "symbol", text.text]).encode()).hexdigest()
    machine = disk.load(key)
    if machine is None:
        machine = emitted(text.text)
        disk.store(key, machine)
    show(loaded([machine], text.libm), [symbol])
    return symbol
