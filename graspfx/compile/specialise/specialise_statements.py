"""Specialisation of a kernel's statements: branches never taken are removed, and short loops are unrolled."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Sequence

from graspfx.compile.specialise.specialise_expressions import (
    Expressions,
    Kernel,
    Scope,
    SpecialisedKernel,
    Specialiser,
    from_call,
)
from graspfx.compile.specialise.syntax import (
    assigned,
    assignment,
    call_of,
    calls,
    constant,
    leaves,
    load,
    loaded,
    node_of,
    nodes,
    size,
    store,
    tuple_of,
)
from graspfx.compile.specialise.values import Dynamic, Memory, Reference, Static, TupleValue, Value, same


class Body(Expressions):
    """One kernel during specialisation."""

    def __init__(self, program: Specialiser, kernel: Kernel, arguments: Sequence[Value]) -> None:
        super().__init__(program, kernel)
        self.names = [a.arg for a in kernel.tree.args.args]
        if len(self.names) != len(arguments):
            raise self.cannot(self.tree, f"takes {len(self.names)} arguments, {len(arguments)} given")
        self.arguments = arguments
        self.returned: list[Value | None] = []

    def specialise(self, name: str) -> SpecialisedKernel:
        scope: Scope = {}
        body: list[ast.stmt] = []
        parameters = []
        for parameter, value in zip(self.names, self.arguments, strict=True):
            if isinstance(value, Memory):
                self.arrays[value.array] = None
                scope[parameter] = value
            elif isinstance(value, Static):
                scope[parameter] = value
                body.append(assignment(parameter, constant(value.value)))
            else:
                scope[parameter] = Dynamic(load(parameter))
                parameters.append(parameter)
        statements, ended = self.block(self.tree.body, scope)
        if not ended:
            self.returned.append(None)
        for clash in self.arrays.keys() & (assigned(self.tree.body) | set(parameters)):
            raise self.cannot(
                self.tree, f"has a number named {clash!r}, which is also the name of a buffer: rename one of them"
            )
        body = without_unused(body + statements)
        arrays = tuple(self.arrays)
        node = ast.FunctionDef(
            name=name,
            args=ast.arguments(
                posonlyargs=[], args=[ast.arg(p) for p in (*arrays, *parameters)], kwonlyargs=[],
                kw_defaults=[], defaults=[],
            ),
            body=body or [ast.Pass()],
            decorator_list=[],
            type_params=[],
        )  # fmt: skip
        return SpecialisedKernel(name, arrays, node, self.result(), self.pure, self.called + size(body))

    def result(self) -> Value | None:
        """Combine the static parts of all returned values."""
        first, *others = self.returned
        if first is None:
            return None
        if isinstance(first, TupleValue):
            parts = [
                part
                if all(isinstance(r, TupleValue) and same(part, r.parts[k]) for r in others)
                else Dynamic(load("_"))
                for k, part in enumerate(first.parts)
            ]
            return TupleValue(tuple(parts), None)
        return first if all(same(first, r) for r in others) else Dynamic(load("_"))

    def block(self, statements: Iterable[ast.stmt], scope: Scope) -> tuple[list[ast.stmt], bool]:
        """Specialise statements; return whether their end is unreachable."""
        out: list[ast.stmt] = []
        for statement in statements:
            more, ended = self.statement(statement, scope)
            for line in more:  # an inner block may have set the source line already
                vars(line).setdefault("origin", (self.kernel.file, statement.lineno))
            out += more
            if ended:
                return out, True
        return out, False

    def statement(self, node: ast.stmt, scope: Scope) -> tuple[list[ast.stmt], bool]:
        if isinstance(node, ast.Assign):
            first, value = node.targets[0], node.value
            if isinstance(first, ast.Tuple) and isinstance(value, ast.IfExp):  # a conditional tuple becomes a branch
                one: list[ast.stmt] = [ast.copy_location(ast.Assign([first], value.body), node)]
                other: list[ast.stmt] = [ast.copy_location(ast.Assign([first], value.orelse), node)]
                return self.branch(ast.copy_location(ast.If(value.test, one, other), node), scope)
            out = self.assign(node.targets[0], node.value, scope)
            for target in node.targets[1:]:  # a = b = 0.0: the second target receives the value of the first
                out += self.assign(target, loaded(node.targets[0]), scope)
            return out, False
        if isinstance(node, ast.AnnAssign) and node.value is not None:
            return self.assign(node.target, node.value, scope), False
        if isinstance(node, ast.AugAssign):
            return self.assign(node.target, ast.BinOp(loaded(node.target), node.op, node.value), scope), False
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
        raise self.cannot(node, "is not a statement supported in kernels")

    def assign(self, target: ast.expr, value: ast.expr, scope: Scope) -> list[ast.stmt]:
        out: list[ast.stmt] = []
        result: Value
        if isinstance(value, ast.Call):
            call, static = self.call(value, scope)
            if isinstance(static, Static):
                result = static
                if call is not None:  # called for its effect; its result is static
                    out.append(ast.Expr(call))
            else:
                result = from_call(call, static)
        else:
            result = self.value(value, scope)
        if isinstance(target, ast.Name):
            if isinstance(result, Memory | Reference):
                scope[target.id] = result
                return out
            scope[target.id] = result if isinstance(result, Static) else Dynamic(load(target.id))
            return [*out, assignment(target.id, node_of(result))]
        if isinstance(target, ast.Subscript):
            return [*out, ast.Assign([self.entry(target, scope, store=True)], node_of(result))]
        if not (isinstance(target, ast.Tuple) and isinstance(result, TupleValue | Dynamic)):
            raise self.cannot(target, "cannot be assigned to")
        names: set[str] = set()
        for t in target.elts:
            if isinstance(t, ast.Name):
                names.add(t.id)
            elif names & {n.id for n in ast.walk(t) if isinstance(n, ast.Name)}:
                raise self.cannot(target, "assigns to a number and to an entry that depends on it: use two statements")
        to = [
            store(t.id) if isinstance(t, ast.Name) else self.entry(self.subscript(t), scope, store=True)
            for t in target.elts
        ]
        parts = result.parts if isinstance(result, TupleValue) else (Dynamic(load("_")),) * len(to)
        if len(to) != len(parts):
            raise self.cannot(target, f"takes {len(to)} values, {len(parts)} given")
        for t, part in zip(target.elts, parts, strict=True):
            if isinstance(t, ast.Name):
                scope[t.id] = part if isinstance(part, Static) else Dynamic(load(t.id))
        return [*out, ast.Assign([tuple_of(to, store=True)], node_of(result))]

    def subscript(self, node: ast.expr) -> ast.Subscript:
        if isinstance(node, ast.Subscript):
            return node
        raise self.cannot(node, "cannot be assigned to")

    def branch(self, node: ast.If, scope: Scope) -> tuple[list[ast.stmt], bool]:
        test = self.test(node.test, scope)
        if isinstance(test, Static):
            return self.block(node.body if test.value else node.orelse, scope)
        one, other = dict(scope), dict(scope)
        body, ended = self.block(node.body, one)
        otherwise, other_ended = self.block(node.orelse, other)
        if ended != other_ended:
            _become(scope, other if ended else one)
        else:
            _become(scope, {name: _joined(name, one[name], other[name]) for name in one.keys() & other.keys()})
            for name in one.keys() ^ other.keys():  # may be read only where it has been assigned
                scope[name] = Dynamic(load(name))
        if not body and not otherwise:
            return ([ast.Expr(node_of(test))] if calls(node_of(test)) else []), False
        if not body:
            return [ast.If(ast.UnaryOp(ast.Not(), node_of(test)), otherwise, [])], ended and other_ended
        return [ast.If(node_of(test), body, otherwise)], ended and other_ended

    def loop(self, node: ast.For, scope: Scope) -> tuple[list[ast.stmt], bool]:
        call = node.iter
        if isinstance(call, ast.Tuple) and not node.orelse and not leaves(node.body):
            turns = [[ast.copy_location(ast.Assign([node.target], part), node), *node.body] for part in call.elts]
            parts = list(ast.walk(call))
            changed = assigned(node.body) & {part.id for part in parts if isinstance(part, ast.Name)}
            if not changed and not any(
                isinstance(part, ast.Subscript | ast.Call) for part in parts
            ):  # otherwise the tuple could change during the loop
                return self.block([statement for turn in turns for statement in turn], scope)
        if not (
            isinstance(node.target, ast.Name)
            and not node.orelse
            and isinstance(call, ast.Call)
            and isinstance(call.func, ast.Name)
            and call.func.id == "range"
        ):
            raise self.cannot(node, "does not loop over a range or a constant tuple")
        bounds = [self.value(a, scope) for a in call.args]
        indices = [int(b.value) for b in bounds if isinstance(b, Static)]
        if len(indices) == len(bounds):
            numbers = range(*indices)
            if not numbers:
                return [], False
            lines = self.written_out(node, numbers, scope)
            if lines is not None:
                return lines
        self.forget([node], scope)
        inner = dict(scope)
        body, _ = self.block(node.body, inner)
        self.forget([node], scope)
        if not body:
            return [], False
        turned: list[ast.stmt] = [
            ast.For(store(node.target.id), call_of("range", [node_of(b) for b in bounds]), body, [])
        ]
        return turned, False

    def written_out(self, node: ast.For, turns: range, scope: Scope) -> tuple[list[ast.stmt], bool] | None:
        """Unroll a loop; also return whether its end is unreachable; return None if the loop is too long."""
        assert isinstance(node.target, ast.Name)
        most = self.program.unroll
        if len(turns) * len(node.body) > most or leaves(node.body):
            return None
        inner, arrays, pure, called, returned = (
            dict(scope),
            dict(self.arrays),
            self.pure,
            self.called,
            len(self.returned),
        )
        out: list[ast.stmt] = []
        ended, written = False, 0
        for count, turn in enumerate(turns, start=1):
            inner[node.target.id] = Static(turn)
            body, ended = self.block(node.body, inner)
            out += [assignment(node.target.id, ast.Constant(turn)), *body]
            written += size(body)
            if (written + self.called - called) * (1 if ended else len(turns)) > most * count:
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
        if isinstance(first, Static) and not first.value:
            return [], False
        self.forget(node.body, scope)
        test = self.test(node.test, dict(scope))
        body, _ = self.block(node.body, dict(scope))
        return [ast.While(node_of(test), body or [ast.Pass()], [])], False

    def forget(self, statements: Sequence[ast.stmt], scope: Scope) -> None:
        """Discard the known values of the variables that a loop assigns."""
        for name in assigned(statements):
            if isinstance(scope.get(name), Memory | Reference):
                raise self.cannot(statements[0], f"changes the buffer {name!r} in a loop")
            scope[name] = Dynamic(load(name))

    def give(self, node: ast.Return, scope: Scope) -> list[ast.stmt]:
        if node.value is None:
            self.returned.append(None)
            return [ast.Return(None)]
        value = self.value(node.value, scope)
        self.returned.append(value)
        return [ast.Return(node_of(value))]

    def effect(self, node: ast.expr, scope: Scope) -> list[ast.stmt]:
        if isinstance(node, ast.Constant):
            return []  # a docstring
        if not isinstance(node, ast.Call):
            raise self.cannot(node, "does nothing")
        call, _ = self.call(node, scope)
        return [] if call is None else [ast.Expr(call)]


def _joined(name: str, one: Value, other: Value) -> Value:
    return one if same(one, other) else Dynamic(load(name))


def _become(scope: Scope, other: Scope) -> None:
    scope.clear()
    scope.update(other)


def without_unused(statements: list[ast.stmt]) -> list[ast.stmt]:
    """Eliminate assignments of constants to variables that nothing reads."""
    while True:
        read = {n.id for n in nodes(statements) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)}
        pruner = _Pruner(read)
        statements = [rest for s in statements if (rest := pruner.visit(s)) is not None]
        if not pruner.dropped:
            return statements


class _Pruner(ast.NodeTransformer):
    def __init__(self, read: set[str]) -> None:
        self.read, self.dropped = read, False

    def visit_Assign(self, node: ast.Assign) -> ast.stmt | None:
        target = node.targets[0]
        names = [target] if isinstance(target, ast.Name) else target.elts if isinstance(target, ast.Tuple) else []
        unread = names and all(isinstance(n, ast.Name) and n.id not in self.read for n in names)
        if unread and not calls(node.value):
            self.dropped = True
            return None
        return node

    def visit_If(self, node: ast.If) -> ast.stmt | None:
        self.generic_visit(node)
        if node.body or node.orelse or calls(node.test):
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
