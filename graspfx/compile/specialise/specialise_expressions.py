"""Specialisation of a kernel's expressions: known values are folded, and the rest remains to be computed."""

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
from graspfx.compile.kernel_marks import BOUND_LATE
from graspfx.compile.specialise.syntax import calls, load, node_of, terms, tuple_of
from graspfx.compile.specialise.values import Dynamic, Memory, Number, Reference, Static, TupleValue, Value, same
from graspfx.errors import GraspFXError, InputError, KernelError

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
BEFORE = "is a negative index; the last entry of a group is [count - 1]"
BUILTINS = (abs, min, max, int, float, bool)


@dataclass
class SpecialisedKernel:
    """A kernel specialised for given arguments: its definition, its result, and whether it is free of side effects."""

    name: str
    arrays: tuple[str, ...]
    node: ast.FunctionDef
    result: Value | None
    pure: bool
    statements: int  # its own and, per call, those of the kernels that it calls


@dataclass(frozen=True)
class Kernel:
    """A function to be specialised: its syntax tree, the meaning of its names, and its origin."""

    tree: ast.FunctionDef
    namespace: Mapping[str, Any]
    file: str
    written: Any = None  # original function if this is its lowered text

    def place(self, line: int) -> str:
        """Return the file and line of a line of the function."""
        if self.written is None:
            return f"{self.file}:{line}"
        from graspfx.compile.lower.lowering import written_lines

        return f"{self.written.__code__.co_filename}:{written_lines(self.written)[line - 1]}"


class Specialiser(Protocol):
    """The program that contains the specialised kernels."""

    unroll: int
    numbers_of_modules: dict[tuple[str, str], str]

    def add(self, function: FunctionType, arguments: Sequence[Value]) -> SpecialisedKernel: ...


class Expressions:
    """Expressions of one kernel during specialisation."""

    def __init__(self, program: Specialiser, kernel: Kernel) -> None:
        self.program, self.kernel, self.tree = program, kernel, kernel.tree
        self.arrays: dict[str, None] = {}
        self.pure = True
        self.called = 0  # statements of called kernels, counted per call

    def value(self, node: ast.expr, scope: Scope) -> Value:
        if isinstance(node, ast.Constant) and isinstance(node.value, bool | int | float):
            return Static(node.value)
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
            return TupleValue(parts, tuple_of([node_of(part) for part in parts]))
        if isinstance(node, ast.BinOp) and type(node.op) in BINARY:
            return self.binary(node, scope)
        if isinstance(node, ast.UnaryOp) and type(node.op) in UNARY:
            inner = self.number(node.operand, scope)
            if isinstance(inner, Static):
                return Static(UNARY[type(node.op)](inner.value))
            return Dynamic(ast.UnaryOp(node.op, inner.node))
        if isinstance(node, ast.BoolOp):
            return self.logic(node, scope)
        if isinstance(node, ast.Compare) and all(type(op) in COMPARISONS for op in node.ops):
            return self.compare(node, scope)
        if isinstance(node, ast.IfExp):
            test = self.test(node.test, scope)
            if isinstance(test, Static):
                return self.value(node.body if test.value else node.orelse, scope)
            one, other = self.number(node.body, scope), self.number(node.orelse, scope)
            if same(one, other) and not calls(node_of(test)):
                return one
            return Dynamic(ast.IfExp(node_of(test), node_of(one), node_of(other)))
        raise self.cannot(node, "is not an expression supported in kernels")

    def number(self, node: ast.expr, scope: Scope) -> Static | Dynamic:
        value = self.value(node, scope)
        if isinstance(value, Static | Dynamic):
            return value
        raise self.cannot(node, "is not a number")

    def test(self, node: ast.expr, scope: Scope) -> Static | Dynamic:
        value = self.number(node, scope)
        if isinstance(value, Static):
            return Static(bool(value.value))
        expression = value.node
        if isinstance(expression, ast.BoolOp) and isinstance(expression.values[-1], ast.Constant):
            settles = isinstance(expression.op, ast.Or)
            if bool(expression.values[-1].value) is not settles:  # x and True has the same truth value as x
                first = expression.values[:-1]
                return Dynamic(first[0] if len(first) == 1 else ast.BoolOp(expression.op, first))
        return value

    def name(self, node: ast.Name, scope: Scope) -> Value:
        if node.id in scope:
            return scope[node.id]
        missing = object()
        item = self.kernel.namespace.get(node.id, getattr(builtins, node.id, missing))
        if item is missing:
            raise self.cannot(node, f"uses {node.id!r}, which is undefined")
        if node.id in self.kernel.namespace:
            self.note(self.kernel.namespace.get("__name__"), node.id, item)
        return self.constant(node, item)

    def attribute(self, node: ast.Attribute, scope: Scope) -> Value:
        owner = self.value(node.value, scope)
        if not (isinstance(owner, Reference) and isinstance(owner.of, ModuleType)):
            raise self.cannot(node, "is not an attribute of a module")
        item = getattr(owner.of, node.attr)
        self.note(owner.of.__name__, node.attr, item)
        return self.constant(node, item)

    def note(self, module: Any, name: str, item: Any) -> None:
        """Record a module's number that was folded."""
        if isinstance(item, bool | int | float) and isinstance(module, str):
            self.program.numbers_of_modules[module, name] = repr(item)

    def constant(self, node: ast.expr, item: Any) -> Value:
        if isinstance(item, bool | int | float):
            return Static(item)
        if isinstance(item, Memory):
            return item
        if isinstance(item, ModuleType) or callable(item):
            return Reference(item)
        raise self.cannot(node, f"is {item!r}, which a kernel cannot use")

    def item(self, node: ast.Subscript, scope: Scope) -> Value:
        owner = self.value(node.value, scope)
        if isinstance(owner, Memory):
            return Dynamic(self.entry(node, scope))
        if isinstance(owner, TupleValue):
            index = self.number(node.slice, scope)
            if isinstance(index, Static) and (owner.node is None or not calls(owner.node)):
                part = owner.parts[int(index.value)]
                if isinstance(part, Static):
                    return part
            return Dynamic(ast.Subscript(node_of(owner), node_of(index), ast.Load()))
        if isinstance(owner, Dynamic):
            return Dynamic(ast.Subscript(owner.node, node_of(self.number(node.slice, scope)), ast.Load()))
        raise self.cannot(node, "is not an entry of a buffer")

    def entry(self, node: ast.Subscript, scope: Scope, *, store: bool = False) -> ast.Subscript:
        """Write an entry of a buffer as an entry of the program's array."""
        owner = self.value(node.value, scope)
        if not isinstance(owner, Memory):
            raise self.cannot(node, "is not an entry of a buffer")
        index = self.number(node.slice, scope)
        if store:
            self.pure = False
        self.arrays[owner.array] = None
        place, offset = terms(node_of(index))
        offset += owner.base
        if place is None:
            if offset < 0:
                raise self.cannot(node, BEFORE, KernelError)
            place = ast.Constant(offset)
        elif offset:
            sign = ast.Add() if offset > 0 else ast.Sub()
            place = ast.BinOp(place, sign, ast.Constant(abs(offset)))
        return ast.Subscript(load(owner.array), place, ast.Store() if store else ast.Load())

    def binary(self, node: ast.BinOp, scope: Scope) -> Value:
        left, right = self.number(node.left, scope), self.number(node.right, scope)
        if isinstance(left, Static) and isinstance(right, Static):
            result = _folded(BINARY[type(node.op)], left.value, right.value)
            if result is not None:
                return result
        return Dynamic(ast.BinOp(node_of(left), node.op, node_of(right)))

    def logic(self, node: ast.BoolOp, scope: Scope) -> Value:
        settles = isinstance(node.op, ast.Or)  # the value that decides
        rest: list[ast.expr] = []
        for part in node.values:
            value = self.number(part, scope)
            if isinstance(value, Static):
                if bool(value.value) is settles:
                    if not rest:
                        return value
                    rest.append(node_of(value))
                    break
                if part is not node.values[-1]:
                    continue
                if not rest:
                    return value
                if isinstance(value.value, bool) and isinstance(rest[-1], ast.Compare):
                    continue  # already a truth value
            rest.append(node_of(value))
        return Dynamic(rest[0] if len(rest) == 1 else ast.BoolOp(node.op, rest))

    def compare(self, node: ast.Compare, scope: Scope) -> Value:
        operands = [self.number(part, scope) for part in (node.left, *node.comparators)]
        numbers = [o.value for o in operands if isinstance(o, Static)]
        if len(numbers) == len(operands):
            pairs = zip(numbers, node.ops, numbers[1:], strict=False)
            return Static(all(COMPARISONS[type(op)](a, b) for a, op, b in pairs))
        first, *others = map(node_of, operands)
        return Dynamic(ast.Compare(first, node.ops, others))

    def call(self, node: ast.Call, scope: Scope) -> tuple[ast.expr | None, Value | None]:
        """Specialise a call; return the remaining call, None if there is none, and the static part of its value."""
        called = self.value(node.func, scope)
        if not isinstance(called, Reference) or isinstance(called.of, ModuleType):
            raise self.cannot(node, "does not call a function")
        function = called.of
        if isinstance(function, FunctionType):
            if hasattr(function, BOUND_LATE):
                return self.by_name(node, function, scope), None
            function = source_function(function)
            return self.specialised(node, function, scope)
        arguments = [self.number(a, scope) for a in node.args]
        if function in BUILTINS or getattr(math, getattr(function, "__name__", ""), None) is function:
            numbers = [a.value for a in arguments if isinstance(a, Static)]
            if len(numbers) == len(arguments):
                result = _folded(function, *numbers)
                if result is not None:
                    return None, result
            name: ast.expr = load(function.__name__)
            if function not in BUILTINS:
                name = ast.Attribute(load("math"), function.__name__, ast.Load())
            return ast.Call(name, [node_of(a) for a in arguments], []), None
        raise self.cannot(node, f"calls {function!r}, which kernels do not support")

    def by_name(self, node: ast.Call, function: FunctionType, scope: Scope) -> ast.expr:
        """Write a call of a function that the program itself defines."""
        arguments: list[ast.expr] = []
        for argument in node.args:
            value = self.value(argument, scope)
            if isinstance(value, Memory):
                assert value.base == 0
                self.arrays[value.array] = None
                arguments.append(load(value.array))
            elif isinstance(value, Static | Dynamic):
                arguments.append(node_of(value))
            else:
                raise self.cannot(argument, "is neither a buffer nor a number")
        self.pure = False
        return ast.Call(load(function.__name__), arguments, [])

    def specialised(self, node: ast.Call, function: FunctionType, scope: Scope) -> tuple[ast.expr | None, Value | None]:
        values: list[Value] = []
        keywords = {k.arg: k.value for k in node.keywords}
        for k, parameter in enumerate(signature(function).parameters.values()):
            if k < len(node.args):
                values.append(self.value(node.args[k], scope))
            elif parameter.name in keywords:
                values.append(self.value(keywords[parameter.name], scope))
            elif parameter.default is not Parameter.empty:
                values.append(Static(parameter.default))
        specialised = self.program.add(function, values)
        result = specialised.result
        is_static = isinstance(result, Static) or (
            isinstance(result, TupleValue) and all(isinstance(part, Static) for part in result.parts)
        )
        dynamic = [a.node for a in values if isinstance(a, Dynamic)]
        if specialised.pure and (is_static or result is None) and not any(map(calls, dynamic)):
            return None, result or Static(0)
        self.pure = self.pure and specialised.pure
        self.called += specialised.statements
        for array in specialised.arrays:
            self.arrays[array] = None
        call = ast.Call(load(specialised.name), [*map(load, specialised.arrays), *dynamic], [])
        return call, result if isinstance(result, Static | TupleValue) else None

    def cannot(self, node: ast.AST, why: str, kind: type[InputError] = InputError) -> GraspFXError:
        line = getattr(node, "lineno", self.tree.lineno)
        text = ast.unparse(node).splitlines()[0] if isinstance(node, ast.expr | ast.stmt) else self.tree.name
        return kind(self.kernel.place(line), text, "a construct supported in kernels", f"it {why}")


def _folded(function: Callable[..., Any], *numbers: Number) -> Static | None:
    """Fold a function of numbers; return None if it raises or the result is not real, and leave it to the program."""
    try:
        result = function(*numbers)
    except (ArithmeticError, ValueError):
        return None
    return Static(result) if isinstance(result, bool | int | float) else None


def from_call(call: ast.expr | None, result: Value | None) -> Value:
    """Convert a call to a value; no call remains if its whole result is static."""
    if call is None:
        if isinstance(result, TupleValue):
            return TupleValue(result.parts, tuple_of([node_of(part) for part in result.parts]))
        return result or Static(0)
    return TupleValue(result.parts, call) if isinstance(result, TupleValue) else Dynamic(call)
