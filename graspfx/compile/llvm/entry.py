"""The entry of a program as it is read from its text: the last function, its buffers first and then its numbers."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass

from graspfx.errors import InputError


@dataclass(frozen=True)
class Entry:
    """A program's functions, of which the last is the entry.

    Attributes:
        trees: all functions.
        tree: the entry.
        names: its parameters.
        arrays: those of them that are buffers, the first ones.
    """

    trees: tuple[ast.FunctionDef, ...]
    tree: ast.FunctionDef
    names: tuple[str, ...]
    arrays: tuple[str, ...]

    @property
    def numbers(self) -> tuple[str, ...]:
        """Parameters behind the buffers."""
        return self.names[len(self.arrays) :]


def entry_of(source: str) -> Entry:
    """Read a program's entry.

    Raises:
        InputError: no function, or a number before a buffer.
    """
    trees = tuple(node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef))
    if not trees:
        raise InputError("source", source, "at least one function")
    tree, functions = trees[-1], {t.name: t for t in trees}
    names = tuple(a.arg for a in tree.args.args)
    arrays = tuple(name for name in names if is_indexed(tree, name, functions))
    if arrays != names[: len(arrays)]:
        raise InputError(f"{tree.name}", list(names), "buffers first, then numbers")
    return Entry(trees, tree, names, arrays)


def is_indexed(tree: ast.FunctionDef, name: str, functions: Mapping[str, ast.FunctionDef]) -> bool:
    """Tell whether a parameter is indexed, here or in a function that is called."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name) and node.value.id == name:
            return True
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in functions:
            called = functions[node.func.id]
            for argument, parameter in zip(node.args, called.args.args, strict=False):
                passed = isinstance(argument, ast.Name) and argument.id == name and called is not tree
                if passed and is_indexed(called, parameter.arg, functions):
                    return True
    return False
