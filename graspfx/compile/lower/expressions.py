"""Expressions of a kernel, lowered: fields become entries, operators of values the arithmetic of their class."""

from __future__ import annotations

import ast
import builtins
import copy
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from types import FunctionType
from typing import Any, get_args, get_origin

from graspfx.compile.kernel import INLINE, LOWERED, optional, parameter_kinds
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
    entries,
    expressions,
    like,
    load,
    offsets,
    plus,
    variable,
)
from graspfx.compile.records import SCALARS, Field, Floats, Many, Record, Table, is_value, layout, parts_of, size_of
from graspfx.compile.specialise.definitions import definition
from graspfx.errors import InputError

OPERATORS: dict[type[ast.operator], str] = {
    ast.Add: "add",
    ast.Sub: "sub",
    ast.Mult: "mul",
    ast.Div: "truediv",
    ast.MatMult: "matmul",
}


@dataclass
class Frame:
    """The names of one function: those of its variables, and those of its module."""

    scope: dict[str, Lowered]
    namespace: Mapping[str, Any]
    prefix: str = ""  # of the variables of a function that is written out


class Expressions:
    """The expressions of one kernel; statements that must come before an expression are put into `out`."""

    def __init__(self, name: str, file: str) -> None:
        self.kernel, self.file = name, file
        self.out: list[ast.stmt] = []
        self.temporaries = 0
        self.depth = 0
        self.files: set[str] = {file}
        self.callees: dict[str, Callable[..., Any]] = {}
        self.buffers: list[str] = []  # of the kernel's parameters

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
        raise self.cannot(node, "is no expression of a kernel")

    def number(self, node: ast.expr, frame: Frame) -> ast.expr:
        value = self.value(node, frame)
        if isinstance(value, ast.expr):
            return value
        raise self.cannot(node, "is no number")

    def name(self, node: ast.Name, frame: Frame) -> Lowered:
        if node.id in frame.scope:
            return frame.scope[node.id]
        missing = object()
        known = frame.namespace.get(node.id, getattr(builtins, node.id, missing))
        if known is missing:
            return load(frame.prefix + node.id)  # assigned to in a branch
        return self.constant(known, node.id, frame)

    def constant(self, known: Any, name: str, frame: Frame) -> Lowered:
        if isinstance(known, bool | int | float):
            # the kernel's own module names its numbers in the program; those of others are written out
            return load(name) if not frame.prefix and frame.namespace.get(name) is known else ast.Constant(known)
        if is_value(type(known)):
            return value_of(known)
        return Constant(known)

    def attribute(self, node: ast.Attribute, frame: Frame) -> Lowered:
        owner = self.value(node.value, frame)
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
            known = getattr(owner.value, node.attr)
            if isinstance(known, bool | int | float):
                return node if isinstance(node.value, ast.Name) and not frame.prefix else ast.Constant(known)
            return Constant(known)
        if isinstance(owner, Group) and node.attr == "count":
            return owner.count
        if isinstance(owner, Grid) and node.attr == "columns":
            return owner.columns
        if isinstance(owner, Place | Span | Grid | Group) and node.attr in ("buffer", "offset"):
            return load(owner.buffer) if node.attr == "buffer" else owner.offset
        raise self.cannot(node, f"has no field {node.attr!r}")

    # Memory -------------------------------------------------------------------------------------------------------

    def field(self, owner: Place, node: ast.Attribute, frame: Frame) -> Lowered:
        field = layout(owner.kind).get(node.attr)
        if field is None:
            if node.attr in ("buffer", "offset"):
                return load(owner.buffer) if node.attr == "buffer" else owner.offset
            member = getattr(owner.kind, node.attr, None)
            if isinstance(member, property) and isinstance(member.fget, FunctionType):
                return self.inline(member.fget, [owner], node)
            if member is not None:
                raise self.cannot(node, "is a method: call it")
            raise self.cannot(node, f"has no field {node.attr!r}")
        return self.entry(owner, field)

    def entry(self, owner: Place, field: Field) -> Lowered:
        """What stands in a field of a record."""
        at = self.at(owner, field)
        kind = field.kind
        if field.reference:
            stands = ast.Call(load("int"), [ast.Subscript(load(owner.buffer), at, ast.Load())], [])
            return Place(kind, owner.buffer, stands)
        if kind is Floats:
            return Span(owner.buffer, at)
        if kind is Table:
            assert field.extent is not None
            return Grid(owner.buffer, at, self.size(owner, field.extent.columns))
        if get_origin(kind) is Many:
            assert field.extent is not None
            each = get_args(kind)[0]
            columns = field.extent.columns
            stride = self.size(owner, columns) if columns else ast.Constant(size_of(each))
            return Group(each, owner.buffer, at, stride, self.size(owner, field.extent.rows))
        if isinstance(kind, type) and issubclass(kind, Record):
            return Place(kind, owner.buffer, at)
        return entries(kind, owner.buffer, at)

    def at(self, owner: Place, field: Field) -> ast.expr:
        if field.offset.isdigit():
            return plus(owner.offset, int(field.offset))
        return ast.BinOp(owner.offset, ast.Add(), self.size(owner, field.offset))

    def size(self, owner: Place, text: str) -> ast.expr:
        """A size as an expression of the record's entries."""

        class Loads(ast.NodeTransformer):
            def visit_Name(self, node: ast.Name) -> ast.expr:
                known = layout(owner.kind)[node.id]
                entry = entries(known.kind, owner.buffer, plus(owner.offset, int(known.offset)))
                assert isinstance(entry, ast.expr)
                return entry

        tree: ast.expr = Loads().visit(ast.parse(text, mode="eval").body)
        return tree

    def item(self, node: ast.Subscript, frame: Frame) -> Lowered:
        owner = self.value(node.value, frame)
        if isinstance(owner, Grid) and isinstance(node.slice, ast.Tuple):
            row, column = (self.number(part, frame) for part in node.slice.elts)
            return ast.Subscript(load(owner.buffer), grid_entry(owner, row, column), ast.Load())
        index = self.number(node.slice, frame)
        if isinstance(owner, Span):
            return ast.Subscript(load(owner.buffer), sum_of(owner.offset, index), ast.Load())
        if isinstance(owner, Grid):
            return Span(owner.buffer, sum_of(owner.offset, product_of(index, owner.columns)))
        if isinstance(owner, Group):
            return owner.member(sum_of(owner.offset, product_of(index, owner.stride)))
        if isinstance(owner, Bundle | Pack):
            if isinstance(index, ast.Constant) and isinstance(index.value, int):
                return owner.parts[index.value]
            if isinstance(owner, Bundle) and owner.offset is not None:
                return ast.Subscript(load(owner.buffer), sum_of(owner.offset, index), ast.Load())
            raise self.cannot(node, "is an entry that only the running program knows of a value in no record")
        if isinstance(owner, ast.Name):  # a plain buffer
            return ast.Subscript(owner, index, ast.Load())
        raise self.cannot(node, "is no entry of anything")

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
        raise self.cannot(node, "has no such operator")

    def unary(self, node: ast.UnaryOp, frame: Frame) -> Lowered:
        value = self.value(node.operand, frame)
        if isinstance(value, Bundle) and isinstance(node.op, ast.USub):
            return self.inline(vars(value.kind)["__neg__"], [value], node)
        if isinstance(value, ast.expr):
            return ast.UnaryOp(node.op, value)
        raise self.cannot(node, "is no number")

    def compare(self, node: ast.Compare, frame: Frame) -> Lowered:
        if len(node.ops) == 1 and isinstance(node.ops[0], ast.Is | ast.IsNot):
            value = self.value(node.left, frame)
            if not (isinstance(node.comparators[0], ast.Constant) and node.comparators[0].value is None):
                raise self.cannot(node, "compares identities of something else than None")
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
            if before:  # only where the first does not settle it
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
            raise self.cannot(node, "chooses between two kinds, or records of two buffers")
        a, b = offsets(one), offsets(other)
        if len(a) == 1:
            chosen: list[ast.expr] = [ast.IfExp(test, a[0], b[0])]
        else:
            test = self.atom(test)
            chosen = [ast.IfExp(test, p, q) for p, q in zip(a, b, strict=True)]
        return rebuild(one, iter(chosen))

    # Calls --------------------------------------------------------------------------------------------------------

    def call(self, node: ast.Call, frame: Frame) -> Lowered:
        if isinstance(node.func, ast.Attribute):
            bound = self.method(node.func, node, frame)
            if bound is not None:
                return bound
        called = self.value(node.func, frame)
        if not isinstance(called, Constant):
            raise self.cannot(node, "calls something else than a function")
        function = called.value
        function = getattr(function, LOWERED, function)
        if isinstance(function, type) and is_value(function):
            return self.construct(function, node, frame)
        if isinstance(function, type) and issubclass(function, Record | Floats | Table):
            return self.view(function, node, frame)
        arguments = [self.value(a, frame) for a in node.args]
        named = {str(k.arg): self.value(k.value, frame) for k in node.keywords}
        if function is len and isinstance(arguments[0], Group):
            return arguments[0].count
        if getattr(function, INLINE, False):
            return self.inline(function, arguments, node, named)
        return self.kernel_call(node, called.value, function, arguments, named, frame)

    def method(self, func: ast.Attribute, node: ast.Call, frame: Frame) -> Lowered | None:
        """A method of a value, a record or a group, written out; None if the attribute is a module's function."""
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
        given = dict(zip(fields, node.args, strict=False)) | {str(k.arg): k.value for k in node.keywords}
        if set(given) != set(fields):
            raise self.cannot(node, f"gives {', '.join(given)} to {kind.__name__}({', '.join(fields)})")
        return Bundle(kind, tuple(self.value(given[name], frame) for name in fields))

    def view(self, kind: type[Record] | type[Floats] | type[Table], node: ast.Call, frame: Frame) -> Lowered:
        """A record or an array at an offset of a buffer that the kernel has, such as `Kind(record.buffer, offset)`."""
        buffer, *rest = [self.value(a, frame) for a in node.args]
        numbers = [self.atom(number) for number in rest if isinstance(number, ast.expr)]
        if not isinstance(buffer, ast.Name) or node.keywords or len(numbers) != 1 + (kind is Table):
            raise self.cannot(node, "views something else than a buffer at an offset")
        if kind is Table:
            return Grid(buffer.id, *numbers)
        return Span(buffer.id, *numbers) if kind is Floats else Place(kind, buffer.id, *numbers)  # type: ignore[arg-type] # a record

    def kernel_call(
        self,
        node: ast.Call,
        called: Any,
        function: Any,
        arguments: Sequence[Lowered],
        named: Mapping[str, Lowered],
        frame: Frame,
    ) -> Lowered:
        """The call of a function that stays a call."""
        name = self.callee(node.func, called, frame)
        kinds = parameter_kinds(function) if isinstance(function, FunctionType) else {}
        order = list(kinds)
        args = [
            self.passed(a, kinds.get(order[k]) if k < len(order) else None, arguments) for k, a in enumerate(arguments)
        ]
        flat: list[ast.expr] = [number for a in args for number in expressions(a)]
        keywords = []
        for key, value in named.items():
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
            raise self.cannot(node, "returns a view: return its index, or choose it by a property")
        names_ = offsets(result)
        if len(names_) == 1 and isinstance(result, Pack | Bundle):
            self.out.append(ast.Assign([store_of(names_)], call))
        else:
            self.out.append(ast.Assign([store_of(names_)], call))
        return result

    def passed(self, value: Lowered, kind: Any, arguments: Sequence[Lowered]) -> Lowered:
        """An argument as its parameter asks for it; None as an offset below zero."""
        if isinstance(value, ast.Constant) and value.value is None and kind is not None:
            inner, _ = optional(kind)
            buffers = [p.buffer for a in arguments for p in pieces(a) if isinstance(p, Place | Span | Grid | Group)]
            blank = like(variable(inner, "_"), "_")
            assert isinstance(blank, Place | Span | Grid | Group)
            zeros: list[ast.expr] = [NOTHING, *([ast.Constant(0)] * (len(offsets(blank)) - 1))]
            return rebuild(replace_buffer(blank, (buffers or self.buffers)[0]), iter(zeros))
        return value

    def callee(self, node: ast.expr, function: Any, frame: Frame) -> ast.expr:
        """The name under which a function is called: its own in the module, or one that stands for another module's."""
        if not frame.prefix and not hasattr(function, LOWERED):
            return node
        own = str(function.__name__)
        if getattr(builtins, own, None) is function:
            return load(own)
        name = f"{own}_k" if hasattr(function, LOWERED) else own
        while self.callees.setdefault(name, function) is not function:
            name += "_"
        return load(name)

    def inline(
        self, function: Any, arguments: Sequence[Lowered], node: ast.AST, named: Mapping[str, Lowered] | None = None
    ) -> Lowered:
        """A function of a few assignments and a return, written out here."""
        tree = definition(function)
        self.files.add(function.__code__.co_filename)
        self.depth += 1
        self.temporaries += 1
        frame = Frame({}, function.__globals__, f"i{self.temporaries}_")
        names = [a.arg for a in tree.args.args]
        defaults = dict(zip(names[len(names) - len(tree.args.defaults) :], tree.args.defaults, strict=True))
        given = dict(zip(names, arguments, strict=False)) | dict(named or {})
        again = repeated(tree)
        for name in names:
            if name in given:
                value = given[name]
                stays = name in indexed(tree) and isinstance(value, Bundle) and value.offset is not None
                frame.scope[name] = self.atoms(value) if name in again and not stays else value
            elif name in defaults:
                frame.scope[name] = self.value(defaults[name], frame)
            else:
                raise self.cannot(node, f"gives no {name} to {function.__name__}")
        for statement in tree.body:
            if isinstance(statement, ast.Return) and statement.value is not None:
                self.depth -= 1
                return self.value(statement.value, frame)
            if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
                continue
            self.inlined(statement, frame)
        raise self.cannot(node, f"writes out {function.__name__}, which does not end with a return")

    def inlined(self, statement: ast.stmt, frame: Frame) -> None:
        if not (isinstance(statement, ast.Assign) and len(statement.targets) == 1):
            raise self.cannot(statement, "is no assignment, which is all that a function written out may hold")
        target, value = statement.targets[0], self.value(statement.value, frame)
        targets = target.elts if isinstance(target, ast.Tuple) else [target]
        values = value.parts if isinstance(target, ast.Tuple) and isinstance(value, Pack | Bundle) else (value,)
        for t, v in zip(targets, values, strict=True):
            if not isinstance(t, ast.Name):
                raise self.cannot(statement, "assigns to something else than a variable")
            frame.scope[t.id] = self.atoms(v, f"{frame.prefix}{t.id}")

    # Temporaries --------------------------------------------------------------------------------------------------

    def temporary(self) -> str:
        self.temporaries += 1
        return f"t{self.temporaries}"

    def atom(self, node: ast.expr) -> ast.expr:
        """A number in a variable, unless it is one or a constant already."""
        if isinstance(node, ast.Name | ast.Constant):
            return node
        name = self.temporary()
        self.out.append(assign(name, node))
        return load(name)

    def atoms(self, value: Lowered, name: str = "") -> Lowered:
        """All numbers of a value in variables."""
        if isinstance(value, Constant):
            return value
        numbers = offsets(value)
        if all(isinstance(number, ast.Name | ast.Constant) for number in numbers):
            return value
        if isinstance(value, ast.expr) and not name:
            return self.atom(value)
        result = like(value, name or self.temporary())
        self.out.append(assign_all(offsets(result), numbers))
        return result

    def cannot(self, node: ast.AST, why: str) -> InputError:
        line = getattr(node, "lineno", 0)
        shown = ast.unparse(ast.fix_missing_locations(copy.deepcopy(node))).splitlines()[0]
        return InputError(f"{self.file}:{line}", shown, "what a kernel may hold", why)


@cache
def repeated(tree: ast.FunctionDef) -> set[str]:
    """Name the variables of which some number is used more than once, or all at once more than once."""
    uses: Counter[tuple[str, str]] = Counter()
    whole: Counter[str] = Counter()
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            uses[node.value.id, node.attr] += 1
            whole[node.value.id] -= 1
        if isinstance(node, ast.Name):
            whole[node.id] += 1
    return {name for (name, _), count in uses.items() if count > 1 or whole[name] > 0} | {
        name for name, count in whole.items() if count > 1
    }


@cache
def indexed(tree: ast.FunctionDef) -> set[str]:
    """Name the variables of which an entry is asked for by its index."""
    subscripts = [node for node in ast.walk(tree) if isinstance(node, ast.Subscript)]
    return {node.value.id for node in subscripts if isinstance(node.value, ast.Name)}


def value_of(known: Any) -> Lowered:
    """Write out a value that a module names."""
    if isinstance(known, bool | int | float):
        return ast.Constant(known)
    return Bundle(type(known), tuple(value_of(getattr(known, name)) for name in parts_of(type(known))))


def kind_of(value: Lowered) -> tuple[object, ...]:
    """Tell what two values of a variable must have in common."""
    if isinstance(value, ast.expr):
        return ("number",)
    if isinstance(value, Bundle):
        return ("value", value.kind)
    if isinstance(value, Pack):
        return ("tuple", *map(kind_of, value.parts))
    if isinstance(value, Constant):
        return ("constant",)
    return (type(value), getattr(value, "kind", None), value.buffer)


def pieces(value: Lowered) -> list[Lowered]:
    """List what a value consists of, values within it opened."""
    if isinstance(value, Bundle | Pack):
        return [piece for part in value.parts for piece in pieces(part)]
    return [value]


def rebuild(value: Lowered, numbers: Any) -> Lowered:
    """Put other numbers in the places of a value's own."""
    if isinstance(value, Bundle):
        return Bundle(value.kind, tuple(rebuild(part, numbers) for part in value.parts))
    if isinstance(value, Pack):
        return Pack(tuple(rebuild(part, numbers) for part in value.parts))
    if isinstance(value, Place):
        return Place(value.kind, value.buffer, next(numbers))
    if isinstance(value, Span):
        return Span(value.buffer, next(numbers))
    if isinstance(value, Grid):
        return Grid(value.buffer, next(numbers), next(numbers))
    if isinstance(value, Group):
        return Group(value.kind, value.buffer, next(numbers), next(numbers), next(numbers))
    if isinstance(value, Constant):
        return value
    number: ast.expr = next(numbers)
    return number


def replace_buffer(value: Place | Span | Grid | Group, buffer: str) -> Lowered:
    if isinstance(value, Place):
        return Place(value.kind, buffer, value.offset)
    if isinstance(value, Span):
        return Span(buffer, value.offset)
    if isinstance(value, Grid):
        return Grid(buffer, value.offset, value.columns)
    return Group(value.kind, buffer, value.offset, value.stride, value.count)


def sum_of(a: ast.expr, b: ast.expr) -> ast.expr:
    """Add two offsets, constants as constants."""
    if isinstance(b, ast.Constant) and isinstance(b.value, int):
        return plus(a, b.value)
    if isinstance(a, ast.Constant):
        return plus(b, int(a.value)) if a.value else b  # type: ignore[arg-type] # offsets are whole numbers
    return ast.BinOp(a, ast.Add(), b)


def product_of(a: ast.expr, b: ast.expr) -> ast.expr:
    """Multiply an index by a stride, constants as constants."""
    if isinstance(a, ast.Constant) and isinstance(b, ast.Constant):
        return ast.Constant(int(a.value) * int(b.value))  # type: ignore[arg-type] # whole numbers
    if isinstance(a, ast.Constant) and a.value == 0:
        return a
    return ast.BinOp(a, ast.Mult(), b)


def grid_entry(grid: Grid, row: ast.expr, column: ast.expr) -> ast.expr:
    return sum_of(sum_of(grid.offset, product_of(row, grid.columns)), column)


def assign(name: str, value: ast.expr) -> ast.stmt:
    return ast.Assign([ast.Name(name, ast.Store())], value)


def assign_all(names: Sequence[ast.expr], values: Sequence[ast.expr]) -> ast.stmt:
    """Assign numbers to variables, all at once."""
    return ast.Assign([store_of(names)], values[0] if len(values) == 1 else ast.Tuple(list(values), ast.Load()))


def store_of(names: Sequence[ast.expr]) -> ast.expr:
    targets = []
    for name in names:
        target = copy.copy(name)
        target.ctx = ast.Store()  # type: ignore[attr-defined] # names and entries have one
        targets.append(target)
    return targets[0] if len(targets) == 1 else ast.Tuple(list(targets), ast.Store())
