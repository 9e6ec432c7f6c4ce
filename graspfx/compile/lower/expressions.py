"""Lowering of a kernel's expressions. Fields become entries of buffers, and operators of values are inlined."""

from __future__ import annotations

import ast
import builtins
from collections.abc import Mapping, Sequence
from types import FunctionType
from typing import Any

from graspfx.compile.definitions import definition
from graspfx.compile.kernel_marks import INLINE, LOWERED, optional, parameter_kinds
from graspfx.compile.lower.kinds import (
    NOTHING,
    Bundle,
    Constant,
    Grid,
    Group,
    Lowered,
    Pack,
    Place,
    Span,
    expressions,
    like,
    load,
    offsets,
    plus,
    variable,
)
from graspfx.compile.lower.pieces import (
    assign,
    assign_all,
    grid_entry,
    indexed,
    kind_of,
    names_of,
    pieces,
    product_of,
    rebuild,
    repeated,
    replace_buffer,
    store_of,
    sum_of,
)
from graspfx.compile.lower.scratch import Frame, Scratch
from graspfx.compile.records import SCALARS, Floats, Record, Table, is_value, layout, parts_of
from graspfx.errors import KernelError

OPERATORS: dict[type[ast.operator], str] = {
    ast.Add: "add",
    ast.Sub: "sub",
    ast.Mult: "mul",
    ast.Div: "truediv",
    ast.MatMult: "matmul",
}


class Expressions(Scratch):
    """Lowers the expressions of one kernel."""

    # Names and constants ------------------------------------------------------------------------------------------

    def value(self, node: ast.expr, frame: Frame) -> Lowered:
        if isinstance(node, ast.Constant):
            return ast.Constant(node.value)
        if isinstance(node, ast.Name):
            return self.name(node, frame)
        if isinstance(node, ast.Attribute):
            return self.attribute(node, frame)
        if isinstance(node, ast.Subscript):
            return self.item(node, frame)
        if isinstance(node, ast.Call):
            return self.call(node, frame)
        if isinstance(node, ast.Tuple):
            return Pack(tuple(self.value(part, frame) for part in node.elts))
        if isinstance(node, ast.BinOp):
            return self.binary(node, frame)
        if isinstance(node, ast.UnaryOp):
            return self.unary(node, frame)
        if isinstance(node, ast.Compare):
            return self.compare(node, frame)
        if isinstance(node, ast.BoolOp):
            return self.logic(node, frame)
        if isinstance(node, ast.IfExp):
            return self.choice(node, frame)
        raise self.cannot(node, "is not an expression supported in kernels")

    def number(self, node: ast.expr, frame: Frame) -> ast.expr:
        value = self.value(node, frame)
        if isinstance(value, ast.expr):
            return value
        raise self.cannot(node, "is not a number")

    def name(self, node: ast.Name, frame: Frame) -> Lowered:
        if node.id in frame.scope:
            return frame.scope[node.id]
        missing = object()
        item = frame.namespace.get(node.id, getattr(builtins, node.id, missing))
        if item is missing:
            return load(frame.prefix + node.id)  # assigned in a branch
        return self.constant(item, node.id, frame)

    def attribute(self, node: ast.Attribute, frame: Frame) -> Lowered:
        owner = self.value(node.value, frame)
        if isinstance(owner, Place | Span | Grid | Group) and node.attr in ("buffer", "offset"):
            return load(owner.buffer) if node.attr == "buffer" else owner.offset
        if isinstance(owner, Place):
            return self.field(owner, node, frame)
        if isinstance(owner, Bundle):
            fields = list(parts_of(owner.kind))
            if node.attr in fields:
                return owner.parts[fields.index(node.attr)]
            member = getattr(owner.kind, node.attr, None)
            if isinstance(member, property) and isinstance(member.fget, FunctionType):
                return self.inline(member.fget, [owner], node)
        if isinstance(owner, Constant):
            if isinstance(owner.value, type) and issubclass(owner.value, Record):
                layout(owner.value)
                return Constant(vars(owner.value).get(node.attr) or getattr(owner.value, node.attr))
            item = getattr(owner.value, node.attr)
            if isinstance(item, bool | int | float):
                return node if isinstance(node.value, ast.Name) and not frame.prefix else ast.Constant(item)
            return Constant(item)
        if isinstance(owner, Group) and node.attr == "count":
            return owner.count
        if isinstance(owner, Grid) and node.attr == "columns":
            return owner.columns
        raise self.cannot(node, f"has no field {node.attr!r}")

    # Memory -------------------------------------------------------------------------------------------------------

    def field(self, owner: Place, node: ast.Attribute, frame: Frame) -> Lowered:
        field = layout(owner.kind).get(node.attr)
        if field is None:
            member = getattr(owner.kind, node.attr, None)
            if isinstance(member, property) and isinstance(member.fget, FunctionType):
                return self.inline(member.fget, [owner], node)
            if member is not None:
                raise self.cannot(node, "is a method: call it")
            raise self.cannot(node, f"has no field {node.attr!r}")
        return self.entry(owner, field)

    def item(self, node: ast.Subscript, frame: Frame) -> Lowered:
        owner = self.value(node.value, frame)
        if isinstance(owner, Grid) and isinstance(node.slice, ast.Tuple):
            row, column = (self.number(part, frame) for part in node.slice.elts)
            self.require_index(node, row, column)
            return ast.Subscript(load(owner.buffer), grid_entry(owner, row, column), ast.Load())
        index = self.number(node.slice, frame)
        if isinstance(owner, Span | Grid | Group | ast.Name):
            self.require_index(node, index)
        if isinstance(owner, Span):
            return ast.Subscript(load(owner.buffer), sum_of(owner.offset, index), ast.Load())
        if isinstance(owner, Grid):
            return Span(owner.buffer, sum_of(owner.offset, product_of(index, owner.columns)))
        if isinstance(owner, Group):
            return owner.member(sum_of(owner.offset, product_of(index, owner.stride)))
        if isinstance(owner, Bundle | Pack):
            if isinstance(index, ast.Constant) and isinstance(index.value, int):
                if not -len(owner.parts) <= index.value < len(owner.parts):
                    raise self.cannot(
                        node, f"has an index outside the {len(owner.parts)} entries of the value", KernelError
                    )
                return owner.parts[index.value]
            if isinstance(owner, Bundle) and owner.offset is not None:
                return ast.Subscript(load(owner.buffer), sum_of(owner.offset, index), ast.Load())
            raise self.cannot(
                node, "indexes a local value with a variable; use a constant index, or store the value in a record"
            )
        if isinstance(owner, ast.Name):  # a plain buffer
            return ast.Subscript(owner, index, ast.Load())
        raise self.cannot(node, "is not an entry of a buffer, a group or a value")

    # Arithmetic ---------------------------------------------------------------------------------------------------

    def binary(self, node: ast.BinOp, frame: Frame) -> Lowered:
        left, right = self.value(node.left, frame), self.value(node.right, frame)
        return self.operation(node, left, right)

    def operation(self, node: ast.BinOp | ast.AugAssign, left: Lowered, right: Lowered) -> Lowered:
        if isinstance(left, ast.expr) and isinstance(right, ast.expr):
            return ast.BinOp(left, node.op, right)
        name = OPERATORS.get(type(node.op), "")
        for owner, other, method in ((left, right, f"__{name}__"), (right, left, f"__r{name}__")):
            function = getattr(owner.kind, method, None) if isinstance(owner, Bundle) else None
            if isinstance(function, FunctionType):
                return self.inline(function, [owner, other], node)
        raise self.cannot(node, "has an unsupported operator")

    def unary(self, node: ast.UnaryOp, frame: Frame) -> Lowered:
        value = self.value(node.operand, frame)
        if isinstance(value, Bundle) and isinstance(node.op, ast.USub):
            return self.inline(vars(value.kind)["__neg__"], [value], node)
        if isinstance(value, ast.expr):
            return ast.UnaryOp(node.op, value)
        raise self.cannot(node, "is not a number")

    def compare(self, node: ast.Compare, frame: Frame) -> Lowered:
        if len(node.ops) == 1 and isinstance(node.ops[0], ast.Is | ast.IsNot):
            value = self.value(node.left, frame)
            if not (isinstance(node.comparators[0], ast.Constant) and node.comparators[0].value is None):
                raise self.cannot(node, "compares identity with something other than None")
            [offset, *_] = offsets(value)
            sign: ast.cmpop = ast.Lt() if isinstance(node.ops[0], ast.Is) else ast.GtE()
            return ast.Compare(offset, [sign], [ast.Constant(0)])
        return ast.Compare(
            self.number(node.left, frame), node.ops, [self.number(part, frame) for part in node.comparators]
        )

    def logic(self, node: ast.BoolOp, frame: Frame) -> Lowered:
        first, *others = node.values
        value = self.number(first, frame)
        for part in others:
            out, self.out = self.out, []
            more = self.number(part, frame)
            before, self.out = self.out, out
            if before:  # evaluated only if the first operand does not decide
                name = self.temporary()
                test: ast.expr = load(name)
                if isinstance(node.op, ast.Or):
                    test = ast.UnaryOp(ast.Not(), test)
                self.out += [assign(name, value), ast.If(test, [*before, assign(name, more)], [])]
                value = load(name)
            elif isinstance(value, ast.BoolOp) and type(value.op) is type(node.op) and len(others) > 1:
                value = ast.BoolOp(node.op, [*value.values, more])
            else:
                value = ast.BoolOp(node.op, [value, more])
        return value

    def choice(self, node: ast.IfExp, frame: Frame) -> Lowered:
        test = self.number(node.test, frame)
        out = self.out
        self.out = []
        one = self.value(node.body, frame)
        before, self.out = self.out, []
        other = self.value(node.orelse, frame)
        after, self.out = self.out, out
        if before or after:
            result = like(one, self.temporary())
            names = offsets(result)
            self.out.append(
                ast.If(test, [*before, assign_all(names, offsets(one))], [*after, assign_all(names, offsets(other))])
            )
            return result
        if kind_of(one) != kind_of(other):
            raise self.cannot(node, "chooses between values of different kinds, or records in different buffers")
        a, b = offsets(one), offsets(other)
        if len(a) == 1:
            options: list[ast.expr] = [ast.IfExp(test, a[0], b[0])]
        else:
            test = self.atom(test)
            options = [ast.IfExp(test, p, q) for p, q in zip(a, b, strict=True)]
        return rebuild(one, iter(options))

    # Calls --------------------------------------------------------------------------------------------------------

    def call(self, node: ast.Call, frame: Frame) -> Lowered:
        if isinstance(node.func, ast.Attribute):
            bound = self.method(node.func, node, frame)
            if bound is not None:
                return bound
        called = self.value(node.func, frame)
        if not isinstance(called, Constant):
            raise self.cannot(node, "does not call a function")
        function = called.value
        function = getattr(function, LOWERED, function)
        if isinstance(function, type) and is_value(function):
            return self.construct(function, node, frame)
        if isinstance(function, type) and issubclass(function, Record | Floats | Table):
            return self.view(function, node, frame)
        arguments = [self.value(a, frame) for a in node.args]
        keywords = {str(k.arg): self.value(k.value, frame) for k in node.keywords}
        if function is len and isinstance(arguments[0], Group):
            return arguments[0].count
        if getattr(function, INLINE, False):
            return self.inline(function, arguments, node, keywords)
        return self.kernel_call(node, called.value, function, arguments, keywords, frame)

    def method(self, func: ast.Attribute, node: ast.Call, frame: Frame) -> Lowered | None:
        """Lower the call of a method of a value or a record, or of the method `part` of a group.

        The result is None if the attribute is a function of a module instead of a method.
        """
        owner = self.value(func.value, frame)
        if isinstance(owner, Group) and func.attr == "part":
            field = self.value(node.args[0], frame)
            assert isinstance(field, Constant)
            return Group(
                field.value.kind, owner.buffer, plus(owner.offset, int(field.value.offset)), owner.stride, owner.count
            )
        if not isinstance(owner, Bundle | Place):
            return None
        function = getattr(owner.kind, func.attr, None)
        if not isinstance(function, FunctionType):
            raise self.cannot(node, f"has no method {func.attr!r}")
        arguments = [self.value(a, frame) for a in node.args]
        return self.inline(function, [owner, *arguments], node)

    def construct(self, kind: type, node: ast.Call, frame: Frame) -> Lowered:
        fields = parts_of(kind)
        values = dict(zip(fields, node.args, strict=False)) | {str(k.arg): k.value for k in node.keywords}
        if set(values) != set(fields):
            raise self.cannot(node, f"passes {', '.join(values)} to {kind.__name__}({', '.join(fields)})")
        return Bundle(kind, tuple(self.value(values[name], frame) for name in fields))

    def view(self, kind: type[Record] | type[Floats] | type[Table], node: ast.Call, frame: Frame) -> Lowered:
        """Lower a call `Kind(record.buffer, offset)`, which creates a view of a record or an array in a buffer."""
        buffer, *rest = [self.value(a, frame) for a in node.args]
        numbers = [self.atom(number) for number in rest if isinstance(number, ast.expr)]
        if not isinstance(buffer, ast.Name) or node.keywords or len(numbers) != 1 + (kind is Table):
            raise self.cannot(node, "is not a view of a buffer at an offset")
        if kind is Table:
            return Grid(buffer.id, *numbers)
        return Span(buffer.id, *numbers) if kind is Floats else Place(kind, buffer.id, *numbers)  # type: ignore[arg-type] # a record

    def kernel_call(
        self,
        node: ast.Call,
        called: Any,
        function: Any,
        arguments: Sequence[Lowered],
        by_name: Mapping[str, Lowered],
        frame: Frame,
    ) -> Lowered:
        """Lower the call of a kernel, or of another function that is not inlined."""
        name = self.callee(node.func, called, frame)
        kinds = parameter_kinds(function) if isinstance(function, FunctionType) else {}
        order = list(kinds)
        args = [
            self.passed(a, kinds.get(order[k]) if k < len(order) else None, arguments) for k, a in enumerate(arguments)
        ]
        flat: list[ast.expr] = [number for a in args for number in expressions(a)]
        keywords = []
        for key, value in by_name.items():
            target = variable(kinds.get(key, float), key)
            names = [part.id for part in expressions(target) if isinstance(part, ast.Name)]
            values = list(expressions(self.passed(value, kinds.get(key), arguments)))
            keywords += [ast.keyword(n, v) for n, v in zip(names, values, strict=True)]
        call = ast.Call(name, flat, keywords)
        kind = kinds.get("return", float)
        if kind is None or kind is type(None) or kind in SCALARS or kind is Any:
            return call
        result = variable(kind, self.temporary())
        if any(isinstance(part, Place | Span | Grid | Group) for part in pieces(result)):
            raise self.cannot(node, "returns a view: return its index, or use a property")
        self.out.append(ast.Assign([store_of(offsets(result))], call))
        return result

    def passed(self, value: Lowered, kind: Any, arguments: Sequence[Lowered]) -> Lowered:
        """Return an argument in the form that a parameter of a kind requires.

        None is passed as a record or an array with a negative offset, in the buffer of one of the call's arguments.
        """
        if isinstance(value, ast.Constant) and value.value is None and kind is not None:
            inner, _ = optional(kind)
            buffers = [p.buffer for a in arguments for p in pieces(a) if isinstance(p, Place | Span | Grid | Group)]
            blank = like(variable(inner, "_"), "_")
            assert isinstance(blank, Place | Span | Grid | Group)
            zeros: list[ast.expr] = [NOTHING, *([ast.Constant(0)] * (len(offsets(blank)) - 1))]
            return rebuild(replace_buffer(blank, (buffers or self.buffers)[0]), iter(zeros))
        return value

    def inline(
        self, function: Any, arguments: Sequence[Lowered], node: ast.AST, keywords: Mapping[str, Lowered] | None = None
    ) -> Lowered:
        """Inline a call of a function that consists of assignments and a return, and return its value."""
        tree = definition(function)
        self.files.add(function.__code__.co_filename)
        frame = Frame({}, function.__globals__, f"{self.temporary('i')}_", names_of(tree))
        names = [a.arg for a in tree.args.args]
        defaults = dict(zip(names[len(names) - len(tree.args.defaults) :], tree.args.defaults, strict=True))
        values = dict(zip(names, arguments, strict=False)) | dict(keywords or {})
        again = repeated(tree)
        for name in names:
            if name in values:
                value = values[name]
                stays = name in indexed(tree) and isinstance(value, Bundle) and value.offset is not None
                frame.scope[name] = self.atoms(value) if name in again and not stays else value
            elif name in defaults:
                frame.scope[name] = self.value(defaults[name], frame)
            else:
                raise self.cannot(node, f"lacks the argument {name} of {function.__name__}")
        for statement in tree.body:
            if isinstance(statement, ast.Return) and statement.value is not None:
                return self.value(statement.value, frame)
            if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
                continue
            self.inlined(statement, frame)
        raise self.cannot(node, f"inlines {function.__name__}, which does not end with a return")

    def inlined(self, statement: ast.stmt, frame: Frame) -> None:
        if not (isinstance(statement, ast.Assign) and len(statement.targets) == 1):
            raise self.cannot(statement, "is not an assignment, as an inlined function requires")
        target, value = statement.targets[0], self.value(statement.value, frame)
        targets = target.elts if isinstance(target, ast.Tuple) else [target]
        values = value.parts if isinstance(target, ast.Tuple) and isinstance(value, Pack | Bundle) else (value,)
        for t, v in zip(targets, values, strict=True):
            if not isinstance(t, ast.Name):
                raise self.cannot(statement, "does not assign to a variable, as an inlined function requires")
            self.variables(v, t.id, t, frame)
            frame.scope[t.id] = self.atoms(v, f"{frame.prefix}{t.id}")
