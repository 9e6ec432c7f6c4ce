"""Operations on the expressions of `kinds`: parts, copies with other numbers, sums of offsets, and assignments."""

from __future__ import annotations

import ast
import copy
from collections import Counter
from collections.abc import Sequence
from functools import cache
from typing import Any

from graspfx.compile.lower.kinds import (
    Bundle,
    Constant,
    Grid,
    Group,
    Lowered,
    Pack,
    Place,
    Span,
    plus,
)
from graspfx.compile.records import parts_of


@cache
def indexed(tree: ast.FunctionDef) -> set[str]:
    """Return the names of the variables that a function indexes."""
    subscripts = [node for node in ast.walk(tree) if isinstance(node, ast.Subscript)]
    return {node.value.id for node in subscripts if isinstance(node.value, ast.Name)}


@cache
def names_of(tree: ast.FunctionDef) -> frozenset[str]:
    """Return all names in a function: parameters, variables, and names of its module."""
    names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    return frozenset(names | {node.arg for node in ast.walk(tree) if isinstance(node, ast.arg)})


@cache
def repeated(tree: ast.FunctionDef) -> set[str]:
    """Return the names of variables that occur more than once, not counting uses of different attributes."""
    uses: Counter[tuple[str, str]] = Counter()
    whole: Counter[str] = Counter()
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            uses[node.value.id, node.attr] += 1
            whole[node.value.id] -= 1
        if isinstance(node, ast.Name):
            whole[node.id] += 1
    return {name for (name, _), count in uses.items() if count > 1 or whole[name] > 0} | {
        name for name, count in whole.items() if count > 1
    }


def value_of(item: Any) -> Lowered:
    """Return the expression of a constant number or value of a module."""
    if isinstance(item, bool | int | float):
        return ast.Constant(item)
    return Bundle(type(item), tuple(value_of(getattr(item, name)) for name in parts_of(type(item))))


def kind_of(value: Lowered) -> tuple[object, ...]:
    """Return the properties of a value that must be the same for all values of one variable."""
    if isinstance(value, ast.expr):
        return ("number",)
    if isinstance(value, Bundle):
        return ("value", value.kind)
    if isinstance(value, Pack):
        return ("tuple", *map(kind_of, value.parts))
    if isinstance(value, Constant):
        return ("constant",)
    return (type(value), getattr(value, "kind", None), value.buffer)


def pieces(value: Lowered) -> list[Lowered]:
    """Return the parts of values and tuples, recursively; any other expression is its only part."""
    if isinstance(value, Bundle | Pack):
        return [piece for part in value.parts for piece in pieces(part)]
    return [value]


def rebuild(value: Lowered, numbers: Any) -> Lowered:
    """Return a copy of a value whose numbers are taken from an iterator, in the order of `offsets`."""
    if isinstance(value, Bundle):
        return Bundle(value.kind, tuple(rebuild(part, numbers) for part in value.parts))
    if isinstance(value, Pack):
        return Pack(tuple(rebuild(part, numbers) for part in value.parts))
    if isinstance(value, Place):
        return Place(value.kind, value.buffer, next(numbers))
    if isinstance(value, Span):
        return Span(value.buffer, next(numbers))
    if isinstance(value, Grid):
        return Grid(value.buffer, next(numbers), next(numbers))
    if isinstance(value, Group):
        return Group(value.kind, value.buffer, next(numbers), next(numbers), next(numbers))
    if isinstance(value, Constant):
        return value
    number: ast.expr = next(numbers)
    return number


def replace_buffer(value: Place | Span | Grid | Group, buffer: str) -> Lowered:
    if isinstance(value, Place):
        return Place(value.kind, buffer, value.offset)
    if isinstance(value, Span):
        return Span(buffer, value.offset)
    if isinstance(value, Grid):
        return Grid(buffer, value.offset, value.columns)
    return Group(value.kind, buffer, value.offset, value.stride, value.count)


def sum_of(a: ast.expr, b: ast.expr) -> ast.expr:
    """Return the sum of two offsets; constants are added."""
    if isinstance(b, ast.Constant) and isinstance(b.value, int):
        return plus(a, b.value)
    if isinstance(a, ast.Constant):
        return plus(b, int(a.value)) if a.value else b  # type: ignore[arg-type] # offsets are whole numbers
    return ast.BinOp(a, ast.Add(), b)


def product_of(a: ast.expr, b: ast.expr) -> ast.expr:
    """Return the product of an index and a stride; constants are multiplied."""
    if isinstance(a, ast.Constant) and isinstance(b, ast.Constant):
        return ast.Constant(int(a.value) * int(b.value))  # type: ignore[arg-type] # whole numbers
    if isinstance(a, ast.Constant) and a.value == 0:
        return a
    return ast.BinOp(a, ast.Mult(), b)


def grid_entry(grid: Grid, row: ast.expr, column: ast.expr) -> ast.expr:
    return sum_of(sum_of(grid.offset, product_of(row, grid.columns)), column)


def assign(name: str, value: ast.expr) -> ast.stmt:
    return ast.Assign([ast.Name(name, ast.Store())], value)


def assign_all(names: Sequence[ast.expr], values: Sequence[ast.expr]) -> ast.stmt:
    """Return a statement that assigns all numbers to variables at once."""
    return ast.Assign([store_of(names)], values[0] if len(values) == 1 else ast.Tuple(list(values), ast.Load()))


def store_of(names: Sequence[ast.expr]) -> ast.expr:
    targets = []
    for name in names:
        target = copy.copy(name)
        target.ctx = ast.Store()  # type: ignore[attr-defined] # names and entries have one
        targets.append(target)
    return targets[0] if len(targets) == 1 else ast.Tuple(list(targets), ast.Store())
