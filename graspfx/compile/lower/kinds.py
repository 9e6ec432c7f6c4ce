"""Representation of a kernel's expressions during lowering: numbers, values, views of buffers, and constants."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, get_args, get_origin

from graspfx.compile.kernel_marks import optional
from graspfx.compile.records import SCALARS, Floats, Many, Record, Table, is_value, parts_of, size_of


@dataclass(frozen=True)
class Bundle:
    """Value of a value class `kind`, such as a vector, and its fields.

    Attributes:
        buffer: Name of the buffer that contains the value; empty if it is not in a buffer.
        offset: Index of the value's first entry in the buffer; None if it is not in a buffer.
    """

    kind: type
    parts: tuple[Lowered, ...]
    buffer: str = ""
    offset: ast.expr | None = None


@dataclass(frozen=True)
class Place:
    """Record of a class `kind`: the name of its buffer, and the index of its first entry in the buffer."""

    kind: type[Record]
    buffer: str
    offset: ast.expr


@dataclass(frozen=True)
class Group:
    """Group of records, or of the values of one field in a group of records.

    Attributes:
        kind: Class of the members.
        offset: Index of the first member's first entry in the buffer.
        stride: Distance between the first entries of successive members.
    """

    kind: type
    buffer: str
    offset: ast.expr
    stride: ast.expr
    count: ast.expr

    def member(self, at: ast.expr) -> Lowered:
        """Return the member whose first entry has the index `at` in the buffer."""
        return entries(self.kind, self.buffer, at) if is_value(self.kind) else Place(self.kind, self.buffer, at)


@dataclass(frozen=True)
class Span:
    """Array of numbers: the name of its buffer, and the index of its first entry."""

    buffer: str
    offset: ast.expr


@dataclass(frozen=True)
class Grid:
    """Table of numbers: the name of its buffer, the index of its first entry, and the number of columns."""

    buffer: str
    offset: ast.expr
    columns: ast.expr


@dataclass(frozen=True)
class Pack:
    """Tuple of expressions."""

    parts: tuple[Lowered, ...]


@dataclass(frozen=True)
class Constant:
    """Function, class or module, which is known when a kernel is lowered."""

    value: Any


Lowered = ast.expr | Bundle | Place | Group | Span | Grid | Pack | Constant

NOTHING = ast.Constant(-1)  # offset of a missing optional record


def expressions(value: Lowered) -> Iterator[ast.expr]:
    """Yield the numbers and buffers that represent a value in the arguments of a call."""
    if isinstance(value, ast.expr):
        yield value
    elif isinstance(value, Bundle | Pack):
        for part in value.parts:
            yield from expressions(part)
    elif isinstance(value, Place | Span):
        yield from (load(value.buffer), value.offset)
    elif isinstance(value, Grid):
        yield from (load(value.buffer), value.offset, value.columns)
    elif isinstance(value, Group):
        yield from (load(value.buffer), value.offset, value.stride, value.count)
    else:
        raise TypeError(f"{value} cannot be passed to a kernel")


def load(name: str) -> ast.Name:
    return ast.Name(name, ast.Load())


def variable(kind: Any, name: str) -> Lowered:
    """Return a value of a kind whose numbers and buffers are variables with names that begin with `name`."""
    kind, _ = optional(kind)
    if get_origin(kind) is tuple:
        return Pack(tuple(variable(part, f"{name}_{k}") for k, part in enumerate(get_args(kind))))
    if kind is Floats:
        return Span(f"{name}_", load(f"{name}_at"))
    if kind is Table:
        return Grid(f"{name}_", load(f"{name}_at"), load(f"{name}_columns"))
    if get_origin(kind) is Many:
        return Group(get_args(kind)[0], f"{name}_", *(load(f"{name}_{k}") for k in ("at", "stride", "count")))
    if isinstance(kind, type) and issubclass(kind, Record):
        return Place(kind, f"{name}_", load(f"{name}_at"))
    if is_value(kind):
        return Bundle(kind, tuple(variable(part, f"{name}_{k}") for k, part in parts_of(kind).items()))
    return load(name)


def labels_of(kind: Any) -> list[str]:
    """Return the types of the variables that represent a parameter of a kind.

    A type is "int", "float" or "bool"; it is empty for a buffer, or if the type of a number is not known.
    """
    kind, _ = optional(kind)
    if get_origin(kind) is tuple:
        return [label for part in get_args(kind) for label in labels_of(part)]
    if get_origin(kind) is Many:
        return ["", "int", "int", "int"]
    if kind is Table:
        return ["", "int", "int"]
    if kind is Floats or (isinstance(kind, type) and issubclass(kind, Record)):
        return ["", "int"]
    if is_value(kind):
        return [label for part in parts_of(kind).values() for label in labels_of(part)]
    return [kind.__name__ if kind in SCALARS else ""]


def like(value: Lowered, name: str) -> Lowered:
    """Return a copy of a value whose numbers are variables with names that begin with `name`, in the same buffers."""
    if isinstance(value, Bundle):
        fields = parts_of(value.kind)
        return Bundle(value.kind, tuple(like(p, f"{name}_{k}") for k, p in zip(fields, value.parts, strict=True)))
    if isinstance(value, Pack):
        return Pack(tuple(like(part, f"{name}_{k}") for k, part in enumerate(value.parts)))
    if isinstance(value, Place):
        return Place(value.kind, value.buffer, load(f"{name}_at"))
    if isinstance(value, Span):
        return Span(value.buffer, load(f"{name}_at"))
    if isinstance(value, Grid):
        return Grid(value.buffer, load(f"{name}_at"), load(f"{name}_columns"))
    if isinstance(value, Group):
        return Group(value.kind, value.buffer, *(load(f"{name}_{k}") for k in ("at", "stride", "count")))
    return load(name)


def offsets(value: Lowered) -> list[ast.expr]:
    """Return the numbers of a value in order, without its buffers."""
    if isinstance(value, Place | Span):
        return [value.offset]
    if isinstance(value, Grid):
        return [value.offset, value.columns]
    if isinstance(value, Group):
        return [value.offset, value.stride, value.count]
    if isinstance(value, Bundle | Pack):
        return [number for part in value.parts for number in offsets(part)]
    if isinstance(value, Constant):
        return []
    return [value]


def entries(kind: Any, buffer: str, at: ast.expr) -> Lowered:
    """Return the number or value of a kind whose first entry has the index `at` in a buffer."""
    if kind in SCALARS:
        entry = ast.Subscript(load(buffer), at, ast.Load())
        if kind is int:
            return ast.Call(load("int"), [entry], [])
        return ast.Compare(entry, [ast.NotEq()], [ast.Constant(0.0)]) if kind is bool else entry
    parts, offset = [], 0
    for part in parts_of(kind).values():
        parts.append(entries(part, buffer, plus(at, offset)))
        offset += size_of(part)
    return Bundle(kind, tuple(parts), buffer, at)


def plus(offset: ast.expr, k: int) -> ast.expr:
    """Return the sum of an offset and a number; a constant at the end of the offset is added to the number."""
    if isinstance(offset, ast.Constant) and isinstance(offset.value, int):
        return ast.Constant(offset.value + k)
    if isinstance(offset, ast.BinOp) and isinstance(offset.op, ast.Add) and isinstance(offset.right, ast.Constant):
        k, offset = k + int(offset.right.value), offset.left  # type: ignore[arg-type] # offsets are whole numbers
    return offset if k == 0 else ast.BinOp(offset, ast.Add(), ast.Constant(k))
