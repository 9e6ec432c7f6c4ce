"""Partial evaluation of kernels: what a scene never changes is folded in, and what it never runs is left out.

The language is the one that kernels are written in: numbers, flat buffers and their entries, `if`, `while`,
`for ... in range(...)`, calls of other kernels, of `math` and of a few builtins, tuples that are returned or unpacked.
Every call is specialised for the arguments that are known where it stands; arithmetic is never reordered, so that a
program computes the same bits as the kernels that it was made from.
"""

from __future__ import annotations

import ast
import builtins
import copy
import math
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from inspect import Parameter, signature
from types import FunctionType, ModuleType
from typing import Any

from graspfx.compile.source import definition
from graspfx.compile.values import Known, Later, Memory, Named, Number, Several, Value, same
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
DEEPEST = 100  # calls inside calls
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


@dataclass
class Program:
    """Functions in the order in which they are to be defined, the last one the entry; free of what is known.

    Args:
        frozen: entries of arrays that never change, by array and index.
        unroll: most statements of a loop that is written out, those of the kernels that it calls among them.
        lanes: so many programs side by side, entry i of each at i * lanes + lane; 1 for an ordinary program.
    """

    frozen: Mapping[tuple[str, int], float]
    unroll: int = 0
    lanes: int = 1
    functions: list[ast.FunctionDef] = field(default_factory=list)
    files: set[str] = field(default_factory=set)  # that kernels were taken from
    _made: dict[Any, Made | None] = field(default_factory=dict)

    def add(self, function: FunctionType, arguments: Sequence[Value]) -> Made:
        """The function specialised for these arguments; unknown ones become its parameters."""
        key = (
            function,
            tuple(a.key if isinstance(a, Known) else a if isinstance(a, Memory) else None for a in arguments),
        )
        code = function.__code__
        if key not in self._made and list(self._made.values()).count(None) < DEEPEST:
            self._made[key] = None
            self.files.add(code.co_filename)
            kernel = Kernel(definition(function), function.__globals__, code.co_filename)
            self._made[key] = self._make(kernel, arguments, f"{function.__name__}_{len(self._made)}")
        found = self._made.get(key)
        if found is None:
            place = f"{code.co_filename}:{code.co_firstlineno}"
            raise InputError(place, function.__qualname__, "a kernel that does not call itself")
        return found

    def add_text(self, text: str, namespace: Mapping[str, Any], arguments: Sequence[Value]) -> Made:
        """The function that a text defines; its names are kernels, buffers (`Memory`), modules and numbers."""
        [tree] = ast.parse(text).body
        assert isinstance(tree, ast.FunctionDef)
        return self._make(Kernel(tree, namespace, f"<{tree.name}>"), arguments, tree.name)

    def _make(self, kernel: Kernel, arguments: Sequence[Value], name: str) -> Made:
        made = _Body(self, kernel, arguments).made(name)
        self.functions.append(made.node)
        return made

    def source(self) -> str:
        """The program as Python."""
        lines = ["import math", "", "inf, nan = math.inf, math.nan", ""]
        called = {self.functions[-1].name}
        kept = []
        for node in reversed(self.functions):  # without what only a loop called that was not written out in the end
            if node.name in called:
                kept.append(node)
                called.update(n.id for n in ast.walk(node) if isinstance(n, ast.Name))
        return "\n".join([*lines, *(ast.unparse(ast.fix_missing_locations(node)) + "\n" for node in reversed(kept))])


class _Body:
    """One kernel while it is specialised."""

    def __init__(self, program: Program, kernel: Kernel, arguments: Sequence[Value]) -> None:
        self.program, self.kernel, self.tree = program, kernel, kernel.tree
        self.names = [a.arg for a in kernel.tree.args.args]
        if len(self.names) != len(arguments):
            raise self.cannot(self.tree, f"takes {len(self.names)} arguments, {len(arguments)} given")
        self.arguments = arguments
        self.arrays: dict[str, None] = {}
        self.returned: list[Value | None] = []
        self.pure = True
        self.called = 0  # statements of the kernels that are called, each call anew

    def made(self, name: str) -> Made:
        scope: Scope = {}
        body: list[ast.stmt] = []
        parameters = []
        for parameter, value in zip(self.names, self.arguments, strict=True):
            if isinstance(value, Memory):
                self.arrays[value.array] = None
                scope[parameter] = value
            elif isinstance(value, Known):
                scope[parameter] = value
                body.append(_assign(parameter, _constant(value.value)))
            else:
                scope[parameter] = Later(_load(parameter))
                parameters.append(parameter)
        statements, ended = self.block(self.tree.body, scope)
        if not ended:
            self.returned.append(None)
        for taken in self.arrays.keys() & (_assigned(self.tree.body) | set(parameters)):
            raise self.cannot(
                self.tree, f"has a number named {taken!r}, which is the name of a buffer: call that otherwise"
            )
        body = _without_unused(body + statements)
        lane = ["lane"] if self.program.lanes > 1 else []
        arrays = tuple(self.arrays)
        node = ast.FunctionDef(
            name=name,
            args=ast.arguments(
                posonlyargs=[], args=[ast.arg(p) for p in (*arrays, *lane, *parameters)], kwonlyargs=[],
                kw_defaults=[], defaults=[],
            ),
            body=body or [ast.Pass()],
            decorator_list=[],
            type_params=[],
        )  # fmt: skip
        return Made(name, arrays, node, self.result(), self.pure, self.called + _statements(body))

    def result(self) -> Value | None:
        """What is known of all that may be returned."""
        first, *others = self.returned
        if first is None:
            return None
        if isinstance(first, Several):
            parts = [
                part if all(isinstance(r, Several) and same(part, r.parts[k]) for r in others) else Later(_load("_"))
                for k, part in enumerate(first.parts)
            ]
            return Several(tuple(parts), None)
        return first if all(same(first, r) for r in others) else Later(_load("_"))

    # Statements ---------------------------------------------------------------------------------------------------

    def block(self, statements: Iterable[ast.stmt], scope: Scope) -> tuple[list[ast.stmt], bool]:
        """Statements specialised, and whether the end is never reached."""
        out: list[ast.stmt] = []
        for statement in statements:
            more, ended = self.statement(statement, scope)
            out += more
            if ended:
                return out, True
        return out, False

    def statement(self, node: ast.stmt, scope: Scope) -> tuple[list[ast.stmt], bool]:
        if isinstance(node, ast.Assign):
            first, value = node.targets[0], node.value
            if isinstance(first, ast.Tuple) and isinstance(value, ast.IfExp):  # a choice of tuples, as a branch
                one: list[ast.stmt] = [ast.copy_location(ast.Assign([first], value.body), node)]
                other: list[ast.stmt] = [ast.copy_location(ast.Assign([first], value.orelse), node)]
                return self.branch(ast.copy_location(ast.If(value.test, one, other), node), scope)
            out = self.assign(node.targets[0], node.value, scope)
            for target in node.targets[1:]:  # a = b = 0.0: the second takes what the first has got
                out += self.assign(target, _loaded(node.targets[0]), scope)
            return out, False
        if isinstance(node, ast.AnnAssign) and node.value is not None:
            return self.assign(node.target, node.value, scope), False
        if isinstance(node, ast.AugAssign):
            return self.assign(node.target, ast.BinOp(_loaded(node.target), node.op, node.value), scope), False
        if isinstance(node, ast.If):
            return self.branch(node, scope)
        if isinstance(node, ast.For):
            return self.loop(node, scope)
        if isinstance(node, ast.While):
            return self.repeat(node, scope)
        if isinstance(node, ast.Return):
            return self.give(node, scope), True
        if isinstance(node, ast.Expr):
            return self.effect(node.value, scope), False
        if isinstance(node, ast.Break | ast.Continue):
            return [node], True
        if isinstance(node, ast.Pass):
            return [], False
        raise self.cannot(node, "is no statement of a kernel")

    def assign(self, target: ast.expr, value: ast.expr, scope: Scope) -> list[ast.stmt]:
        out: list[ast.stmt] = []
        found: Value
        if isinstance(value, ast.Call):
            call, known = self.call(value, scope)
            if isinstance(known, Known):
                found = known
                if call is not None:  # done for its effect: what it gives is known
                    out.append(ast.Expr(call))
            else:
                found = _from_call(call, known)
        else:
            found = self.value(value, scope)
        if isinstance(target, ast.Name):
            if isinstance(found, Memory | Named):
                scope[target.id] = found
                return out
            scope[target.id] = found if isinstance(found, Known) else Later(_load(target.id))
            return [*out, _assign(target.id, _node(found))]
        if isinstance(target, ast.Subscript):
            return [*out, ast.Assign([self.entry(target, scope, store=True)], _node(found))]
        if not (isinstance(target, ast.Tuple) and isinstance(found, Several | Later)):
            raise self.cannot(target, "cannot be assigned to")
        to = [
            _store(t.id) if isinstance(t, ast.Name) else self.entry(_subscript(self, t), scope, store=True)
            for t in target.elts
        ]
        parts = found.parts if isinstance(found, Several) else (Later(_load("_")),) * len(to)
        if len(to) != len(parts):
            raise self.cannot(target, f"takes {len(to)} values, {len(parts)} given")
        for t, part in zip(target.elts, parts, strict=True):
            if isinstance(t, ast.Name):
                scope[t.id] = part if isinstance(part, Known) else Later(_load(t.id))
        return [*out, ast.Assign([_tuple(to, store=True)], _node(found))]

    def branch(self, node: ast.If, scope: Scope) -> tuple[list[ast.stmt], bool]:
        test = self.test(node.test, scope)
        if isinstance(test, Known):
            return self.block(node.body if test.value else node.orelse, scope)
        one, other = dict(scope), dict(scope)
        body, ended = self.block(node.body, one)
        otherwise, other_ended = self.block(node.orelse, other)
        if ended != other_ended:
            _become(scope, other if ended else one)
        else:
            _become(scope, {name: _joined(name, one[name], other[name]) for name in one.keys() & other.keys()})
            for name in one.keys() ^ other.keys():  # read only where it has been assigned to
                scope[name] = Later(_load(name))
        if not body and not otherwise:
            return ([ast.Expr(_node(test))] if _calls(_node(test)) else []), False
        if not body:
            return [ast.If(ast.UnaryOp(ast.Not(), _node(test)), otherwise, [])], ended and other_ended
        return [ast.If(_node(test), body, otherwise)], ended and other_ended

    def loop(self, node: ast.For, scope: Scope) -> tuple[list[ast.stmt], bool]:
        call = node.iter
        if not (
            isinstance(node.target, ast.Name)
            and not node.orelse
            and isinstance(call, ast.Call)
            and isinstance(call.func, ast.Name)
            and call.func.id == "range"
        ):
            raise self.cannot(node, "loops over something else than a range")
        bounds = [self.value(a, scope) for a in call.args]
        known = [int(b.value) for b in bounds if isinstance(b, Known)]
        if len(known) == len(bounds):
            turns = range(*known)
            if not turns:
                return [], False
            written_out = self.written_out(node, turns, scope)
            if written_out is not None:
                return written_out
        self.forget([node], scope)
        inner = dict(scope)
        body, _ = self.block(node.body, inner)
        self.forget([node], scope)
        if not body:
            return [], False
        return [ast.For(_store(node.target.id), _call("range", [_node(b) for b in bounds]), body, [])], False

    def written_out(self, node: ast.For, turns: range, scope: Scope) -> tuple[list[ast.stmt], bool] | None:
        """The turns of a loop one after another, and whether the end is never reached; None if that is too much."""
        assert isinstance(node.target, ast.Name)
        most = self.program.unroll
        if len(turns) * len(node.body) > most or _leaves(node.body):
            return None
        inner, arrays, pure, called, returned = (
            dict(scope),
            dict(self.arrays),
            self.pure,
            self.called,
            len(self.returned),
        )
        out: list[ast.stmt] = []
        ended = False
        for done, turn in enumerate(turns):
            inner[node.target.id] = Known(turn)
            out.append(_assign(node.target.id, ast.Constant(turn)))
            body, ended = self.block(node.body, inner)
            out += body
            written = _statements(out) + self.called - called
            if max(written, 0 if ended else written // (done + 1) * len(turns)) > most:
                self.arrays, self.pure, self.called = arrays, pure, called
                del self.returned[returned:]
                return None
            if ended:
                break
        _become(scope, inner)
        return out, ended

    def repeat(self, node: ast.While, scope: Scope) -> tuple[list[ast.stmt], bool]:
        if node.orelse:
            raise self.cannot(node, "has an else after its loop")
        first = self.test(node.test, scope)
        if isinstance(first, Known) and not first.value:
            return [], False
        self.forget(node.body, scope)
        test = self.test(node.test, dict(scope))
        body, _ = self.block(node.body, dict(scope))
        return [ast.While(_node(test), body or [ast.Pass()], [])], False

    def forget(self, statements: Sequence[ast.stmt], scope: Scope) -> None:
        """Nothing is known of a variable that a loop assigns to."""
        for name in _assigned(statements):
            if isinstance(scope.get(name), Memory | Named):
                raise self.cannot(statements[0], f"changes the buffer {name!r} in a loop")
            scope[name] = Later(_load(name))

    def give(self, node: ast.Return, scope: Scope) -> list[ast.stmt]:
        if node.value is None:
            self.returned.append(None)
            return [ast.Return(None)]
        value = self.value(node.value, scope)
        self.returned.append(value)
        return [ast.Return(_node(value))]

    def effect(self, node: ast.expr, scope: Scope) -> list[ast.stmt]:
        if isinstance(node, ast.Constant):
            return []  # a docstring
        if not isinstance(node, ast.Call):
            raise self.cannot(node, "does nothing")
        call, _ = self.call(node, scope)
        return [] if call is None else [ast.Expr(call)]

    # Expressions --------------------------------------------------------------------------------------------------

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
            return _from_call(*self.call(node, scope))
        if isinstance(node, ast.Tuple):
            parts = tuple(self.number(part, scope) for part in node.elts)
            return Several(parts, _tuple([_node(part) for part in parts]))
        if isinstance(node, ast.BinOp):
            return self.binary(node, scope)
        if isinstance(node, ast.UnaryOp):
            inner = self.number(node.operand, scope)
            if isinstance(inner, Known):
                return Known(UNARY[type(node.op)](inner.value))
            return Later(ast.UnaryOp(node.op, inner.node))
        if isinstance(node, ast.BoolOp):
            return self.logic(node, scope)
        if isinstance(node, ast.Compare):
            return self.compare(node, scope)
        if isinstance(node, ast.IfExp):
            test = self.test(node.test, scope)
            if isinstance(test, Known):
                return self.value(node.body if test.value else node.orelse, scope)
            one, other = self.number(node.body, scope), self.number(node.orelse, scope)
            return one if same(one, other) else Later(ast.IfExp(_node(test), _node(one), _node(other)))
        raise self.cannot(node, "is no expression of a kernel")

    def number(self, node: ast.expr, scope: Scope) -> Known | Later:
        value = self.value(node, scope)
        if isinstance(value, Known | Later):
            return value
        raise self.cannot(node, "is no number")

    def test(self, node: ast.expr, scope: Scope) -> Known | Later:
        found = self.number(node, scope)
        return Known(bool(found.value)) if isinstance(found, Known) else found

    def name(self, node: ast.Name, scope: Scope) -> Value:
        if node.id in scope:
            return scope[node.id]
        missing = object()
        found = self.kernel.namespace.get(node.id, getattr(builtins, node.id, missing))
        if found is missing:
            raise self.cannot(node, f"names {node.id!r}, which is nothing known here")
        return self.constant(node, found)

    def attribute(self, node: ast.Attribute, scope: Scope) -> Value:
        owner = self.value(node.value, scope)
        if not (isinstance(owner, Named) and isinstance(owner.of, ModuleType)):
            raise self.cannot(node, "is an attribute of something else than a module")
        return self.constant(node, getattr(owner.of, node.attr))

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
            if isinstance(index, Known) and isinstance(owner.parts[int(index.value)], Known):
                return owner.parts[int(index.value)]
            return Later(ast.Subscript(_node(owner), _node(index), ast.Load()))
        if isinstance(owner, Later):
            return Later(ast.Subscript(owner.node, _node(self.number(node.slice, scope)), ast.Load()))
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
        terms, offset = _terms(_node(index))
        offset += owner.base
        place: ast.expr | None = terms
        if lanes > 1:
            place = _load("lane") if terms is None else ast.BinOp(_times(terms, lanes), ast.Add(), _load("lane"))
            offset *= lanes
        if place is None:
            place = ast.Constant(offset)
        elif offset:
            sign = ast.Add() if offset > 0 else ast.Sub()
            place = ast.BinOp(place, sign, ast.Constant(abs(offset)))
        return ast.Subscript(_load(owner.array), place, ast.Store() if store else ast.Load())

    def binary(self, node: ast.BinOp, scope: Scope) -> Value:
        left, right = self.number(node.left, scope), self.number(node.right, scope)
        if isinstance(left, Known) and isinstance(right, Known):
            try:
                return Known(BINARY[type(node.op)](left.value, right.value))
            except (ZeroDivisionError, OverflowError):
                pass  # let it happen where and if it does
        return Later(ast.BinOp(_node(left), node.op, _node(right)))

    def logic(self, node: ast.BoolOp, scope: Scope) -> Value:
        settles = isinstance(node.op, ast.Or)  # the value that ends it
        left: list[ast.expr] = []
        for part in node.values:
            found = self.number(part, scope)
            if isinstance(found, Known):
                if bool(found.value) is settles:
                    if not left:
                        return found
                    left.append(_node(found))
                    break
                if part is not node.values[-1] or left:
                    continue
                return found
            left.append(found.node)
        return Later(left[0] if len(left) == 1 else ast.BoolOp(node.op, left))

    def compare(self, node: ast.Compare, scope: Scope) -> Value:
        operands = [self.number(part, scope) for part in (node.left, *node.comparators)]
        numbers = [o.value for o in operands if isinstance(o, Known)]
        if len(numbers) == len(operands):
            pairs = zip(numbers, node.ops, numbers[1:], strict=False)
            return Known(all(COMPARISONS[type(op)](a, b) for a, op, b in pairs))
        first, *others = map(_node, operands)
        return Later(ast.Compare(first, node.ops, others))

    def call(self, node: ast.Call, scope: Scope) -> tuple[ast.expr | None, Value | None]:
        """The call that is left, None if there is none, and what is known of its value."""
        called = self.value(node.func, scope)
        if not isinstance(called, Named) or isinstance(called.of, ModuleType):
            raise self.cannot(node, "calls something else than a function")
        function = called.of
        if isinstance(function, FunctionType):
            return self.specialised(node, function, scope)
        arguments = [self.number(a, scope) for a in node.args]
        if function in BUILTINS or getattr(math, getattr(function, "__name__", ""), None) is function:
            numbers = [a.value for a in arguments if isinstance(a, Known)]
            if len(numbers) == len(arguments):
                return None, Known(function(*numbers))
            name: ast.expr = _load(function.__name__)
            if function not in BUILTINS:
                name = ast.Attribute(_load("math"), function.__name__, ast.Load())
            return ast.Call(name, [_node(a) for a in arguments], []), None
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
        if made.pure and (known or result is None):
            return None, result or Known(0)
        self.pure = self.pure and made.pure
        self.called += made.statements
        for array in made.arrays:
            self.arrays[array] = None
        lane = [_load("lane")] if self.program.lanes > 1 else []
        later = [a.node for a in given if isinstance(a, Later)]
        call = ast.Call(_load(made.name), [*map(_load, made.arrays), *lane, *later], [])
        return call, result if isinstance(result, Known | Several) else None

    def cannot(self, node: ast.AST, why: str) -> GraspFXError:
        line = getattr(node, "lineno", self.tree.lineno)
        shown = ast.unparse(node).splitlines()[0] if isinstance(node, ast.expr | ast.stmt) else self.tree.name
        return InputError(f"{self.kernel.file}:{line}", shown, "what a kernel may hold", why)


def _subscript(body: _Body, node: ast.expr) -> ast.Subscript:
    if isinstance(node, ast.Subscript):
        return node
    raise body.cannot(node, "cannot be assigned to")


def _loaded(target: ast.expr) -> ast.expr:
    found = copy.copy(target)
    found.ctx = ast.Load()  # type: ignore[attr-defined] # targets have one
    return found


def _from_call(call: ast.expr | None, known: Value | None) -> Value:
    """A call as a value; no call where all that it gives is known."""
    if call is None:
        if isinstance(known, Several):
            return Several(known.parts, _tuple([_node(part) for part in known.parts]))
        return known or Known(0)
    return Several(known.parts, call) if isinstance(known, Several) else Later(call)


def _calls(node: ast.expr) -> bool:
    return any(isinstance(n, ast.Call) for n in ast.walk(node))


def _terms(node: ast.expr) -> tuple[ast.expr | None, int]:
    """A sum of whole numbers without its constants, and their sum."""
    if isinstance(node, ast.Constant) and isinstance(node.value, int):
        return None, node.value
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
        left, a = _terms(node.left)
        right, b = _terms(node.right)
        minus = isinstance(node.op, ast.Sub)
        total = a - b if minus else a + b
        if right is None:
            return left, total
        if left is None:
            return (ast.UnaryOp(ast.USub(), right) if minus else right), total
        return ast.BinOp(left, node.op, right), total
    return node, 0


def _times(node: ast.expr, lanes: int) -> ast.expr:
    return ast.BinOp(node, ast.Mult(), ast.Constant(lanes))


def _joined(name: str, one: Value, other: Value) -> Value:
    return one if same(one, other) else Later(_load(name))


def _become(scope: Scope, other: Scope) -> None:
    scope.clear()
    scope.update(other)


def _assigned(statements: Sequence[ast.stmt]) -> set[str]:
    return {
        node.id
        for statement in statements
        for node in ast.walk(statement)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    }


def _leaves(statements: Sequence[ast.stmt]) -> bool:
    """Whether a loop's body has a break or continue of its own."""
    for statement in statements:
        if isinstance(statement, ast.Break | ast.Continue):
            return True
        if isinstance(statement, ast.If) and (_leaves(statement.body) or _leaves(statement.orelse)):
            return True
    return False


def _statements(statements: Sequence[ast.stmt]) -> int:
    """How many there are, inner ones too."""
    return sum(isinstance(node, ast.stmt) for statement in statements for node in ast.walk(statement))


def _without_unused(statements: list[ast.stmt]) -> list[ast.stmt]:
    """Without constants that are assigned to variables that nothing reads."""
    while True:
        read = {
            node.id
            for statement in statements
            for node in ast.walk(statement)
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)
        }
        pruner = _Pruner(read)
        statements = [kept for s in statements if (kept := pruner.visit(s)) is not None]
        if not pruner.dropped:
            return statements


class _Pruner(ast.NodeTransformer):
    def __init__(self, read: set[str]) -> None:
        self.read, self.dropped = read, False

    def visit_Assign(self, node: ast.Assign) -> ast.stmt | None:
        target = node.targets[0]
        names = [target] if isinstance(target, ast.Name) else target.elts if isinstance(target, ast.Tuple) else []
        unread = names and all(isinstance(n, ast.Name) and n.id not in self.read for n in names)
        if unread and not _calls(node.value):
            self.dropped = True
            return None
        return node

    def visit_If(self, node: ast.If) -> ast.stmt | None:
        self.generic_visit(node)
        if node.body or node.orelse or _calls(node.test):
            node.body = node.body or [ast.Pass()]
            return node
        self.dropped = True
        return None

    def visit_For(self, node: ast.For) -> ast.stmt | None:
        self.generic_visit(node)
        self.dropped = self.dropped or not node.body
        return node if node.body else None

    def visit_While(self, node: ast.While) -> ast.stmt:
        self.generic_visit(node)
        node.body = node.body or [ast.Pass()]
        return node


def _constant(value: Number) -> ast.expr:
    if isinstance(value, float) and math.isnan(value):
        return _load("nan")
    if isinstance(value, float) and math.isinf(value):
        return _load("inf") if value > 0.0 else ast.UnaryOp(ast.USub(), _load("inf"))
    if value < 0 or (value == 0 and math.copysign(1.0, value) < 0.0):
        return ast.UnaryOp(ast.USub(), ast.Constant(-value))  # in a power it must be written in brackets
    return ast.Constant(value)


def _node(value: Value) -> ast.expr:
    if isinstance(value, Known):
        return _constant(value.value)
    if isinstance(value, Later | Several) and value.node is not None:
        return value.node
    raise InputError("kernel", value, "a number")


def _load(name: str) -> ast.Name:
    return ast.Name(name, ast.Load())


def _store(name: str) -> ast.Name:
    return ast.Name(name, ast.Store())


def _assign(name: str, value: ast.expr) -> ast.Assign:
    return ast.Assign([_store(name)], value)


def _tuple(parts: Sequence[ast.expr], *, store: bool = False) -> ast.Tuple:
    return ast.Tuple(list(parts), ast.Store() if store else ast.Load())


def _call(name: str, arguments: Sequence[ast.expr]) -> ast.Call:
    return ast.Call(_load(name), list(arguments), [])
