"""Expressions of a kernel, specialised: folded where all is known, else what is left to be computed."""

from __future__ import annotations

import ast
import builtins
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from inspect import Parameter, signature
from types import FunctionType, ModuleType
from typing import Any, Protocol

from graspfx.compile.kernel import source_function
from graspfx.compile.specialise.syntax import calls, load, node_of, terms, tuple_of
from graspfx.compile.specialise.values import Known, Later, Memory, Named, Number, Several, Value, same
from graspfx.errors import GraspFXError, InputError

Scope = dict[str, Value]

BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
}
UNARY: dict[type[ast.unaryop], Callable[[Any], Any]] = {
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Not: operator.not_,
}
COMPARISONS: dict[type[ast.cmpop], Callable[[Any, Any], bool]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}
BUILTINS = (abs, min, max, int, float, bool)


@dataclass
class Made:
    """A kernel specialised for some arguments: its definition, what it returns, whether it only computes."""

    name: str
    arrays: tuple[str, ...]
    node: ast.FunctionDef
    result: Value | None
    pure: bool
    statements: int  # its own and those of the kernels that it calls, each call anew


@dataclass(frozen=True)
class Kernel:
    """A function to be specialised: its syntax, what the names in it stand for, where it comes from."""

    tree: ast.FunctionDef
    namespace: Mapping[str, Any]
    file: str


class Specialiser(Protocol):
    """The program that a kernel becomes a part of."""

    frozen: Mapping[tuple[str, int], float]
    unroll: int
    lanes: int
    taken: dict[tuple[str, str], str]

    def add(self, function: FunctionType, arguments: Sequence[Value]) -> Made: ...


class Expressions:
    """The expressions of one kernel while it is specialised."""

    def __init__(self, program: Specialiser, kernel: Kernel) -> None:
        self.program, self.kernel, self.tree = program, kernel, kernel.tree
        self.arrays: dict[str, None] = {}
        self.pure = True
        self.called = 0  # statements of the kernels that are called, each call anew

    def value(self, node: ast.expr, scope: Scope) -> Value:
        if isinstance(node, ast.Constant) and isinstance(node.value, bool | int | float):
            return Known(node.value)
        if isinstance(node, ast.Name):
            return self.name(node, scope)
        if isinstance(node, ast.Attribute):
            return self.attribute(node, scope)
        if isinstance(node, ast.Subscript):
            return self.item(node, scope)
        if isinstance(node, ast.Call):
            return from_call(*self.call(node, scope))
        if isinstance(node, ast.Tuple):
            parts = tuple(self.number(part, scope) for part in node.elts)
            return Several(parts, tuple_of([node_of(part) for part in parts]))
        if isinstance(node, ast.BinOp) and type(node.op) in BINARY:
            return self.binary(node, scope)
        if isinstance(node, ast.UnaryOp) and type(node.op) in UNARY:
            inner = self.number(node.operand, scope)
            if isinstance(inner, Known):
                return Known(UNARY[type(node.op)](inner.value))
            return Later(ast.UnaryOp(node.op, inner.node))
        if isinstance(node, ast.BoolOp):
            return self.logic(node, scope)
        if isinstance(node, ast.Compare) and all(type(op) in COMPARISONS for op in node.ops):
            return self.compare(node, scope)
        if isinstance(node, ast.IfExp):
            test = self.test(node.test, scope)
            if isinstance(test, Known):
                return self.value(node.body if test.value else node.orelse, scope)
            one, other = self.number(node.body, scope), self.number(node.orelse, scope)
            if same(one, other) and not calls(node_of(test)):
                return one
            return Later(ast.IfExp(node_of(test), node_of(one), node_of(other)))
        raise self.cannot(node, "is no expression of a kernel")

    def number(self, node: ast.expr, scope: Scope) -> Known | Later:
        value = self.value(node, scope)
        if isinstance(value, Known | Later):
            return value
        raise self.cannot(node, "is no number")

    def test(self, node: ast.expr, scope: Scope) -> Known | Later:
        found = self.number(node, scope)
        if isinstance(found, Known):
            return Known(bool(found.value))
        left = found.node
        if isinstance(left, ast.BoolOp) and isinstance(left.values[-1], ast.Constant):
            settles = isinstance(left.op, ast.Or)
            if bool(left.values[-1].value) is not settles:  # x and True is as true as x
                first = left.values[:-1]
                return Later(first[0] if len(first) == 1 else ast.BoolOp(left.op, first))
        return found

    def name(self, node: ast.Name, scope: Scope) -> Value:
        if node.id in scope:
            return scope[node.id]
        missing = object()
        found = self.kernel.namespace.get(node.id, getattr(builtins, node.id, missing))
        if found is missing:
            raise self.cannot(node, f"names {node.id!r}, which is nothing known here")
        if node.id in self.kernel.namespace:
            self.note(self.kernel.namespace.get("__name__"), node.id, found)
        return self.constant(node, found)

    def attribute(self, node: ast.Attribute, scope: Scope) -> Value:
        owner = self.value(node.value, scope)
        if not (isinstance(owner, Named) and isinstance(owner.of, ModuleType)):
            raise self.cannot(node, "is an attribute of something else than a module")
        found = getattr(owner.of, node.attr)
        self.note(owner.of.__name__, node.attr, found)
        return self.constant(node, found)

    def note(self, module: Any, name: str, found: Any) -> None:
        """Keeps a module's number that is folded in."""
        if isinstance(found, bool | int | float) and isinstance(module, str):
            self.program.taken[module, name] = repr(found)

    def constant(self, node: ast.expr, found: Any) -> Value:
        if isinstance(found, bool | int | float):
            return Known(found)
        if isinstance(found, Memory):
            return found
        if isinstance(found, ModuleType) or callable(found):
            return Named(found)
        raise self.cannot(node, f"is {found!r}, which a kernel cannot use")

    def item(self, node: ast.Subscript, scope: Scope) -> Value:
        owner = self.value(node.value, scope)
        if isinstance(owner, Memory):
            index = self.number(node.slice, scope)
            if isinstance(index, Known):
                entry = owner.array, owner.base + int(index.value)
                if entry in self.program.frozen:
                    return Known(self.program.frozen[entry])
            return Later(self.entry(node, scope))
        if isinstance(owner, Several):
            index = self.number(node.slice, scope)
            if isinstance(index, Known) and (owner.node is None or not calls(owner.node)):
                part = owner.parts[int(index.value)]
                if isinstance(part, Known):
                    return part
            return Later(ast.Subscript(node_of(owner), node_of(index), ast.Load()))
        if isinstance(owner, Later):
            return Later(ast.Subscript(owner.node, node_of(self.number(node.slice, scope)), ast.Load()))
        raise self.cannot(node, "is no entry of a buffer")

    def entry(self, node: ast.Subscript, scope: Scope, *, store: bool = False) -> ast.Subscript:
        """An entry of a buffer as one of the program's array."""
        owner = self.value(node.value, scope)
        if not isinstance(owner, Memory):
            raise self.cannot(node, "is no entry of a buffer")
        index = self.number(node.slice, scope)
        if store:
            self.pure = False
            if isinstance(index, Known) and (owner.array, owner.base + int(index.value)) in self.program.frozen:
                raise self.cannot(node, "writes to an entry that was said never to change")
        self.arrays[owner.array] = None
        lanes = self.program.lanes
        rest, offset = terms(node_of(index))
        offset += owner.base
        place: ast.expr | None = rest
        if lanes > 1:
            place = load("lane") if rest is None else ast.BinOp(_times(rest, lanes), ast.Add(), load("lane"))
            offset *= lanes
        if place is None:
            if offset < 0:
                raise self.cannot(node, "is an entry before the buffer's first")
            place = ast.Constant(offset)
        elif offset:
            sign = ast.Add() if offset > 0 else ast.Sub()
            place = ast.BinOp(place, sign, ast.Constant(abs(offset)))
        return ast.Subscript(load(owner.array), place, ast.Store() if store else ast.Load())

    def binary(self, node: ast.BinOp, scope: Scope) -> Value:
        left, right = self.number(node.left, scope), self.number(node.right, scope)
        if isinstance(left, Known) and isinstance(right, Known):
            found = _done(BINARY[type(node.op)], left.value, right.value)
            if found is not None:
                return found
        return Later(ast.BinOp(node_of(left), node.op, node_of(right)))

    def logic(self, node: ast.BoolOp, scope: Scope) -> Value:
        settles = isinstance(node.op, ast.Or)  # the value that ends it
        left: list[ast.expr] = []
        for part in node.values:
            found = self.number(part, scope)
            if isinstance(found, Known):
                if bool(found.value) is settles:
                    if not left:
                        return found
                    left.append(node_of(found))
                    break
                if part is not node.values[-1]:
                    continue
                if not left:
                    return found
                if isinstance(found.value, bool) and isinstance(left[-1], ast.Compare):
                    continue  # a truth value already
            left.append(node_of(found))
        return Later(left[0] if len(left) == 1 else ast.BoolOp(node.op, left))

    def compare(self, node: ast.Compare, scope: Scope) -> Value:
        operands = [self.number(part, scope) for part in (node.left, *node.comparators)]
        numbers = [o.value for o in operands if isinstance(o, Known)]
        if len(numbers) == len(operands):
            pairs = zip(numbers, node.ops, numbers[1:], strict=False)
            return Known(all(COMPARISONS[type(op)](a, b) for a, op, b in pairs))
        first, *others = map(node_of, operands)
        return Later(ast.Compare(first, node.ops, others))

    def call(self, node: ast.Call, scope: Scope) -> tuple[ast.expr | None, Value | None]:
        """The call that is left, None if there is none, and what is known of its value."""
        called = self.value(node.func, scope)
        if not isinstance(called, Named) or isinstance(called.of, ModuleType):
            raise self.cannot(node, "calls something else than a function")
        function = called.of
        if isinstance(function, FunctionType):
            function = source_function(function)
            return self.specialised(node, function, scope)
        arguments = [self.number(a, scope) for a in node.args]
        if function in BUILTINS or getattr(math, getattr(function, "__name__", ""), None) is function:
            numbers = [a.value for a in arguments if isinstance(a, Known)]
            if len(numbers) == len(arguments):
                found = _done(function, *numbers)
                if found is not None:
                    return None, found
            name: ast.expr = load(function.__name__)
            if function not in BUILTINS:
                name = ast.Attribute(load("math"), function.__name__, ast.Load())
            return ast.Call(name, [node_of(a) for a in arguments], []), None
        raise self.cannot(node, f"calls {function!r}, which a kernel cannot")

    def specialised(self, node: ast.Call, function: FunctionType, scope: Scope) -> tuple[ast.expr | None, Value | None]:
        given: list[Value] = []
        named = {k.arg: k.value for k in node.keywords}
        for k, parameter in enumerate(signature(function).parameters.values()):
            if k < len(node.args):
                given.append(self.value(node.args[k], scope))
            elif parameter.name in named:
                given.append(self.value(named[parameter.name], scope))
            elif parameter.default is not Parameter.empty:
                given.append(Known(parameter.default))
        made = self.program.add(function, given)
        result = made.result
        known = isinstance(result, Known) or (
            isinstance(result, Several) and all(isinstance(part, Known) for part in result.parts)
        )
        later = [a.node for a in given if isinstance(a, Later)]
        if made.pure and (known or result is None) and not any(map(calls, later)):
            return None, result or Known(0)
        self.pure = self.pure and made.pure
        self.called += made.statements
        for array in made.arrays:
            self.arrays[array] = None
        lane = [load("lane")] if self.program.lanes > 1 else []
        call = ast.Call(load(made.name), [*map(load, made.arrays), *lane, *later], [])
        return call, result if isinstance(result, Known | Several) else None

    def cannot(self, node: ast.AST, why: str) -> GraspFXError:
        line = getattr(node, "lineno", self.tree.lineno)
        shown = ast.unparse(node).splitlines()[0] if isinstance(node, ast.expr | ast.stmt) else self.tree.name
        return InputError(f"{self.kernel.file}:{line}", shown, "what a kernel may hold", why)


def _done(function: Callable[..., Any], *numbers: Number) -> Known | None:
    """What a function gives; None where it raises or leaves the reals, which is to happen where and if it does."""
    try:
        found = function(*numbers)
    except (ArithmeticError, ValueError):
        return None
    return Known(found) if isinstance(found, bool | int | float) else None


def from_call(call: ast.expr | None, known: Value | None) -> Value:
    """A call as a value; no call where all that it gives is known."""
    if call is None:
        if isinstance(known, Several):
            return Several(known.parts, tuple_of([node_of(part) for part in known.parts]))
        return known or Known(0)
    return Several(known.parts, call) if isinstance(known, Several) else Later(call)


def _times(node: ast.expr, lanes: int) -> ast.expr:
    return ast.BinOp(node, ast.Mult(), ast.Constant(lanes))
