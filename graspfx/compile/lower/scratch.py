"""State of the lowering of a kernel: statements, temporary variables, offsets of fields, and error messages."""

from __future__ import annotations

import ast
import builtins
import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, get_args, get_origin

from graspfx.compile.kernel_marks import LOWERED
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
from graspfx.compile.records import Field, Floats, Many, Record, Table, is_value, layout, size_of
from graspfx.errors import InputError, KernelError


@dataclass
class Frame:
    """Names in a kernel or in an inlined function.

    Attributes:
        scope: Expressions of the variables, by name.
        namespace: Objects of the module, by name.
        prefix: Prefix of the variables of an inlined function.
        written: All names in the source, which new variables must not have.
    """

    scope: dict[str, Lowered]
    namespace: Mapping[str, Any]
    prefix: str = ""
    written: frozenset[str] = frozenset()


class Scratch:
    """Statements and temporary variables of one kernel while it is lowered.

    Statements that must be executed before the expression that is being lowered are appended to `out`.
    """

    def __init__(self, file: str) -> None:
        self.file = file
        self.out: list[ast.stmt] = []
        self.temporaries = 0
        self.written: frozenset[str] = frozenset()  # all names in the kernel's source
        self.files: set[str] = {file}
        self.callees: dict[str, Callable[..., Any]] = {}
        self.buffers: list[str] = []  # buffers among the kernel's parameters
        self.records: set[str] = set()  # offsets of parameters that are records and not optional
        self.sizes: dict[tuple[str, str], tuple[str, ast.expr]] = {}  # sizes of fields of these records, computed once

    def entry(self, owner: Place, field: Field) -> Lowered:
        """Return the expression of a field of a record."""
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
        """Return the index in the buffer of the first entry of a record's field."""
        at = owner.offset
        for term, count in field.terms.items():
            size = self.fixed_size(owner, term)
            at = ast.BinOp(at, ast.Add(), size if count == 1 else ast.BinOp(ast.Constant(count), ast.Mult(), size))
        return plus(at, field.start)

    def fixed_size(self, owner: Place, text: str) -> ast.expr:
        """Return a size, as `size` does, on which the offsets of a record's fields depend.

        If the record is a parameter of the kernel, the size is computed once, at the beginning of the kernel.
        """
        if not (isinstance(owner.offset, ast.Name) and owner.offset.id in self.records):
            return self.size(owner, text)
        if (owner.buffer, text) not in self.sizes:
            self.sizes[owner.buffer, text] = self.free_name(f"{owner.buffer}{len(self.sizes)}"), self.size(owner, text)
        return load(self.sizes[owner.buffer, text][0])

    def size(self, owner: Place, text: str) -> ast.expr:
        """Return a size, given as the text of an expression of a record's integer fields."""

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
            # numbers of the kernel's own module are named in the program; those of other modules become constants
            return load(name) if not frame.prefix and frame.namespace.get(name) is item else ast.Constant(item)
        if is_value(type(item)):
            return value_of(item)
        return Constant(item)

    def callee(self, node: ast.expr, function: Any, frame: Frame) -> ast.expr:
        """Return the name by which the lowered text calls a function.

        The name in the source is used, except for kernels and in inlined functions. There, a new name is chosen, unless
        the function is a builtin.
        """
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
        """Return a name that does not occur in the source of the kernel, by appending underscores."""
        while name in self.written:
            name += "_"
        return name

    def temporary(self, letter: str = "t") -> str:
        """Return the name of a new variable.

        No name in the source of the kernel is equal to it, or begins with it and an underscore.
        """
        while True:
            self.temporaries += 1
            name = f"{letter}{self.temporaries}"
            if not any(each == name or each.startswith(f"{name}_") for each in self.written):
                return name

    def require_other(self, name: str, value: Lowered, node: ast.AST, frame: Frame) -> None:
        """Raise an error if a variable for a number of the value `name` has a name that also occurs in the source."""
        for number in expressions(value):
            own = number.id.removeprefix(frame.prefix) if isinstance(number, ast.Name) else name
            if own != name and own in frame.written:
                raise self.cannot(node, f"lowers {name!r} to {own!r}, which already exists: rename one of them")

    def variables(self, value: Lowered, name: str, node: ast.AST, frame: Frame) -> Lowered:
        """Return a copy of a value whose numbers are variables with names that begin with `name`."""
        result = like(value, frame.prefix + name)
        for number in offsets(result):
            self.require_other(name, number, node, frame)
        return result

    def atom(self, node: ast.expr) -> ast.expr:
        """Return a variable to which a number is assigned; the number itself if it is a variable or a constant."""
        if isinstance(node, ast.Name | ast.Constant):
            return node
        name = self.temporary()
        self.out.append(assign(name, node))
        return load(name)

    def atoms(self, value: Lowered, name: str = "") -> Lowered:
        """Return a copy of a value whose numbers are variables; the value itself if they are variables or constants."""
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
        """Raise a KernelError if an index is a negative constant, which is out of range in a block."""
        for index in indices:
            try:
                negative = ast.literal_eval(index) < 0
            except ValueError:
                continue
            if negative:
                why = "is a negative index; the last entry of a group or an array is [count - 1]"
                raise self.cannot(node, why, KernelError)

    def cannot(self, node: ast.AST, why: str, kind: type[InputError] = InputError) -> InputError:
        line = getattr(node, "lineno", 0)
        text = ast.unparse(ast.fix_missing_locations(copy.deepcopy(node))).splitlines()[0]
        return kind(f"{self.file}:{line}", text, "a construct supported in kernels", f"it {why}")
