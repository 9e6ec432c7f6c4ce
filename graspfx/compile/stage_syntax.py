"""Stages rewritten into functions that write a program: static parts run now, what is left is put down."""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from functools import lru_cache
from types import FunctionType
from typing import Any, TypeVar

from graspfx.compile.source import definition
from graspfx.compile.syntax import assigned, load, store
from graspfx.errors import InputError

FRAME = "_frame"  # the name under which a rewritten stage knows what it writes to

SIGNS: dict[type[ast.operator], str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.FloorDiv: "//", ast.Mod: "%"
}  # fmt: skip
Node = TypeVar("Node", ast.stmt, ast.expr, ast.FunctionDef, ast.Call)
LEAVES = (ast.Constant, ast.Name)


@lru_cache(maxsize=None)
def rewritten(function: FunctionType) -> Callable[..., Any]:
    """A function of a frame and a stage's arguments; it has the stage's names, file and lines.

    Raises:
        InputError: the stage holds something that no stage can.
    """
    code = function.__code__
    if code.co_freevars:
        raise InputError(f"{code.co_filename}:{code.co_firstlineno}", function.__qualname__, "a stage of a module")
    tree = Rewriter(code.co_filename).function(definition(function))
    module = ast.fix_missing_locations(ast.Module([tree], []))
    names: dict[str, Any] = {}
    exec(compile(module, code.co_filename, "exec", dont_inherit=True), function.__globals__, names)
    result: Callable[..., Any] = names[tree.name]
    return result


class Rewriter:
    """The syntax of one stage, rewritten.

    A statement `a[i] = b[j] * x` becomes `frame.store(a, i, frame.item(b, j) * x)`: loops, attributes and arithmetic
    of static values stay as they are.
    """

    def __init__(self, file: str) -> None:
        self.file = file
        self.choices = 0
        self.open: list[str] = []  # choices around a statement; "" for a loop

    def function(self, node: ast.FunctionDef) -> ast.FunctionDef:
        arguments = node.args
        if arguments.vararg or arguments.kwarg or arguments.posonlyargs or arguments.kwonlyargs or arguments.defaults:
            raise self.cannot(node, "plain parameters")
        parameters = [a.arg for a in arguments.args]
        variables = sorted(assigned(node.body) - set(parameters))
        body = self.block(node.body)
        if variables:
            body.insert(
                0, ast.Assign([store(name) for name in variables], ast.Attribute(load(FRAME), "nothing", ast.Load()))
            )
        plain = ast.arguments(
            posonlyargs=[], args=[ast.arg(FRAME), *(ast.arg(p) for p in parameters)], kwonlyargs=[], kw_defaults=[], defaults=[]
        )  # fmt: skip
        made = ast.FunctionDef(node.name, plain, body or [ast.Pass()], [], type_params=[])
        return _at(node, made)

    def block(self, statements: Sequence[ast.stmt]) -> list[ast.stmt]:
        lines: list[ast.stmt] = []
        for statement in statements:
            for line in self.statement(statement):
                lines.append(_at(statement, line))
        return lines

    def statement(self, node: ast.stmt) -> list[ast.stmt]:
        if isinstance(node, ast.Assign) and len(node.targets) == 1:
            return [self.assign(node.targets[0], node.value)]
        if isinstance(node, ast.AnnAssign) and node.value is not None:
            return [self.assign(node.target, node.value)]
        if isinstance(node, ast.AugAssign):
            return [self.augment(node)]
        if isinstance(node, ast.Expr):
            if isinstance(node.value, ast.Constant):
                return []  # a docstring
            return [ast.Expr(self.frame("do", self.whole(node.value)))]
        if isinstance(node, ast.If):
            return self.branch(node)
        if isinstance(node, ast.For) and not node.orelse:
            self.open.append("")
            body = self.block(node.body)
            self.open.pop()
            return [
                ast.For(self.names(node.target), self.frame("turns", self.value(node.iter)), body or [ast.Pass()], [])
            ]
        if isinstance(node, ast.Return):
            given = ast.Return(None if node.value is None else self.whole(node.value))
            return [*self.leave(self.open), given]
        if isinstance(node, ast.Break | ast.Continue):
            first = len(self.open) - 1 - self.open[::-1].index("")
            return [*self.leave(self.open[first:]), node]
        if isinstance(node, ast.Pass):
            return [node]
        raise self.cannot(node, "a statement of a stage")

    def assign(self, target: ast.expr, value: ast.expr) -> ast.stmt:
        if isinstance(target, ast.Name):
            return ast.Assign([target], self.frame("assign", ast.Constant(target.id), self.whole(value)))
        if isinstance(target, ast.Subscript):
            place = self.value(target.value), self.value(target.slice)
            return ast.Expr(self.frame("store", *place, self.whole(value)))
        return ast.Assign([self.names(target)], self.value(value))

    def augment(self, node: ast.AugAssign) -> ast.stmt:
        sign, value = ast.Constant(self.sign(node)), self.value(node.value)
        if isinstance(node.target, ast.Name):
            name = node.target.id
            return ast.Assign([store(name)], self.frame("augment", ast.Constant(name), load(name), sign, value))
        if isinstance(node.target, ast.Subscript):
            place = self.value(node.target.value), self.value(node.target.slice)
            return ast.Expr(self.frame("augment_entry", *place, sign, value))
        raise self.cannot(node, "a name or an entry to change")

    def sign(self, node: ast.AugAssign) -> str:
        if type(node.op) not in SIGNS:
            raise self.cannot(node, f"one of {' '.join(SIGNS.values())}")
        return SIGNS[type(node.op)]

    def branch(self, node: ast.If) -> list[ast.stmt]:
        """Both sides of a choice, of which the frame runs one now, or writes both down."""
        self.choices += 1
        choice = f"_choice{self.choices}"
        changed = sorted(assigned(node.body) | assigned(node.orelse))
        values = [load(name) for name in changed]
        open_ = ast.Assign([store(choice)], self.frame("choose", self.value(node.test), *values))
        self.open.append(choice)
        holds = ast.If(_call(choice, "holds"), self.block(node.body) or [ast.Pass()], [])
        lines: list[ast.stmt] = [open_, holds]
        if node.orelse:
            turn = [_take(choice, "turn", changed)] if changed else []
            lines.append(ast.If(_call(choice, "fails"), [*turn, *self.block(node.orelse)], []))
        self.open.pop()
        return [*lines, _take(choice, "close", changed)]

    def leave(self, choices: Sequence[str]) -> list[ast.stmt]:
        """A check that no choice which the program makes stands around what leaves it."""
        names = [load(name) for name in choices if name]
        return [ast.Expr(self.frame("leave", *names))] if names else []

    def names(self, target: ast.expr) -> ast.expr:
        if isinstance(target, ast.Name):
            return target
        if isinstance(target, ast.Tuple):
            for part in target.elts:
                self.names(part)
            return target
        raise self.cannot(target, "names to assign to")

    # Expressions --------------------------------------------------------------------------------------------------

    def whole(self, node: ast.expr) -> ast.expr:
        """The value of a statement, which may be a call of another stage."""
        return self.call(node, "call") if isinstance(node, ast.Call) else self.value(node)

    def value(self, node: ast.expr) -> ast.expr:
        found = self._value(node)
        return found if found is node else _at(node, found)

    def _value(self, node: ast.expr) -> ast.expr:
        if isinstance(node, LEAVES):
            return node
        if isinstance(node, ast.Attribute):
            return ast.Attribute(self.value(node.value), node.attr, ast.Load())
        if isinstance(node, ast.Subscript):
            return self.frame("item", self.value(node.value), self.value(node.slice))
        if isinstance(node, ast.Slice):
            return _call_name("slice", [ast.Constant(None) if p is None else self.value(p) for p in _ends(node)])
        if isinstance(node, ast.Call):
            return self.call(node, "inner")
        if isinstance(node, ast.BinOp) and type(node.op) in SIGNS:
            return ast.BinOp(self.value(node.left), node.op, self.value(node.right))
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return self.frame("negate", self.value(node.operand))
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            return ast.UnaryOp(node.op, self.value(node.operand))
        if isinstance(node, ast.BoolOp):
            method = "either" if isinstance(node.op, ast.Or) else "both"
            return self.frame(method, *(_later(self.value(part)) for part in node.values))
        if isinstance(node, ast.Compare) and len(node.ops) == 1:
            return ast.Compare(self.value(node.left), node.ops, [self.value(node.comparators[0])])
        if isinstance(node, ast.IfExp):
            return ast.IfExp(*(self.value(part) for part in (node.test, node.body, node.orelse)))
        raise self.cannot(node, "an expression of a stage")

    def call(self, node: ast.Call, method: str) -> ast.expr:
        if any(isinstance(a, ast.Starred) for a in node.args) or any(k.arg is None for k in node.keywords):
            raise self.cannot(node, "arguments one by one")
        call = self.frame(method, self.value(node.func), *map(self.value, node.args))
        call.keywords = [ast.keyword(k.arg, self.value(k.value)) for k in node.keywords]
        return _at(node, call)

    def frame(self, method: str, *arguments: ast.expr) -> ast.Call:
        return _call(FRAME, method, *arguments)

    def cannot(self, node: ast.expr | ast.stmt, expected: str) -> InputError:
        return InputError(f"{self.file}:{node.lineno}", ast.unparse(node).splitlines()[0], expected)


def _at(origin: ast.stmt | ast.expr, node: Node) -> Node:
    """The node on the first line of another, where Python says that it runs."""
    node.lineno = node.end_lineno = origin.lineno
    node.col_offset = node.end_col_offset = 0
    return node


def _call(owner: str, method: str, *arguments: ast.expr) -> ast.Call:
    return ast.Call(ast.Attribute(load(owner), method, ast.Load()), list(arguments), [])


def _call_name(name: str, arguments: list[ast.expr]) -> ast.Call:
    return ast.Call(load(name), arguments, [])


def _take(choice: str, method: str, changed: Sequence[str]) -> ast.stmt:
    """The values that variables have from here on, by a choice and what they are now."""
    call = _call(choice, method, *map(load, changed))
    if not changed:
        return ast.Expr(call)
    return ast.Assign([ast.Tuple([store(name) for name in changed], ast.Store())], call)


def _later(value: ast.expr) -> ast.expr:
    nothing = ast.arguments(posonlyargs=[], args=[], kwonlyargs=[], kw_defaults=[], defaults=[])
    return ast.Lambda(nothing, value)


def _ends(node: ast.Slice) -> tuple[ast.expr | None, ast.expr | None, ast.expr | None]:
    return node.lower, node.upper, node.step
