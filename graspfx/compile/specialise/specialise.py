"""Partial evaluation of kernels: arguments that are known are folded in, and what they never reach is left out.

The language is the one that kernels are written in: numbers, flat buffers and their entries, `if`, `while`,
`for ... in range(...)`, calls of other kernels, of `math` and of a few builtins, tuples that are returned or unpacked.
Every call is specialised for the arguments that are known where it stands; arithmetic is never reordered, so that a
program computes the same bits as the kernels that it was made from.
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

DEEPEST = 100  # calls inside calls


@dataclass
class Program:
    """Functions in the order in which they are to be defined, the last one the entry; free of what is known.

    Args:
        unroll: most statements of a loop that is written out, those of the kernels that it calls among them.
    """

    unroll: int = 0
    functions: list[ast.FunctionDef] = field(default_factory=list)
    files: set[str] = field(default_factory=set)  # that kernels were taken from
    numbers_of_modules: dict[tuple[str, str], str] = field(default_factory=dict)  # by module and name
    _specialised: dict[Any, SpecialisedKernel | None] = field(default_factory=dict)
    _first: str = ""  # array, whose name functions of one array have

    def add(self, function: FunctionType, arguments: Sequence[Value]) -> SpecialisedKernel:
        """Specialise the function for these arguments; dynamic ones become its parameters.

        Where there is one array, all share what is made for the first.
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
            raise InputError(place, function.__qualname__, "a kernel that does not call itself")
        return specialised

    def add_text(self, text: str, namespace: Mapping[str, Any], arguments: Sequence[Value]) -> SpecialisedKernel:
        """Specialise the function that a text defines; its names are kernels, buffers, modules and numbers."""
        [tree] = ast.parse(text).body
        assert isinstance(tree, ast.FunctionDef)
        return self._make(Kernel(tree, namespace, f"<{tree.name}>"), arguments, tree.name)

    def _make(self, kernel: Kernel, arguments: Sequence[Value], name: str) -> SpecialisedKernel:
        specialised = Body(self, kernel, arguments).specialise(name)
        self.functions.append(specialised.node)
        return specialised

    def source(self, entries: Collection[str] = ()) -> str:
        """Write the program as Python; with entries of these names, of the last function if none is named."""
        lines = ["import math", "", "inf, nan = math.inf, math.nan", ""]
        return "\n".join([*lines, *(ast.unparse(node) + "\n" for node in self.definitions(entries))])

    def definitions(self, entries: Collection[str] = ()) -> list[ast.FunctionDef]:
        """List the functions that the entries need, each before those that call it."""
        called = set(entries) or {self.functions[-1].name}
        reachable = []
        for node in reversed(self.functions):  # without what only a loop called that was not written out in the end
            if node.name in called:
                reachable.append(node)
                called.update(n.id for n in nodes([node]) if isinstance(n, ast.Name))
                place(node)
        return reachable[::-1]
