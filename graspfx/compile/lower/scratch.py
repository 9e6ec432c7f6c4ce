"""Scratch space of a lowering: statements, temporary variables, entries of records, errors."""

from __future__ import annotations

import ast
import builtins
import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, get_args, get_origin

from graspfx.compile.lower.kinds import (
    Constant,
    Grid,
    Group,
    Lowered,
    Place,
    Span,
    entries,
    expressions,
    like,
    load,
    offsets,
    plus,
)
from graspfx.compile.lower.pieces import (
    assign,
    assign_all,
    value_of,
)
from graspfx.compile.marks import LOWERED
from graspfx.compile.records import Field, Floats, Many, Record, Table, is_value, layout, size_of
from graspfx.errors import InputError, KernelError


@dataclass
class Frame:
    """The names of one function: those of its variables, and those of its module."""

    scope: dict[str, Lowered]
    namespace: Mapping[str, Any]
    prefix: str = ""  # of the variables of a function that is written out
    written: frozenset[str] = frozenset()  # all names in its source: what a lowering adds must be others


class Scratch:
    """The statements and temporary variables of one kernel; what must come before an expression is put into `out`."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.out: list[ast.stmt] = []
        self.temporaries = 0
        self.written: frozenset[str] = frozenset()  # all names in the kernel's source
        self.files: set[str] = {file}
        self.callees: dict[str, Callable[..., Any]] = {}
        self.buffers: list[str] = []  # of the kernel's parameters
        self.records: set[str] = set()  # offsets of the parameters that are records, none of them optional
        self.sizes: dict[tuple[str, str], tuple[str, ast.expr]] = {}  # of their fields, worked out at the beginning

    def entry(self, owner: Place, field: Field) -> Lowered:
        """Read a field of a record."""
        at = self.at(owner, field)
        kind = field.kind
        if field.reference:
            away = ast.Call(load("int"), [ast.Subscript(load(owner.buffer), at, ast.Load())], [])
            return Place(kind, owner.buffer, ast.BinOp(owner.offset, ast.Add(), away))
        if kind is Floats:
            return Span(owner.buffer, at)
        if kind is Table:
            assert field.extent is not None
            return Grid(owner.buffer, at, self.fixed_size(owner, field.extent.columns))
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
        """Express where a field begins."""
        at = owner.offset
        for term, count in field.terms.items():
            size = self.fixed_size(owner, term)
            at = ast.BinOp(at, ast.Add(), size if count == 1 else ast.BinOp(ast.Constant(count), ast.Mult(), size))
        return plus(at, field.start)

    def fixed_size(self, owner: Place, text: str) -> ast.expr:
        """Express a size on which offsets depend: of a parameter's record it is worked out once, at the beginning."""
        if not (isinstance(owner.offset, ast.Name) and owner.offset.id in self.records):
            return self.size(owner, text)
        if (owner.buffer, text) not in self.sizes:
            self.sizes[owner.buffer, text] = self.free_name(f"{owner.buffer}{len(self.sizes)}"), self.size(owner, text)
        return load(self.sizes[owner.buffer, text][0])

    def size(self, owner: Place, text: str) -> ast.expr:
        """Express a size by the record's entries."""

        class Loads(ast.NodeTransformer):
            def visit_Name(self, node: ast.Name) -> ast.expr:
                field_ = layout(owner.kind)[node.id]
                entry = entries(field_.kind, owner.buffer, plus(owner.offset, int(field_.offset)))
                assert isinstance(entry, ast.expr)
                return entry

        tree: ast.expr = Loads().visit(ast.parse(text, mode="eval").body)
        return tree

    def constant(self, item: Any, name: str, frame: Frame) -> Lowered:
        if isinstance(item, bool | int | float):
            # the kernel's own module names its numbers in the program; those of others are written out
            return load(name) if not frame.prefix and frame.namespace.get(name) is item else ast.Constant(item)
        if is_value(type(item)):
            return value_of(item)
        return Constant(item)

    def callee(self, node: ast.expr, function: Any, frame: Frame) -> ast.expr:
        """Name a function that is called: its own name in the module, or one that stands for another module's."""
        if not frame.prefix and not hasattr(function, LOWERED):
            return node
        own = str(function.__name__)
        if getattr(builtins, own, None) is function:
            return load(own)
        name = self.free_name(f"{own}_k" if hasattr(function, LOWERED) else own)
        while self.callees.setdefault(name, function) is not function:
            name = self.free_name(name + "_")
        return load(name)

    # Names ----------------------------------------------------------------------------------------------------------

    def free_name(self, name: str) -> str:
        """Lengthen a name until the kernel's source does not have it."""
        while name in self.written:
            name += "_"
        return name

    def temporary(self, letter: str = "t") -> str:
        """Number a variable such that neither it nor its parts, after an underscore, are in the source."""
        while True:
            self.temporaries += 1
            name = f"{letter}{self.temporaries}"
            if not any(each == name or each.startswith(f"{name}_") for each in self.written):
                return name

    def require_other(self, name: str, value: Lowered, node: ast.AST, frame: Frame) -> None:
        """Require that the variables which stand for a value of this name have none that the source has too."""
        for number in expressions(value):
            own = number.id.removeprefix(frame.prefix) if isinstance(number, ast.Name) else name
            if own != name and own in frame.written:
                raise self.cannot(node, f"{name!r} needs {own!r} for itself: give one of the two another name")

    def variables(self, value: Lowered, name: str, node: ast.AST, frame: Frame) -> Lowered:
        """Give variables of a name in the source for the numbers of a value."""
        result = like(value, frame.prefix + name)
        for number in offsets(result):
            self.require_other(name, number, node, frame)
        return result

    def atom(self, node: ast.expr) -> ast.expr:
        """Put a number in a variable, unless it is one or a constant already."""
        if isinstance(node, ast.Name | ast.Constant):
            return node
        name = self.temporary()
        self.out.append(assign(name, node))
        return load(name)

    def atoms(self, value: Lowered, name: str = "") -> Lowered:
        """Put all numbers of a value in variables."""
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

    def require_index(self, node: ast.Subscript, *indices: ast.expr) -> None:
        """Require that no index is a negative number: in Python it counts from the end, in a block from elsewhere."""
        for index in indices:
            try:
                negative = ast.literal_eval(index) < 0
            except ValueError:
                continue
            if negative:
                why = "is an entry before the first; of a group or an array the last is entry [count - 1]"
                raise self.cannot(node, why, KernelError)

    def cannot(self, node: ast.AST, why: str, kind: type[InputError] = InputError) -> InputError:
        line = getattr(node, "lineno", 0)
        text = ast.unparse(ast.fix_missing_locations(copy.deepcopy(node))).splitlines()[0]
        return kind(f"{self.file}:{line}", text, "what a kernel may hold", why)
