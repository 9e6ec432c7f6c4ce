"""A kernel by itself as machine code, called as the function that it is made from."""

from __future__ import annotations

import ast
from collections.abc import Callable
from functools import cache
from inspect import signature
from types import FunctionType
from typing import Any

import numpy as np

from graspfx.compile.native import Native
from graspfx.compile.native import compiled as program
from graspfx.compile.specialise import Program
from graspfx.compile.values import Later, Memory, Several

NUMBERS = ("int", "float", "bool")  # annotations of a kernel's numbers; its other parameters are buffers


class Machine:
    """`kernel(...)` compiled: the same arguments, of which buffers are arrays or memoryviews of floats.

    It gives what the kernel gives, numbers as floats. The interpreter's lock is let go of meanwhile.
    """

    def __init__(self, kernel: FunctionType) -> None:
        self._parameters = [(p.name, str(p.annotation)) for p in signature(kernel).parameters.values()]
        numbers = [name for name, kind in self._parameters if kind in NUMBERS]
        made = Program({})
        given = [
            Later(ast.Name(name, ast.Load())) if name in numbers else Memory(name, 0) for name, _ in self._parameters
        ]
        result = made.add(kernel, given).result
        self._results = 0 if result is None else len(result.parts) if isinstance(result, Several) else 1
        call = f"{kernel.__name__}({', '.join(name for name, _ in self._parameters)})"
        kept = ", ".join(f"results_[{k}]" for k in range(self._results))
        text = f"def entry({', '.join(numbers)}):\n    {kept + ' = ' if kept else ''}{call}"
        buffers = {name: Memory(name, 0) for name, _ in self._parameters if name not in numbers}
        names = {kernel.__name__: kernel, "results_": Memory("results_", 0), **buffers}
        made.add_text(text, names, [Later(ast.Name(name, ast.Load())) for name in numbers])
        floats = [name for name, kind in self._parameters if kind == "float"]
        self._native: Native = program(made.source(), floats)

    def bound(self, *arguments: Any) -> Callable[[], object]:
        """The kernel on these arguments, as often as it is called; what it gives is not handed on."""
        return self._bound(arguments, np.empty(max(self._results, 1)))[0]

    def __call__(self, *arguments: Any) -> Any:
        results = np.empty(max(self._results, 1))
        self._bound(arguments, results)[1]()
        if self._results > 1:
            return tuple(results.tolist())
        return float(results[0]) if self._results else None

    def _bound(self, arguments: tuple[Any, ...], results: Any) -> tuple[Callable[[], object], Callable[[], object]]:
        given = {name: value for (name, _), value in zip(self._parameters, arguments, strict=True)}
        bound = self._native.bind(*({**given, "results_": results}[name] for name in self._native.arrays))
        numbers = [given[name] for name, kind in self._parameters if kind in NUMBERS]
        if not numbers:
            return bound.brief, bound.long
        return lambda: bound.brief(*numbers), lambda: bound.long(*numbers)


@cache
def compiled(kernel: Any) -> Machine:
    """A kernel and all that it calls as machine code, from the cache if it was compiled before.

    Raises:
        MissingPackageError: no LLVM.
        InputError: it holds what a kernel may not hold.
    """
    return Machine(kernel)
