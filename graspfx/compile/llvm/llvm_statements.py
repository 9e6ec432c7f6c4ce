"""LLVM text of a program's statements. A variable has a separate memory location for each of its types."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from graspfx.compile.llvm.llvm_arithmetic import BOOL, FLOAT, INT, LlvmFunction, Number, Type, binary, convert, widest
from graspfx.compile.llvm.llvm_expressions import (
    Array,
    Expressions,
    Functions,
    Tuple,
    Value,
    Variables,
    result_type,
)


@dataclass
class Join:
    """Point at which several paths of a function join.

    Attributes:
        label: Label of the block that begins at the point.
        edges: For each path, the index of the line with the jump, and the types of the variables at the jump.
    """

    label: str
    edges: list[tuple[int, Variables]] = field(default_factory=list)


@dataclass
class Loop:
    """Targets of `continue` (`again`) and of `break` (`after`) in a loop."""

    again: Join
    after: Join


class Statements(Expressions):
    """Translates one function for one combination of argument types."""

    def __init__(self, functions: Functions, node: ast.FunctionDef) -> None:
        super().__init__(functions, node)
        self.returns: list[tuple[int, Number | Tuple | None]] = []

    def function_text(self, name: str, arguments: Sequence[Value]) -> tuple[LlvmFunction, str]:
        """Translate the function; return its name with the type of its result, and its LLVM text."""
        scope: Variables = {}
        parameters = []
        roots = [a.root for a in arguments if isinstance(a, Array)]
        for k, (parameter, argument) in enumerate(zip(self.tree.args.args, arguments, strict=True)):
            if isinstance(argument, Array):
                alone = "noalias " if roots.count(argument.root) == 1 else ""
                parameters.append(f"ptr {alone}%p{k}")
                scope[parameter.arg] = Array(argument.root, f"%p{k}")
                continue
            parts = argument.parts if isinstance(argument, Tuple) else (argument,)
            here = [Number(part.type, f"%p{k}.{i}") for i, part in enumerate(parts)]
            parameters += [f"{part.type} {part.text}" for part in here]
            self.assign(parameter.arg, Tuple(tuple(here)) if isinstance(argument, Tuple) else here[0], scope)
        if not self.block(self.tree.body, scope, None):
            self.give(None)
        result = self.returned()
        for place, value in self.returns:
            self.code.lines[place] = self.exit(value, result)
        slots = (f"  {slot} = alloca {type_}" for slot, type_ in self.code.slots.items())
        head = f'define internal {result_type(result)} @"{name}"({", ".join(parameters)}) nounwind {{'
        return LlvmFunction(name, result), "\n".join([head, "start:", *slots, *self.code.lines, "}"])

    # Results ---------------------------------------------------------------------------------------------------------

    def give(self, value: Number | Tuple | None) -> None:
        self.code.lines.append("")
        self.returns.append((len(self.code.lines) - 1, value))

    def returned(self) -> Type:
        """Return the common type of the values of all return statements; None if there are none."""
        result: Type = None
        for _, value in self.returns:
            if value is not None:
                type_ = type_of(value)
                result = type_ if result is None else joined(result, type_)
                if result is None:
                    raise self.cannot(self.tree, "returns a tuple on one path and another type on another")
        return result

    def exit(self, value: Number | Tuple | None, result: Type) -> str:
        if result is None:
            return "  ret void"
        if value is None:
            return f"  ret {result_type(result)} zeroinitializer"

        def write() -> Number:
            if isinstance(result, str):
                assert isinstance(value, Number)
                return convert(self.code, value, result)
            assert isinstance(value, Tuple) and result is not None
            whole = "undef"
            for k, (part, to) in enumerate(zip(value.parts, result, strict=True)):
                number = convert(self.code, part, to)
                text = f"insertvalue {result_type(result)} {whole}, {to} {number.text}, {k}"
                whole = self.code.op("", text).text
            return Number("", whole)

        number, text = self.detached(write)
        return "\n".join([*text, f"  ret {result_type(result)} {number.text}"])

    # Joins -----------------------------------------------------------------------------------------------------------

    def leave(self, join: Join, scope: Variables) -> None:
        self.code.lines.append("")
        join.edges.append((len(self.code.lines) - 1, dict(scope)))

    def seal(self, join: Join, to: Variables) -> None:
        """Write the jumps to a join, each preceded by conversions of variables to the types `to` after the join."""
        for place, scope in join.edges:
            _, text = self.detached(lambda variables=scope: self.adapt(variables, to))  # type: ignore[misc]
            self.code.lines[place] = "\n".join([*text, f"  br label {join.label}"])

    def adapt(self, variables: Variables, to: Variables) -> Number:
        for name, type_ in to.items():
            before = variables.get(name)
            if before == type_ or isinstance(type_, Array) or before is None or type_ is None:
                continue
            pairs: Iterable[tuple[str, str, str]]
            if isinstance(type_, str):
                assert isinstance(before, str)
                pairs = [(name, before, type_)]
            else:
                assert isinstance(before, tuple)
                pairs = [(f"{name}.{k}", str(a), b) for k, (a, b) in enumerate(zip(before, type_, strict=True))]
            for slot, a, b in pairs:
                if a != b:
                    self.store(slot, convert(self.code, self.load(slot, a), b))
        return Number(BOOL, "true")

    def meet_here(self, join: Join, scope: Variables) -> bool:
        """Continue the text at a join of branches; return whether the join is unreachable."""
        if not join.edges:
            return True
        to = together(variables for _, variables in join.edges)
        self.seal(join, to)
        self.code.begin(join.label)
        scope.clear()
        scope.update(to)
        return False

    # Statements ---------------------------------------------------------------------------------------------------

    def block(self, statements: Sequence[ast.stmt], scope: Variables, loop: Loop | None) -> bool:
        """Write statements in order; return whether the end of the statements is unreachable."""
        return any(self.statement(statement, scope, loop) for statement in statements)

    def statement(self, node: ast.stmt, scope: Variables, loop: Loop | None) -> bool:
        match node:
            case ast.Assign():
                value = self.value(node.value, scope)
                for target in node.targets:
                    self.put(target, value, scope)
                return False
            case ast.AugAssign():
                self.augment(node, scope)
                return False
            case ast.If():
                return self.branch(node, scope, loop)
            case ast.While(orelse=[]):
                return self.repeat(node, scope)
            case ast.For(target=ast.Name(), orelse=[], iter=ast.Call(func=ast.Name(id="range"), keywords=[])):
                return self.count(node, scope)
            case ast.Return():
                result = None if node.value is None else self.value(node.value, scope)
                if isinstance(result, Array):
                    raise self.cannot(node, "returns a buffer")
                self.give(result)
                return True
            case ast.Break() | ast.Continue() if loop is not None:
                self.leave(loop.after if isinstance(node, ast.Break) else loop.again, scope)
                return True
            case ast.Expr(value=ast.Call() as call):
                self.call(call, scope)
                return False
            case ast.Pass() | ast.Expr(value=ast.Constant()):
                return False
        raise self.cannot(node, "is not a statement that can be compiled")

    def put(self, target: ast.expr, value: Value, scope: Variables) -> None:
        if isinstance(value, Array):
            raise self.cannot(target, "cannot be a buffer")
        match target:
            case ast.Name(id=name):
                self.assign(name, value, scope)
            case ast.Subscript():
                array = self.value(target.value, scope)
                if not isinstance(array, Array) or not isinstance(value, Number):
                    raise self.cannot(target, "is not an entry of a buffer, or its new value is not a number")
                self.write(self.entry(array, target.slice, scope), value)
            case ast.Tuple(elts=targets):
                if isinstance(value, Number) and value.text == "undef":
                    value = Tuple((value,) * len(targets))
                if not isinstance(value, Tuple) or len(value.parts) != len(targets):
                    raise self.cannot(target, "has a different number of targets and values")
                for part, item in zip(targets, value.parts, strict=True):
                    self.put(part, item, scope)
            case _:
                raise self.cannot(target, "cannot be assigned to")

    def assign(self, name: str, value: Number | Tuple, scope: Variables) -> None:
        if isinstance(value, Number):
            self.store(name, value)
        else:
            for k, part in enumerate(value.parts):
                self.store(f"{name}.{k}", part)
        scope[name] = type_of(value)

    def store(self, name: str, value: Number) -> None:
        self.code.put(f"store {value.type} {value.text}, ptr {self.slot(name, value.type)}")

    def write(self, address: str, value: Number) -> None:
        self.code.put(f"store double {convert(self.code, value, FLOAT).text}, ptr {address}")

    def augment(self, node: ast.AugAssign, scope: Variables) -> None:
        if isinstance(node.target, ast.Name):
            old = self.number(ast.Name(node.target.id, ast.Load()), scope)
            self.assign(node.target.id, binary(self.code, node.op, old, self.number(node.value, scope)), scope)
            return
        array = self.value(node.target.value, scope)
        if not isinstance(node.target, ast.Subscript) or not isinstance(array, Array):
            raise self.cannot(node, "changes something other than a variable or an entry of a buffer")
        address = self.entry(array, node.target.slice, scope)
        old = self.code.op(FLOAT, f"load double, ptr {address}")
        self.write(address, binary(self.code, node.op, old, self.number(node.value, scope)))

    def branch(self, node: ast.If, scope: Variables, loop: Loop | None) -> bool:
        code = self.code
        one, other, end = code.name("b"), code.name("b"), Join(code.name("b"))
        self.test(node.test, one, other, scope)
        for label, statements in ((one, node.body), (other, node.orelse)):
            code.begin(label)
            inner = dict(scope)
            if not self.block(statements, inner, loop):
                self.leave(end, inner)
        return self.meet_here(end, scope)

    def repeat(self, node: ast.While, scope: Variables) -> bool:
        return self.turns(
            node.body,
            scope,
            test=lambda inner, on, off: self.test(node.test, on, off, inner),
            enter=lambda inner: None,
            advance=lambda: None,
        )

    def count(self, node: ast.For, scope: Variables) -> bool:
        code = self.code
        assert isinstance(node.iter, ast.Call) and isinstance(node.target, ast.Name)
        target = node.target.id
        bounds = [self.number(a, scope) for a in node.iter.args]
        if not 1 <= len(bounds) <= 3 or any(b.type == FLOAT for b in bounds):
            raise self.cannot(node, "must have one to three integer arguments")
        bounds = [convert(code, b, INT) for b in bounds]
        start, stop = (Number(INT, "0"), bounds[0]) if len(bounds) == 1 else bounds[:2]
        step = bounds[2] if len(bounds) == 3 else Number(INT, "1")
        turn = f"turn {code.count}"
        self.store(turn, start)

        def test(inner: Variables, on: str, off: str) -> None:
            k = self.load(turn, INT)
            below = code.op(BOOL, f"icmp slt i64 {k.text}, {stop.text}")
            if step.text.isdigit():
                code.choose(below, on, off)
                return
            above = code.op(BOOL, f"icmp sgt i64 {k.text}, {stop.text}")
            down = code.op(BOOL, f"icmp slt i64 {step.text}, 0")
            code.choose(code.op(BOOL, f"select i1 {down.text}, i1 {above.text}, i1 {below.text}"), on, off)

        def advance() -> None:
            k = self.load(turn, INT)
            self.store(turn, code.op(INT, f"add nsw i64 {k.text}, {step.text}"))

        return self.turns(
            node.body,
            scope,
            test=test,
            enter=lambda inner: self.assign(target, self.load(turn, INT), inner),
            advance=advance,
        )

    def turns(
        self,
        body: Sequence[ast.stmt],
        scope: Variables,
        *,
        test: Callable[[Variables, str, str], None],
        enter: Callable[[Variables], None],
        advance: Callable[[], None],
    ) -> bool:
        """Write a loop, and return whether its end is unreachable.

        The type of a variable may change in the body. The loop is therefore written again with wider types, until the
        types of the variables at the end of the body are equal to those at the beginning. The functions `test`, `enter`
        and `advance` write the condition, and the statements before and after the body.
        """
        code = self.code
        mark, returns = len(code.lines), len(self.returns)
        types = dict(scope)
        while True:
            del code.lines[mark:], self.returns[returns:]
            head, first, off = Join(code.name("b")), code.name("b"), code.name("b")
            loop = Loop(Join(code.name("b")), Join(code.name("b")))
            self.leave(head, scope)
            code.begin(head.label)
            inner = dict(types)
            test(inner, first, off)
            code.begin(off)
            self.leave(loop.after, types)
            code.begin(first)
            enter(inner)
            if not self.block(body, inner, loop):
                self.leave(loop.again, inner)
            behind = together([types, *(variables for _, variables in loop.again.edges)])
            settled = {name: type_ for name, type_ in behind.items() if name in types or name in self.unset}
            if settled == types:
                break
            types = settled
        place, _ = loop.after.edges[0]
        loop.after.edges[0] = place, behind
        if loop.again.edges:
            self.seal(loop.again, behind)
            code.begin(loop.again.label)
            advance()
            code.go(head.label)
        self.seal(head, types)
        return self.meet_here(loop.after, scope)


def type_of(value: Number | Tuple) -> str | tuple[str, ...]:
    return value.type if isinstance(value, Number) else tuple(part.type for part in value.parts)


def joined(one: Type | Array, other: Type | Array) -> Type | Array:
    """Return the common type of a variable after two branches with different types; None if it cannot be read."""
    if one == other:
        return one
    if isinstance(one, str) and isinstance(other, str):
        return widest((one, other))
    if isinstance(one, Array) or isinstance(other, Array) or one is None or other is None:
        return None
    if isinstance(one, tuple) and isinstance(other, tuple) and len(one) == len(other):
        return tuple(widest((a, b)) for a, b in zip(one, other, strict=True))
    return None


def together(scopes: Iterable[Variables]) -> Variables:
    """Merge the variables of several branches; one that only some branches set has no value after the others."""
    out: Variables = {}
    for scope in scopes:
        for name, type_ in scope.items():
            out[name] = joined(out[name], type_) if name in out else type_
    return out
