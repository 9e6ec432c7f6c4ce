"""The entry function of a program: the last function, whose parameters are buffers, then numbers."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass

from graspfx.errors import InputError


@dataclass(frozen=True)
class Entry:
    """Functions of a program; the last one is the entry.

    Attributes:
        trees: All functions.
        tree: Entry function.
        names: Parameters of the entry.
        arrays: Parameters that are buffers; they come first.
    """

    trees: tuple[ast.FunctionDef, ...]
    tree: ast.FunctionDef
    names: tuple[str, ...]
    arrays: tuple[str, ...]

    @property
    def numbers(self) -> tuple[str, ...]:
        """Parameters after the buffers."""
        return self.names[len(self.arrays) :]


def entry_of(source: str) -> Entry:
    """Parse a program and find its entry.

    Raises:
        InputError: If there is no function, or a number precedes a buffer.
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
    """Tell whether a parameter is indexed in a function or in functions that it calls."""
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
