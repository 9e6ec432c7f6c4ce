"""Records: typed views of flat blocks of float64 numbers, whose entries are accessed as declared fields.

    class Finger(Record):
        position: Vector  # p, world [m]
        touching: bool
        modes: Table = table("6", "1 + 4 * count")

A field is a number (`float`, `int`, or `bool` as 0.0 or 1.0; one entry), a value such as a `Vector` (one entry for each
number), another record, a group of records, an array, or a reference to another record in the block. The size of a
group or an array may be an expression of integer fields of the same record. There are no gaps between fields.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import sys
from collections.abc import Callable, Iterator
from functools import cache
from typing import Annotated, Any, Generic, TypeVar, get_args, get_origin, get_type_hints, overload

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError

R = TypeVar("R")
Member = TypeVar("Member", covariant=True)  # a group of records is also a group of their base class
_REFERENCE = "offset of a record from the record that refers to it"
Ref = Annotated[R, _REFERENCE]  # a field of one entry: distance from its record to the other record

_LAYOUTS: dict[type[Record], dict[str, Field]] = {}
SCALARS = (float, int, bool)


@dataclasses.dataclass(frozen=True)
class Extent:
    """Size of a field, as expressions of integer fields of the same record.

    Attributes:
        rows: Number of records, numbers, rows of a table, or entries of a record.
        columns: Number of columns of a table, or of entries of each record; empty if not applicable.
    """

    rows: str
    columns: str = ""


def many(count: str, each: str = "") -> Any:
    """Declare a group of records as a field.

    Args:
        count: Number of records, as an expression of integer fields.
        each: Number of entries of each record, as an expression of integer fields, if the size of the records varies.
    """
    return Extent(count, each)


def floats(size: str) -> Any:
    """Declare an array as a field; `size` is the number of entries, as an expression of integer fields."""
    return Extent(size)


def table(rows: str, columns: str) -> Any:
    """Declare a table, which is stored row by row, as a field; its size is given by expressions of integer fields."""
    return Extent(rows, columns)


def room(entries: str) -> Any:
    """Declare a record of variable size as a field; `entries` is its number of entries, as an expression of fields."""
    return Extent(entries)


class Field:
    """Field of a record class: its kind, and offset and size of its entries as expressions of integer fields."""

    def __init__(self, name: str, extent: Extent | None) -> None:
        self.name, self.extent = name, extent
        self.kind: Any = None
        self.reference = False
        self.offset = self.size = ""  # numbers, or expressions of the record's integers
        self.start, self.terms = 0, dict[str, int]()  # the offset: a number, plus sizes, each with its factor

    def place(self, record: Record) -> int:
        return record.offset + _formula(self.offset)(record)

    @overload
    def __get__(self, record: None, owner: type[Record]) -> Field: ...
    @overload
    def __get__(self, record: Record, owner: type[Record]) -> Any: ...
    def __get__(self, record: Record | None, owner: type[Record]) -> Any:
        if record is None:
            return self
        if type(record) not in _LAYOUTS:
            layout(type(record))
        at = self.place(record)
        if self.reference:
            return self.kind(record.buffer, record.offset + int(record.buffer[at]))
        return view(self.kind, record.buffer, at, self._shape(record))

    def __set__(self, record: Record, value: Any) -> None:
        layout(type(record))
        at = self.place(record)
        if self.reference or self.kind is Floats or self.kind is Table or get_origin(self.kind) is Many:
            raise AttributeError(f"{type(record).__name__}.{self.name} cannot be replaced: assign to its entries")
        for k, number in enumerate(numbers(value)):
            record.buffer[at + k] = number

    def _shape(self, record: Record) -> tuple[int, ...]:
        if self.extent is None:
            return ()
        return tuple([evaluate(text, record) for text in (self.extent.rows, self.extent.columns) if text])


class Record:
    """Base class of records, which are views of the entries of a block from an offset on.

    Args:
        buffer: Block, a flat buffer of float64 numbers.
        offset: Index of the record's first entry in the block.
    """

    __slots__ = ("buffer", "offset")

    def __init__(self, buffer: Any, offset: int = 0) -> None:
        self.buffer, self.offset = buffer, offset

    def __init_subclass__(cls) -> None:
        for name in inspect.get_annotations(cls):
            if hasattr(Record, name):
                raise InputError(f"{cls.__name__}.{name}", name, "a name that is not an attribute of Record")
            extent = cls.__dict__.get(name)
            setattr(cls, name, Field(name, extent if isinstance(extent, Extent) else None))

    def array(self, field: Any) -> NDArray[np.float64]:
        """Return a view of the entries of a field, (size,), as in `finger.array(Finger.position)`."""
        layout(type(self))
        start = field.place(self)
        numbers: NDArray[np.float64] = np.asarray(self.buffer)[start : start + evaluate(field.size, self)]
        return numbers


class Many(Generic[Member]):
    """Group of contiguous records, or of the values of one field in contiguous records."""

    def __init__(self, kind: type[Member], buffer: Any, offset: int, count: int, stride: int | None = None) -> None:
        self.kind, self.buffer, self.offset, self.count = kind, buffer, offset, count
        self.stride = size_of(kind) if stride is None else stride  # type: ignore[arg-type] # a class is hashable

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, i: int) -> Member:
        member: Member = view(self.kind, self.buffer, self.offset + i * self.stride)
        return member

    def __iter__(self) -> Iterator[Member]:
        return (self[i] for i in range(self.count))

    def _lay_out(self) -> None:
        if issubclass(self.kind, Record):
            layout(self.kind)

    def part(self, field: Any) -> Many[Any]:
        """Return the group of the values of one field in all records, as in `fingers.part(Finger.site)`."""
        self._lay_out()
        return Many(field.kind, self.buffer, self.offset + int(field.offset), self.count, self.stride)

    def array(self, field: Any) -> NDArray[np.float64]:
        """Return a view of one field of all records, (count,) for a field of one entry, otherwise (count, size)."""
        self._lay_out()
        block = np.asarray(self.buffer)[self.offset : self.offset + self.count * self.stride]
        rows = block.reshape(self.count, self.stride)
        first, size = int(field.offset), int(field.size)
        return rows[:, first] if size == 1 else rows[:, first : first + size]


class Floats:
    """Array of numbers in a block."""

    def __init__(self, buffer: Any, offset: int = 0) -> None:
        self.buffer, self.offset = buffer, offset

    def __getitem__(self, i: int) -> float:
        return float(self.buffer[self.offset + i])

    def __setitem__(self, i: int, value: float) -> None:
        self.buffer[self.offset + i] = value


class Table:
    """Table of numbers in a block, stored row by row."""

    def __init__(self, buffer: Any, offset: int, columns: int) -> None:
        self.buffer, self.offset, self.columns = buffer, offset, columns

    @overload
    def __getitem__(self, index: int) -> Floats: ...
    @overload
    def __getitem__(self, index: tuple[int, int]) -> float: ...
    def __getitem__(self, index: int | tuple[int, int]) -> Floats | float:
        if isinstance(index, tuple):
            return float(self.buffer[self.offset + index[0] * self.columns + index[1]])
        return Floats(self.buffer, self.offset + index * self.columns)

    def __setitem__(self, index: tuple[int, int], value: float) -> None:
        self.buffer[self.offset + index[0] * self.columns + index[1]] = value

    def array(self, rows: int) -> NDArray[np.float64]:
        """Return a view of the first `rows` rows, (rows, columns)."""
        return np.asarray(self.buffer)[self.offset : self.offset + rows * self.columns].reshape(rows, self.columns)


def layout(cls: type[Record]) -> dict[str, Field]:
    """Return the fields of a record class by name, in order, with their offsets and sizes.

    Raises:
        InputError: If the kind of a field is not supported, or its size is missing.
    """
    fields = _LAYOUTS.get(cls)
    if fields is None:
        fields = _LAYOUTS[cls] = _layout(cls)
    return fields


def _layout(cls: type[Record]) -> dict[str, Field]:
    hints = get_type_hints(cls, include_extras=True)
    fields = {n: vars(c)[n] for c in reversed(cls.__mro__) for n in inspect.get_annotations(c)}
    start, terms = 0, dict[str, int]()
    for name, field in fields.items():
        kind = hints[name]
        if get_origin(kind) is Annotated and _REFERENCE in kind.__metadata__:
            field.reference, kind = True, get_args(kind)[0]
        field.kind, field.start, field.terms = kind, start, dict(terms)
        field.offset = " + ".join([str(start), *(f"{count} * ({term})" for term, count in terms.items())])
        field.size = "1" if field.reference else _size(cls, name, kind, field.extent)
        if field.size.isdigit():
            start += int(field.size)
        else:
            terms[field.size] = terms.get(field.size, 0) + 1
    return fields


def _size(cls: type[Record], name: str, kind: Any, extent: Extent | None) -> str:
    if kind in (Floats, Table) or get_origin(kind) is Many:
        if extent is None:
            raise InputError(f"{cls.__name__}.{name}", kind, "a size: many(...), floats(...) or table(...)")
        each = extent.columns or (str(size_of(get_args(kind)[0])) if get_origin(kind) is Many else "1")
        if extent.rows.isdigit() and each.isdigit():
            return str(int(extent.rows) * int(each))
        return extent.rows if each == "1" else f"({extent.rows}) * ({each})"
    if kind in SCALARS:
        return "1"
    if is_value(kind) or (isinstance(kind, type) and issubclass(kind, Record)):
        return str(size_of(kind)) if extent is None else extent.rows
    raise InputError(f"{cls.__name__}.{name}", kind, "float, int, bool, a value class, a record, Many, Floats or Table")


@cache
def _code(text: str) -> Any:
    return compile(text, "<size of a record>", "eval")


class _Fields(ast.NodeTransformer):
    """Replaces each name in the expression of a size by the integer field `name` of the variable `record`."""

    def visit_Name(self, node: ast.Name) -> ast.expr:
        field = ast.Attribute(ast.Name("record", ast.Load()), node.id, ast.Load())
        return ast.Call(ast.Name("int", ast.Load()), [field], [])


@cache
def _formula(text: str) -> Callable[[Record], int]:
    """Return a function that computes a size or an offset, given as the text of an expression, for a record."""
    if text.isdigit():
        number = int(text)
        return lambda record: number
    tree = _Fields().visit(ast.parse(text, mode="eval").body)
    whole = ast.parse("lambda record: int(0)", mode="eval")
    whole.body.body.args[0] = tree  # type: ignore[attr-defined]
    code = compile(ast.fix_missing_locations(whole), "<size of a record>", "eval")
    function: Callable[[Record], int] = eval(code, {"__builtins__": {}, "int": int})
    return function


def evaluate(text: str, record: Record) -> int:
    """Compute a size or an offset, given as the text of an expression of integer fields, for a record."""
    return _formula(text)(record)


def is_value(kind: Any) -> bool:
    """Return whether a kind is a value class, which is a frozen dataclass."""
    return dataclasses.is_dataclass(kind) and isinstance(kind, type) and kind.__dataclass_params__.frozen  # type: ignore[attr-defined]


def parts_of(kind: Any) -> dict[str, Any]:
    """Return the kinds of the fields of a value class, by name."""
    return _parts(kind)


@cache
def _parts(kind: Any) -> dict[str, Any]:
    hints = get_type_hints(kind, vars(sys.modules[kind.__module__]))
    return {field.name: hints[field.name] for field in dataclasses.fields(kind)}


@cache
def size_of(kind: Any) -> int:
    """Return the number of entries of a number, a value class, or a record class of fixed size.

    Raises:
        InputError: If the size of the record class varies.
    """
    if kind in SCALARS:
        return 1
    if is_value(kind):
        return sum(size_of(part) for part in parts_of(kind).values())
    sizes = [field.size for field in layout(kind).values()]
    fixed = [int(size) for size in sizes if size.isdigit()]
    if len(fixed) < len(sizes):
        raise InputError(kind.__name__, "a record of variable size", "a record of fixed size")
    return sum(fixed)


def start_of(cls: type[Record], name: str) -> int:
    """Return the offset of a field in a record class; the field must precede all fields of variable size."""
    return int(layout(cls)[name].offset)


def entries_of(cls: type[Record], *names: str, at: int = 0) -> list[int]:
    """Return the indices in a block of the entries of fields, for a record whose first entry has the index `at`.

    The fields must precede all fields of variable size.
    """
    fields = [layout(cls)[name] for name in names]
    return [at + int(field.offset) + k for field in fields for k in range(int(field.size))]


def numbers(value: Any) -> Iterator[float]:
    """Yield the numbers of a number or of a value, in the order of its fields."""
    if isinstance(value, bool | int | float | np.floating | np.integer | np.bool_):
        yield float(value)
    else:
        kind: type = type(value)
        for name in parts_of(kind):
            yield from numbers(getattr(value, name))


@cache
def _stored(kind: type) -> type:
    """Return a subclass of a value class whose item assignments change the block from which the value was read."""

    def write(self: Any, i: int, number: float) -> None:
        if not 0 <= i < size_of(kind):
            raise IndexError(i)
        self._buffer[self._offset + i] = number

    def equal(self: Any, other: object) -> bool:
        return isinstance(other, kind) and list(numbers(self)) == list(numbers(other))

    names = {"__setitem__": write, "__eq__": equal, "__hash__": kind.__hash__, "__module__": kind.__module__}
    return type(kind.__name__, (kind,), {**names, "__slots__": ("_buffer", "_offset")})


Reader = Callable[[Any, int, tuple[int, ...]], Any]


def view(kind: Any, buffer: Any, at: int, shape: tuple[int, ...] = ()) -> Any:
    """Return a copy of a number or value, or a view of records or an array, at the index `at` of a buffer.

    `shape` is the evaluated size of a group, an array or a table.
    """
    return _reader(kind)(buffer, at, shape)


@cache
def _reader(kind: Any) -> Reader:
    """Return the function that `view` calls for a kind."""
    if kind is float:
        return lambda buffer, at, shape: float(buffer[at])
    if kind is int:
        return lambda buffer, at, shape: int(buffer[at])
    if kind is bool:
        return lambda buffer, at, shape: bool(buffer[at] != 0.0)
    if kind is Floats:
        return lambda buffer, at, shape: Floats(buffer, at)
    if kind is Table:
        return lambda buffer, at, shape: Table(buffer, at, shape[1])
    if get_origin(kind) is Many:
        [member] = get_args(kind)
        return lambda buffer, at, shape: Many(member, buffer, at, *shape)
    if issubclass(kind, Record):
        return lambda buffer, at, shape: kind(buffer, at)
    return _value_reader(kind)


def _value_reader(kind: Any) -> Reader:
    stored, parts, place = _stored(kind), [], 0
    for name, part in parts_of(kind).items():
        parts.append((name, _reader(part), place))
        place += size_of(part)

    def read(buffer: Any, at: int, shape: tuple[int, ...]) -> Any:
        value: Any = object.__new__(stored)
        put = object.__setattr__
        for name, reader, first in parts:
            put(value, name, reader(buffer, at + first, ()))
        put(value, "_buffer", buffer)
        put(value, "_offset", at)
        return value

    return read


def size_for(cls: type[Record], **whole: int) -> int:
    """Return the number of entries of a record whose integer fields, on which its size depends, are given by name."""
    names: dict[str, Any] = dict(whole)
    return sum([int(eval(_code(field.size), {"__builtins__": {}}, names)) for field in layout(cls).values()])


def name_of(cls: type[Record], entry: int, buffer: Any, prefix: str = "", offset: int = 0) -> str:
    """Return the name of an entry of a record in a buffer, such as `fingers[0].force.x`.

    Args:
        cls: Class of the record.
        entry: Index of the entry in the buffer.
        buffer: Buffer.
        prefix: Text that precedes the names of the record's fields, such as `fingers[0].`.
        offset: Index of the record's first entry in the buffer.
    """
    record = cls(buffer, offset)
    for name, field in layout(cls).items():
        first = field.place(record)
        if not first <= entry < first + evaluate(field.size, record):
            continue
        label, inside = f"{prefix}{name}", entry - first
        if field.reference or field.kind in SCALARS:
            return label
        if field.kind is Floats:
            return f"{label}[{inside}]"
        if field.kind is Table:
            columns = getattr(record, name).columns
            return f"{label}[{inside // columns}, {inside % columns}]"
        if get_origin(field.kind) is Many:
            group = getattr(record, name)
            i = inside // group.stride
            return name_of(group.kind, entry, buffer, f"{label}[{i}].", first + i * group.stride)
        if is_value(field.kind):
            return f"{label}.{'.'.join(_path(field.kind, inside))}"
        return name_of(field.kind, entry, buffer, f"{label}.", first)
    return f"{prefix}[{entry - offset}]"


def _path(kind: Any, inside: int) -> list[str]:
    for name, part in parts_of(kind).items():
        if inside < size_of(part):
            return [name] if part in SCALARS else [name, *_path(part, inside)]
        inside -= size_of(part)
    raise IndexError(inside)
