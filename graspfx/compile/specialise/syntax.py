"""Construction, inspection and search of syntax trees."""

from __future__ import annotations

import ast
import copy
import math
from collections.abc import Iterable, Iterator, Sequence

from graspfx.compile.specialise.values import Dynamic, Number, Static, TupleValue, Value
from graspfx.errors import InputError


def load(name: str) -> ast.Name:
    return ast.Name(name, ast.Load())


def store(name: str) -> ast.Name:
    return ast.Name(name, ast.Store())


def assignment(name: str, value: ast.expr) -> ast.Assign:
    return ast.Assign([store(name)], value)


def tuple_of(parts: Sequence[ast.expr], *, store: bool = False) -> ast.Tuple:
    return ast.Tuple(list(parts), ast.Store() if store else ast.Load())


def call_of(name: str, arguments: Sequence[ast.expr]) -> ast.Call:
    return ast.Call(load(name), list(arguments), [])


def constant(value: Number) -> ast.expr:
    if isinstance(value, float) and math.isnan(value):
        return load("nan")
    if isinstance(value, float) and math.isinf(value):
        return load("inf") if value > 0.0 else ast.UnaryOp(ast.USub(), load("inf"))
    if value < 0 or (value == 0 and math.copysign(1.0, value) < 0.0):
        return ast.UnaryOp(ast.USub(), ast.Constant(-value))  # a negative base of a power needs brackets
    return ast.Constant(value)


def node_of(value: Value) -> ast.expr:
    if isinstance(value, Static):
        return constant(value.value)
    if isinstance(value, Dynamic | TupleValue) and value.node is not None:
        return value.node
    raise InputError("kernel", value, "a number")


def loaded(target: ast.expr) -> ast.expr:
    expression = copy.copy(target)
    expression.ctx = ast.Load()  # type: ignore[attr-defined] # targets have one
    return expression


def nodes(roots: Iterable[ast.AST]) -> Iterator[ast.AST]:
    """Yield all nodes of some trees in no particular order, in a third of the time of `ast.walk`."""
    left = list(roots)
    while left:
        node = left.pop()
        yield node
        if type(node) is ast.Name or type(node) is ast.Constant:
            continue
        for value in vars(node).values():
            if isinstance(value, list):
                left += value
            elif isinstance(value, ast.AST):
                left.append(value)


def inner(statement: ast.stmt) -> list[ast.stmt]:
    """List the statement blocks inside a loop or a branch."""
    return [*getattr(statement, "body", ()), *getattr(statement, "orelse", ())]


def unparsed_statements(statements: Sequence[ast.stmt]) -> Iterator[ast.stmt]:
    """Yield the statement of each line of `ast.unparse`'s output."""
    for statement in statements:
        yield statement
        if isinstance(statement, ast.If | ast.For | ast.While):
            yield from unparsed_statements(statement.body)
            other = statement.orelse
            if other and not (isinstance(statement, ast.If) and len(other) == 1 and isinstance(other[0], ast.If)):
                yield statement  # else:
            yield from unparsed_statements(other)


def size(statements: Sequence[ast.stmt]) -> int:
    """Count statements, including nested ones."""
    return len(statements) + sum(size(inner(s)) for s in statements if isinstance(s, ast.If | ast.For | ast.While))


def place(statement: ast.stmt) -> None:
    """Set the line numbers that `ast.unparse` needs in a statement and its nested statements."""
    statement.lineno = 0
    for part in inner(statement):
        place(part)


def calls(node: ast.expr) -> bool:
    return any(isinstance(n, ast.Call) for n in nodes([node]))


def terms(node: ast.expr) -> tuple[ast.expr | None, int]:
    """Split a sum of integers into its variable part and its constant."""
    if isinstance(node, ast.Constant) and isinstance(node.value, int):
        return None, node.value
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) and isinstance(node.operand, ast.Constant):
        inner, total = terms(node.operand)
        return (None, -total) if inner is None else (node, 0)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
        left, a = terms(node.left)
        right, b = terms(node.right)
        minus = isinstance(node.op, ast.Sub)
        total = a - b if minus else a + b
        if right is None:
            return left, total
        if left is None:
            return (ast.UnaryOp(ast.USub(), right) if minus else right), total
        return ast.BinOp(left, node.op, right), total
    return node, 0


def assigned(statements: Sequence[ast.stmt]) -> set[str]:
    return {n.id for n in nodes(statements) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}


def leaves(statements: Sequence[ast.stmt]) -> bool:
    """Tell whether a loop's body has a `break` or `continue` of this loop."""
    for statement in statements:
        if isinstance(statement, ast.Break | ast.Continue):
            return True
        if isinstance(statement, ast.If) and (leaves(statement.body) or leaves(statement.orelse)):
            return True
    return False
