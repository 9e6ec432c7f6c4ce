"""Partial evaluation of kernels: folds known arguments, and removes unreachable code.

Kernels may use numbers, flat buffers and their entries, `if`, `while`, `for ... in range(...)`, calls of other kernels,
of `math` and of a few builtins, and tuples that are returned or unpacked. Every call is specialised for its known
arguments. Arithmetic is never reordered, so the program computes the same bits as the kernels.
"""

from __future__ import annotations

import ast
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import FunctionType
from typing import Any

from graspfx.compile.kernel import source_function
from graspfx.compile.specialise.definitions import definition
from graspfx.compile.specialise.specialise_expressions import Kernel, SpecialisedKernel
from graspfx.compile.specialise.specialise_statements import Body
from graspfx.compile.specialise.syntax import nodes, place
from graspfx.compile.specialise.values import Memory, Static, Value
from graspfx.errors import InputError

DEEPEST = 100  # largest depth of nested calls


@dataclass
class Program:
    """Functions in the order of their definition, the last one the entry, with known values removed.

    Args:
        unroll: Largest number of statements of an unrolled loop, including those of called kernels.
    """

    unroll: int = 0
    functions: list[ast.FunctionDef] = field(default_factory=list)
    files: set[str] = field(default_factory=set)  # source files of the kernels
    numbers_of_modules: dict[tuple[str, str], str] = field(default_factory=dict)  # by module and name
    _specialised: dict[Any, SpecialisedKernel | None] = field(default_factory=dict)
    _first: str = ""  # array of the functions that have only one

    def add(self, function: FunctionType, arguments: Sequence[Value]) -> SpecialisedKernel:
        """Specialise the function for these arguments; dynamic ones become its parameters.

        Calls with one array share the function made for the first such array.
        """
        function = source_function(function)
        arrays = list(dict.fromkeys(a.array for a in arguments if isinstance(a, Memory)))
        self._first = self._first or next(iter(arrays), "")
        first = {array: self._first if len(arrays) == 1 else array for array in arrays}
        actual = {alike: array for array, alike in first.items()}
        arguments = [Memory(first[a.array], a.base) if isinstance(a, Memory) else a for a in arguments]
        specialised = self._add(function, arguments)
        return replace(specialised, arrays=tuple(actual[array] for array in specialised.arrays))

    def _add(self, function: FunctionType, arguments: Sequence[Value]) -> SpecialisedKernel:
        key = (
            function,
            tuple(a.key if isinstance(a, Static) else a if isinstance(a, Memory) else None for a in arguments),
        )
        code = function.__code__
        if key not in self._specialised and list(self._specialised.values()).count(None) < DEEPEST:
            self._specialised[key] = None
            self.files.update(getattr(function, "__source_files__", (code.co_filename,)))
            written = getattr(function, "__written__", None)
            kernel = Kernel(definition(function), function.__globals__, code.co_filename, written)
            new = self._make(kernel, arguments, f"{function.__name__}_{len(self._specialised)}")
            source = (written or function).__code__
            vars(new.node).update(origin=(source.co_filename, source.co_firstlineno), written=written)
            self._specialised[key] = new
        specialised = self._specialised.get(key)
        if specialised is None:
            place = f"{code.co_filename}:{code.co_firstlineno}"
            raise InputError(place, function.__qualname__, "a kernel without recursion")
        return specialised

    def add_text(self, text: str, namespace: Mapping[str, Any], arguments: Sequence[Value]) -> SpecialisedKernel:
        """Specialise the function that a text defines; its names refer to kernels, buffers, modules and numbers."""
        [tree] = ast.parse(text).body
        assert isinstance(tree, ast.FunctionDef)
        return self._make(Kernel(tree, namespace, f"<{tree.name}>"), arguments, tree.name)

    def _make(self, kernel: Kernel, arguments: Sequence[Value], name: str) -> SpecialisedKernel:
        specialised = Body(self, kernel, arguments).specialise(name)
        self.functions.append(specialised.node)
        return specialised

    def source(self, entries: Collection[str] = ()) -> str:
        """Return the program as Python text, with the given entries or, by default, the last function."""
        lines = ["import math", "", "inf, nan = math.inf, math.nan", ""]
        return "\n".join([*lines, *(ast.unparse(node) + "\n" for node in self.definitions(entries))])

    def definitions(self, entries: Collection[str] = ()) -> list[ast.FunctionDef]:
        """List the functions that the entries need, each before its callers."""
        called = set(entries) or {self.functions[-1].name}
        reachable = []
        for node in reversed(self.functions):  # without functions only called by a loop that was not unrolled
            if node.name in called:
                reachable.append(node)
                called.update(n.id for n in nodes([node]) if isinstance(n, ast.Name))
                place(node)
        return reachable[::-1]
