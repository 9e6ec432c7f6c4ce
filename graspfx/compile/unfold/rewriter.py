"""Stages rewritten into functions that write a program: static parts run now, what is left is put down."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType
from typing import TypedDict

from graspfx.compile.unfold.stage import FRAME
from graspfx.errors import InputError

SIGNS: dict[type[ast.operator], str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.FloorDiv: "//", ast.Mod: "%"
}  # fmt: skip

LOAD, STORE = ast.Load(), ast.Store()


class Place(TypedDict):
    """Where a node stands: on one line, for Python names a call by the last line of what is called."""

    lineno: int
    col_offset: int
    end_lineno: int
    end_col_offset: int


def rewrite_code(function: FunctionType) -> CodeType:
    """Rewrite a module with a function of a frame and a stage's arguments, with the stage's name, file and lines.

    Raises:
        InputError: the stage holds something that no stage can.
    """
    code = function.__code__
    node = _definitions(code.co_filename).get(code.co_firstlineno)
    if node is None or node.name != code.co_name or code.co_freevars:
        place = f"{code.co_filename}:{code.co_firstlineno}"
        raise InputError(place, function.__qualname__, "a function of a module, in a file that can be read")
    module = ast.Module([Rewriter(code.co_filename).function(node)], [])
    return compile(module, code.co_filename, "exec", dont_inherit=True)


@cache
def _definitions(file: str) -> dict[int, ast.FunctionDef]:
    """Index the functions of a file by their first line; none where it cannot be read."""
    try:
        tree = ast.parse(Path(file).read_bytes())
    except (OSError, SyntaxError):
        return {}
    functions = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    return {min([node.lineno, *(d.lineno for d in node.decorator_list)]): node for node in functions}


class Rewriter:
    """The syntax of one stage, rewritten.

    A statement `a[i] = b[j] * x` becomes `frame.store(a, i, frame.item(b, j) * x)`: loops, attributes and arithmetic
    of static values stay as they are.
    """

    def __init__(self, file: str) -> None:
        self.file = file
        self.choices = 0
        self.open: list[str] = []  # choices around a statement; "" for a loop
        self.place: Place = _place(1)

    def function(self, node: ast.FunctionDef) -> ast.FunctionDef:
        arguments = node.args
        if arguments.vararg or arguments.kwarg or arguments.posonlyargs or arguments.kwonlyargs or arguments.defaults:
            raise self.cannot(node, "plain parameters")
        self.place = place = _place(node.lineno)
        parameters = [a.arg for a in arguments.args]
        variables = sorted(set(_assigned(node.body)) - set(parameters))
        start: list[ast.stmt] = []
        if variables:
            unbound = ast.Attribute(self.name(FRAME), "unbound", LOAD, **place)
            start = [ast.Assign([self.name(v, STORE) for v in variables], unbound, **place)]
        body = [*start, *self.block(node.body)] or [ast.Pass(**place)]
        return ast.FunctionDef(
            node.name, _parameters([FRAME, *parameters], place), body, decorator_list=[], type_params=[], **place
        )

    def block(self, statements: Sequence[ast.stmt]) -> list[ast.stmt]:
        lines: list[ast.stmt] = []
        for statement in statements:
            self.place = _place(statement.lineno)
            lines += self.statement(statement)
        return lines

    def statement(self, node: ast.stmt) -> list[ast.stmt]:
        place = self.place
        if isinstance(node, ast.Assign) and len(node.targets) == 1:
            return [self.assign(node.targets[0], node.value)]
        if isinstance(node, ast.AnnAssign) and node.value is not None:
            return [self.assign(node.target, node.value)]
        if isinstance(node, ast.AugAssign):
            return [self.augment(node)]
        if isinstance(node, ast.Expr):
            if isinstance(node.value, ast.Constant):
                return []  # a docstring
            return [ast.Expr(self.frame("do", self.statement_value(node.value)), **place)]
        if isinstance(node, ast.If):
            return self.branch(node)
        if isinstance(node, ast.For) and not node.orelse:
            turns = self.frame("turns", self.value(node.iter))
            self.open.append("")
            body = self.block(node.body) or [ast.Pass(**place)]
            self.open.pop()
            return [ast.For(self.names(node.target), turns, body, [], **place)]
        if isinstance(node, ast.Return):
            value = None if node.value is None else self.statement_value(node.value)
            return [*self.leave(self.open), ast.Return(value, **place)]
        if isinstance(node, ast.Break | ast.Continue):
            first = len(self.open) - 1 - self.open[::-1].index("")
            return [*self.leave(self.open[first:]), node]
        if isinstance(node, ast.Pass):
            return [node]
        raise self.cannot(node, "a statement of a stage")

    def assign(self, target: ast.expr, value: ast.expr) -> ast.stmt:
        if isinstance(target, ast.Name):
            return ast.Assign(
                [target], self.frame("assign", self.constant(target.id), self.statement_value(value)), **self.place
            )
        if isinstance(target, ast.Subscript):
            entry = self.value(target.value), self.value(target.slice)
            return ast.Expr(self.frame("store", *entry, self.statement_value(value)), **self.place)
        return ast.Assign([self.names(target)], self.value(value), **self.place)

    def augment(self, node: ast.AugAssign) -> ast.stmt:
        if type(node.op) not in SIGNS:
            raise self.cannot(node, f"one of {' '.join(SIGNS.values())}")
        sign, value = self.constant(SIGNS[type(node.op)]), self.value(node.value)
        if isinstance(node.target, ast.Name):
            name = node.target.id
            call = self.frame("augment", self.constant(name), self.name(name), sign, value)
            return ast.Assign([node.target], call, **self.place)
        if isinstance(node.target, ast.Subscript):
            entry = self.value(node.target.value), self.value(node.target.slice)
            return ast.Expr(self.frame("augment_entry", *entry, sign, value), **self.place)
        raise self.cannot(node, "a name or an entry to change")

    def branch(self, node: ast.If) -> list[ast.stmt]:
        """Write both sides of a choice, of which the frame runs one now, or writes both down."""
        place = self.place
        self.choices += 1
        choice = f"_choice{self.choices}"
        changed = sorted({*_assigned(node.body), *_assigned(node.orelse)})
        test = self.frame("choose", self.value(node.test), *map(self.name, changed))
        first = ast.Assign([self.name(choice, STORE)], test, **place)
        holds, fails = self.call(choice, "holds"), self.call(choice, "fails")
        turn, close = (self.hand_over(choice, method, changed) for method in ("turn", "close"))
        self.open.append(choice)
        lines = [first, ast.If(holds, self.block(node.body) or [ast.Pass(**place)], [], **place)]
        if node.orelse:
            lines.append(ast.If(fails, [turn, *self.block(node.orelse)], [], **place))
        self.open.pop()
        return [*lines, close]

    def hand_over(self, choice: str, method: str, changed: Sequence[str]) -> ast.stmt:
        """Hand over the values that variables have from here on, by a choice and what they are now."""
        call = self.call(choice, method, *map(self.name, changed))
        if not changed:
            return ast.Expr(call, **self.place)
        names = ast.Tuple([self.name(name, STORE) for name in changed], STORE, **self.place)
        return ast.Assign([names], call, **self.place)

    def leave(self, choices: Sequence[str]) -> list[ast.stmt]:
        """Check that no choice which the program makes stands around a way out."""
        names = [self.name(name) for name in choices if name]
        return [ast.Expr(self.frame("leave", *names), **self.place)] if names else []

    def names(self, target: ast.expr) -> ast.expr:
        parts = target.elts if isinstance(target, ast.Tuple) else [target]
        if not all(isinstance(part, ast.Name) for part in parts):
            raise self.cannot(target, "names to assign to")
        return target

    # Expressions --------------------------------------------------------------------------------------------------

    def statement_value(self, node: ast.expr) -> ast.expr:
        """Write the value of a statement, which may be a call of another stage."""
        return self.call_of(node, "call") if isinstance(node, ast.Call) else self.value(node)

    def value(self, node: ast.expr) -> ast.expr:
        place = self.place
        if isinstance(node, ast.Constant | ast.Name):
            return node
        if isinstance(node, ast.Attribute):
            return ast.Attribute(self.value(node.value), node.attr, LOAD, **place)
        if isinstance(node, ast.Subscript):
            return self.frame("item", self.value(node.value), self.value(node.slice))
        if isinstance(node, ast.Slice):
            ends = [self.constant(None) if e is None else self.value(e) for e in (node.lower, node.upper, node.step)]
            return ast.Call(self.name("slice"), ends, [], **place)
        if isinstance(node, ast.Call):
            return self.call_of(node, "call_inside")
        if isinstance(node, ast.BinOp) and type(node.op) in SIGNS:
            return ast.BinOp(self.value(node.left), node.op, self.value(node.right), **place)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return self.frame("negate", self.value(node.operand))
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            return ast.UnaryOp(node.op, self.value(node.operand), **place)
        if isinstance(node, ast.BoolOp):
            parts = [ast.Lambda(_parameters([], place), self.value(part), **place) for part in node.values]
            return self.frame("disjunction" if isinstance(node.op, ast.Or) else "conjunction", *parts)
        if isinstance(node, ast.Compare) and len(node.ops) == 1:
            return ast.Compare(self.value(node.left), node.ops, [self.value(node.comparators[0])], **place)
        if isinstance(node, ast.IfExp):
            return ast.IfExp(self.value(node.test), self.value(node.body), self.value(node.orelse), **place)
        raise self.cannot(node, "an expression of a stage")

    def call_of(self, node: ast.Call, method: str) -> ast.expr:
        if any(isinstance(a, ast.Starred) for a in node.args) or any(k.arg is None for k in node.keywords):
            raise self.cannot(node, "arguments one by one")
        call = self.frame(method, self.value(node.func), *map(self.value, node.args))
        call.keywords = [ast.keyword(k.arg, self.value(k.value), **self.place) for k in node.keywords]
        return call

    def frame(self, method: str, *arguments: ast.expr) -> ast.Call:
        return self.call(FRAME, method, *arguments)

    def call(self, owner: str, method: str, *arguments: ast.expr) -> ast.Call:
        place = self.place
        return ast.Call(ast.Attribute(self.name(owner), method, LOAD, **place), list(arguments), [], **place)

    def name(self, name: str, context: ast.expr_context = LOAD) -> ast.Name:
        return ast.Name(name, context, **self.place)

    def constant(self, value: str | None) -> ast.Constant:
        return ast.Constant(value, **self.place)

    def cannot(self, node: ast.expr | ast.stmt, expected: str) -> InputError:
        return InputError(f"{self.file}:{node.lineno}", ast.unparse(node).splitlines()[0], expected)


def _place(line: int) -> Place:
    return {"lineno": line, "col_offset": 0, "end_lineno": line, "end_col_offset": 0}


def _parameters(names: Sequence[str], place: Place) -> ast.arguments:
    arguments = [ast.arg(name, **place) for name in names]
    return ast.arguments(posonlyargs=[], args=arguments, kwonlyargs=[], kw_defaults=[], defaults=[])


def _assigned(statements: Sequence[ast.stmt]) -> Iterator[str]:
    """List the names that some statements assign to."""
    for node in statements:
        targets: Sequence[ast.expr] = ()
        if isinstance(node, ast.Assign):
            targets = node.targets
        elif isinstance(node, ast.AugAssign | ast.AnnAssign | ast.For):
            targets = [node.target]
        for target in targets:
            yield from (n.id for n in getattr(target, "elts", [target]) if isinstance(n, ast.Name))
        if isinstance(node, ast.For | ast.If):
            yield from _assigned(node.body)
            yield from _assigned(node.orelse)
