"""Lowering of a kernel's statements. A loop over a group of records becomes a loop over their offsets."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import replace

from graspfx.compile.kernel_marks import optional
from graspfx.compile.lower.expressions import Expressions
from graspfx.compile.lower.kinds import (
    Bundle,
    Constant,
    Grid,
    Group,
    Lowered,
    Pack,
    Place,
    Span,
    expressions,
    labels_of,
    load,
    offsets,
    variable,
)
from graspfx.compile.lower.pieces import assign, assign_all, kind_of, product_of, store_of, sum_of
from graspfx.compile.lower.scratch import Frame
from graspfx.compile.records import layout
from graspfx.compile.syntax import place


class Body(Expressions):
    """Lowers one kernel."""

    def lower(self, tree: ast.FunctionDef, frame: Frame, kinds: dict[str, object]) -> ast.FunctionDef:
        self.written = frame.written
        parameters: list[ast.arg] = []
        defaults: list[ast.expr] = []
        fallbacks = dict(zip([a.arg for a in tree.args.args][::-1], tree.args.defaults[::-1], strict=False))
        for a in tree.args.args:
            value = variable(kinds[a.arg], a.arg)
            self.require_other(a.arg, value, a, frame)
            frame.scope[a.arg] = value
            self.buffers += [value.buffer] if isinstance(value, Place | Span | Grid | Group) else []
            names = [part.id for part in expressions(value) if isinstance(part, ast.Name)]
            if isinstance(value, Place) and not optional(kinds[a.arg])[1]:
                self.records.add(f"{a.arg}_at")
            labels = labels_of(kinds[a.arg])
            parameters += [
                ast.arg(name, ast.Constant(label) if label else None) for name, label in zip(names, labels, strict=True)
            ]
            if a.arg in fallbacks:
                default = self.value(fallbacks[a.arg], frame)
                if len(names) > 1 or not isinstance(default, ast.expr):
                    raise self.cannot(a, "has a default value, which is supported for numbers only")
                defaults.append(default)
        body = self.block(tree.body, frame)
        body = [*(assign(name, size) for name, size in self.sizes.values()), *body]
        args = ast.arguments([], parameters, None, [], [], None, defaults)
        node = ast.FunctionDef(name=tree.name, args=args, body=body, decorator_list=[], type_params=[])  # type: ignore[call-arg, unused-ignore] # type_params from Python 3.12 on
        place(node)
        return node

    def block(self, statements: Sequence[ast.stmt], frame: Frame) -> list[ast.stmt]:
        outer, self.out = self.out, []
        for statement in statements:
            before = len(self.out)
            self.statement(statement, frame)
            for line in self.out[before:]:  # an inner block may have set the source line already
                vars(line).setdefault("origin", statement.lineno)
        lowered, self.out = self.out, outer
        return lowered or [ast.Pass()]

    def statement(self, node: ast.stmt, frame: Frame) -> None:
        if isinstance(node, ast.Assign):
            value = self.value(node.value, frame)
            if len(node.targets) > 1:
                value = self.atoms(value)
            for target in node.targets:
                self.store(target, value, frame)
        elif isinstance(node, ast.AnnAssign):
            if node.value is not None:
                self.store(node.target, self.value(node.value, frame), frame)
        elif isinstance(node, ast.AugAssign):
            old = ast.parse(ast.unparse(node.target), mode="eval").body
            self.store(node.target, self.operation(node, self.value(old, frame), self.value(node.value, frame)), frame)
        elif isinstance(node, ast.If):
            self.branch(node, frame)
        elif isinstance(node, ast.For):
            self.loop(node, frame)
        elif isinstance(node, ast.While):
            self.repeat(node, frame)
        elif isinstance(node, ast.Return):
            self.give(node, frame)
        elif isinstance(node, ast.Expr):
            if not isinstance(node.value, ast.Constant):
                value = self.value(node.value, frame)
                if isinstance(value, ast.Call):
                    self.out.append(ast.Expr(value))
        elif isinstance(node, ast.Break | ast.Continue | ast.Pass):
            self.out.append(node)
        else:
            raise self.cannot(node, "is not a statement supported in kernels")

    def give(self, node: ast.Return, frame: Frame) -> None:
        if node.value is None:
            self.out.append(ast.Return(None))
            return
        value = self.value(node.value, frame)
        numbers = offsets(value)
        single = isinstance(value, ast.expr)
        self.out.append(ast.Return(numbers[0] if single else ast.Tuple(numbers, ast.Load())))

    # Assignments --------------------------------------------------------------------------------------------------

    def store(self, target: ast.expr, value: Lowered, frame: Frame) -> None:
        if isinstance(target, ast.Name):
            self.bind(target, value, frame)
        elif isinstance(target, ast.Tuple):
            self.unpack(target, value, frame)
        elif isinstance(target, ast.Attribute):
            self.fill(target, value, frame)
        elif isinstance(target, ast.Subscript):
            place = self.item(target, frame)
            if not isinstance(place, ast.Subscript) or not isinstance(value, ast.expr):
                raise self.cannot(target, "is not an entry, or its new value is not a number")
            self.out.append(ast.Assign([store_of([place])], value))
        else:
            raise self.cannot(target, "cannot be assigned to")

    def bind(self, target: ast.Name, value: Lowered, frame: Frame) -> None:
        if isinstance(value, Constant):
            frame.scope[target.id] = value
            return
        result = self.variables(value, target.id, target, frame)
        names = offsets(result)
        if names:
            self.out.append(assign_all(names, offsets(value)))
        frame.scope[target.id] = result

    def unpack(self, target: ast.Tuple, value: Lowered, frame: Frame) -> None:
        if not isinstance(value, Pack | Bundle) or len(value.parts) != len(target.elts):
            if isinstance(value, ast.expr) and all(isinstance(t, ast.Name) for t in target.elts):
                # tuple of numbers from a function without a declared result
                for t in target.elts:
                    assert isinstance(t, ast.Name)
                    frame.scope[t.id] = load(frame.prefix + t.id)
                self.out.append(ast.Assign([store_of([frame.scope[t.id] for t in target.elts])], value))  # type: ignore[misc, attr-defined] # names
                return
            raise self.cannot(target, "has a different number of targets and values")
        parts = value.parts
        places = [self.target(t, part, frame) for t, part in zip(target.elts, parts, strict=True)]
        names = [name for place in places for name in place]
        values = [number for part in parts for number in offsets(part)]
        self.out.append(assign_all(names, values))

    def target(self, node: ast.expr, value: Lowered, frame: Frame) -> list[ast.expr]:
        """Return the variables or entries to which a value is assigned; a name gets the kind of the value."""
        if isinstance(node, ast.Name):
            frame.scope[node.id] = self.variables(value, node.id, node, frame)
            return offsets(frame.scope[node.id])
        place = self.value(ast.parse(ast.unparse(node), mode="eval").body, frame)
        return [entry_of(number) for number in offsets(place)]

    def fill(self, target: ast.Attribute, value: Lowered, frame: Frame) -> None:
        place = self.value(ast.parse(ast.unparse(target), mode="eval").body, frame)
        if isinstance(place, Place | Span | Grid | Group | Pack | Constant):
            raise self.cannot(target, "cannot be replaced: assign to its fields")
        to = [entry_of(number) for number in offsets(place)]
        values = offsets(value)
        if len(to) != len(values) or (isinstance(place, Bundle) and not isinstance(value, Bundle)):
            raise self.cannot(target, f"takes {len(to)} numbers, {len(values)} given")
        truth = self.is_truth(target, frame)
        if truth:
            [number] = values
            values = [number if is_float(number) else ast.IfExp(number, ast.Constant(1.0), ast.Constant(0.0))]
            if isinstance(number, ast.Constant):
                values = [ast.Constant(1.0 if number.value else 0.0)]
        self.out.append(assign_all(to, values))

    def is_truth(self, target: ast.Attribute, frame: Frame) -> bool:
        owner = self.value(ast.parse(ast.unparse(target.value), mode="eval").body, frame)
        return isinstance(owner, Place) and layout(owner.kind)[target.attr].kind is bool

    # Branches and loops -------------------------------------------------------------------------------------------

    def branch(self, node: ast.If, frame: Frame) -> None:
        test = self.number(node.test, frame)
        one, other = (
            replace(frame, scope=dict(frame.scope)),
            replace(frame, scope=dict(frame.scope)),
        )
        body = self.block(node.body, one)
        otherwise = self.block(node.orelse, other) if node.orelse else []
        ends = (leaves(node.body), leaves(node.orelse))
        for name in {**one.scope, **other.scope}:
            a, b = one.scope.get(name), other.scope.get(name)
            if a is None or ends[0]:
                frame.scope[name] = b if b is not None else a  # type: ignore[assignment] # one of them is
            elif b is None or ends[1]:
                frame.scope[name] = a
            elif kind_of(a) != kind_of(b):
                raise self.cannot(node, f"assigns values of different kinds or buffers to {name!r} in its branches")
            else:
                frame.scope[name] = self.joined(name, a, b, frame, node)
        self.out.append(ast.If(test, body, otherwise))

    def joined(self, name: str, a: Lowered, b: Lowered, frame: Frame, node: ast.AST) -> Lowered:
        """Return the value of a variable after an if statement, from its values `a` and `b` after the two branches.

        An error is raised unless the numbers of both values are the same variables or constants.
        """
        if isinstance(a, Constant) and isinstance(b, Constant):
            if a.value is not b.value:
                raise self.cannot(node, f"assigns different functions to {name!r} in its branches")
            return a
        if [ast.dump(n) for n in offsets(a)] != [ast.dump(n) for n in offsets(b)]:
            raise self.cannot(node, f"assigns {name!r} in one branch only: assign it before the branch")
        return a

    def loop(self, node: ast.For, frame: Frame) -> None:
        if node.orelse:
            raise self.cannot(node, "has an else after its loop")
        if isinstance(node.iter, ast.Tuple):
            parts = [self.value(part, frame) for part in node.iter.elts]
            if all(isinstance(part, ast.expr) for part in parts):
                self.bind_target(node.target, frame)
                body = self.block(node.body, frame)
                self.out.append(ast.For(self.loop_target(node.target, frame), ast.Tuple(parts, ast.Load()), body, []))  # type: ignore[arg-type] # all are numbers
                return
            for part in parts:  # unroll a loop over records or values
                self.store(node.target, part, frame)
                self.out += self.block(node.body, frame)
            return
        if isinstance(node.iter, ast.Call):
            called = self.value(node.iter.func, frame)
            if isinstance(called, Constant) and called.value is enumerate:
                self.each(node, frame)
                return
            if isinstance(called, Constant) and called.value is range:
                bounds = [self.number(a, frame) for a in node.iter.args]
                self.bind_target(node.target, frame)
                body = self.block(node.body, frame)
                turns = ast.Call(load("range"), bounds, [])
                self.out.append(ast.For(self.loop_target(node.target, frame), turns, body, []))
                return
        self.each(node, frame)

    def bind_target(self, target: ast.expr, frame: Frame) -> None:
        if not isinstance(target, ast.Name):
            raise self.cannot(target, "is not a loop variable")
        frame.scope[target.id] = load(frame.prefix + target.id)

    def loop_target(self, target: ast.expr, frame: Frame) -> ast.expr:
        assert isinstance(target, ast.Name)
        return ast.Name(frame.prefix + target.id, ast.Store())

    def each(self, node: ast.For, frame: Frame) -> None:
        """Lower a loop `for record in group`, or `for i, record in enumerate(group)`."""
        call = node.iter
        target, index = node.target, ""
        if isinstance(call, ast.Call):
            if not (isinstance(target, ast.Tuple) and isinstance(target.elts[0], ast.Name) and len(call.args) == 1):
                raise self.cannot(node, "does not enumerate a group of records")
            index, target, call = target.elts[0].id, target.elts[1], call.args[0]
        group = self.value(call, frame)
        if not isinstance(group, Group) or not isinstance(target, ast.Name):
            raise self.cannot(node, "does not loop over a range, a tuple or a group of records")
        count = self.atom(group.count)
        base = self.atom(group.offset) if not isinstance(group.offset, ast.BinOp) else group.offset
        name, at = frame.prefix + (index or f"{target.id}_i"), f"{frame.prefix}{target.id}_at"
        for own in (at,) if index else (name, at):
            self.require_other(target.id, load(own), target, frame)
        if index:
            frame.scope[index] = load(name)
        frame.scope[target.id] = group.member(load(at))
        first = assign(at, sum_of(base, product_of(load(name), group.stride)))
        body = [first, *self.block(node.body, frame)]
        self.out.append(ast.For(ast.Name(name, ast.Store()), ast.Call(load("range"), [count], []), body, []))

    def repeat(self, node: ast.While, frame: Frame) -> None:
        if node.orelse:
            raise self.cannot(node, "has an else after its loop")
        before = len(self.out)
        test = self.number(node.test, frame)
        if len(self.out) > before:
            raise self.cannot(
                node.test, "needs preceding statements: compute it before the loop and at the end of its body"
            )
        self.out.append(ast.While(test, self.block(node.body, frame), []))


def entry_of(number: ast.expr) -> ast.expr:
    """Return the entry of a buffer from which a number was read, without the conversion to int or bool."""
    if isinstance(number, ast.Compare):
        number = number.left
    if isinstance(number, ast.Call):
        number = number.args[0]
    return number


def is_float(node: ast.expr) -> bool:
    return isinstance(node, ast.Subscript)


def leaves(statements: Sequence[ast.stmt]) -> bool:
    """Return whether the end of a block is unreachable, because the last statement leaves the block."""
    return bool(statements) and isinstance(statements[-1], ast.Return | ast.Break | ast.Continue | ast.Raise)
