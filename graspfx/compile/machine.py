"""Machine code of single kernels, with the parameters of the lowered function."""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from functools import partial
from inspect import signature
from operator import is_not
from threading import local
from types import FunctionType
from typing import Any

import numpy as np

from graspfx.compile import library
from graspfx.compile.definitions import definition
from graspfx.compile.emission import require_llvm
from graspfx.compile.kernel import source_function
from graspfx.compile.native import Bound, Native
from graspfx.compile.native import compiled as native
from graspfx.compile.own_sources import footprint, is_ours, note_compiled, was_compiled
from graspfx.compile.program import program_source

_MACHINES: dict[Any, Machine] = {}
NUMBERS = {
    "int": "i64",
    "float": "double",
    "bool": "i64",
}  # annotations of numbers; others are buffers


class Machine:
    """Compiled kernel, which is called with the arguments of the lowered kernel.

    A record is passed as a buffer and an offset. A buffer is an array or a memoryview of floats; the same buffer may be
    passed several times. The result of a call is a float, a tuple of floats, or None.

    Args:
        kernel: Kernel function.
        make: Whether a kernel that is not in the cache is compiled. If False, a LookupError is raised instead.
    """

    def __init__(self, kernel: FunctionType, *, make: bool = True) -> None:
        parameters = [(p.name, str(p.annotation)) for p in signature(source_function(kernel)).parameters.values()]
        self._names = [name for name, kind in parameters if kind not in NUMBERS]
        self._number_places = [k for k, (_, kind) in enumerate(parameters) if kind in NUMBERS]
        self._buffer_places = [k for k, (_, kind) in enumerate(parameters) if kind not in NUMBERS]
        self._last = local()
        self._results = results_of(kernel)
        shipped = library.find(footprint(kernel)) if is_ours(kernel) else None
        self._native: Native = shipped or native(*request_of(kernel, make=make), apart=False, make=make)
        if not was_compiled(kernel):  # sources may have changed without a change of the machine code
            note_compiled(kernel)

    def bound(self, *arguments: Any) -> Callable[[], object]:
        """Return a function without arguments that runs the kernel on the given arguments and returns no result."""
        bound, _ = self._on([arguments[k] for k in self._buffer_places])
        numbers = [arguments[k] for k in self._number_places]
        return partial(bound.brief, *numbers) if numbers else bound.brief

    def on(self, *buffers: Any) -> Callable[..., float]:
        """Return a function of the kernel's numbers and offsets that runs the kernel on the given buffers.

        The function returns the first number of the kernel's result.
        """
        bound, results = self._on(buffers)
        run, result = bound.brief, results.data

        def call(*numbers: float) -> float:
            run(*numbers)
            return float(result[0])

        return call

    def __call__(self, *arguments: Any) -> Any:
        bound, results = self._bound_to(arguments)
        bound.brief(*[arguments[k] for k in self._number_places])
        if self._results > 1:
            return tuple(results.tolist())
        return float(results[0]) if self._results else None

    def once(self, *arguments: Any) -> None:
        """Run the kernel once without returning a result. The interpreter's lock is released meanwhile."""
        bound, _ = self._on([arguments[k] for k in self._buffer_places])
        bound.long(*[arguments[k] for k in self._number_places])

    def _bound_to(self, arguments: Sequence[Any]) -> tuple[Bound, Any]:
        """Bind the program to the buffers among the arguments; return the binding and the array of results.

        If the last call of this thread had the same buffers, its binding is used again.
        """
        buffers = [arguments[k] for k in self._buffer_places]
        last = getattr(self._last, "binding", None)
        if last is None or any(map(is_not, buffers, last[0])):
            last = self._last.binding = buffers, *self._on(buffers)
        return last[1], last[2]

    def _on(self, buffers: Sequence[Any]) -> tuple[Bound, Any]:
        """Bind the program to buffers; return the binding and the array of results."""
        results = np.empty(max(self._results, 1))
        by_name = {**dict(zip(self._names, buffers, strict=True)), "results_": results}
        return self._native.bind(*(by_name[name] for name in self._native.arrays)), results


def request_of(kernel: Any, *, make: bool = True) -> tuple[str, list[str]]:
    """Return the text of the program of one kernel, in Python, and the names of the parameters that are floats.

    Args:
        kernel: Kernel function.
        make: Whether a program that is not in the cache is written. If False, a LookupError is raised instead.

    Raises:
        MissingPackageError: If LLVM is not installed.
    """
    require_llvm()
    parameters = [(p.name, str(p.annotation)) for p in signature(source_function(kernel)).parameters.values()]
    numbers = [name for name, kind in parameters if kind in NUMBERS]
    buffers = [name for name, kind in parameters if kind not in NUMBERS]
    call = f"kernel_({', '.join(name for name, _ in parameters)})"
    targets = ", ".join(f"results_[{k}]" for k in range(results_of(kernel)))
    text = f"def entry({', '.join(numbers)}):\n    {targets + ' = ' if targets else ''}{call}"
    floats = [name for name, kind in parameters if kind == "float"]
    return program_source(text, {"kernel_": kernel}, [*buffers, "results_"], make=make), floats


def results_of(kernel: FunctionType) -> int:
    """Return how many numbers a kernel returns; zero if it returns nothing."""
    counts = {
        len(node.value.elts) if isinstance(node.value, ast.Tuple) else 1
        for node in ast.walk(ast.parse(ast.unparse(definition(source_function(kernel)))))
        if isinstance(node, ast.Return) and node.value is not None
    }
    return max(counts, default=0)


def compiled(kernel: Any, *, make: bool = True) -> Machine:
    """Load the machine code of a kernel from the cache, or compile the kernel and all functions that it calls.

    Args:
        kernel: Kernel function.
        make: Whether a kernel that is not in the cache is compiled. If False, a LookupError is raised instead.

    Raises:
        MissingPackageError: If LLVM is not installed.
        InputError: If the kernel contains statements that cannot be compiled.
    """
    machine = _MACHINES.get(kernel)
    if machine is None:
        machine = _MACHINES.setdefault(kernel, Machine(kernel, make=make))
    return machine
