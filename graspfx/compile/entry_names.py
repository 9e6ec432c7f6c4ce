"""Names of a block's entries, from its declared record."""

from __future__ import annotations

from typing import Any, get_origin

from graspfx.compile.records import SCALARS, Floats, Many, Record, Table, evaluate, is_value, layout, parts_of, size_of


def name_of(cls: type[Record], entry: int, buffer: Any, prefix: str = "", offset: int = 0) -> str:
    """Return the name of an entry of a block by its fields, such as `fingers[0].force.x`.

    Args:
        cls: Class of the record at `offset`.
        entry: Index of the entry in the buffer.
        buffer: Buffer that contains the sizes of groups and arrays.
        prefix: Text before the names of the record's fields, such as `fingers[0].`.
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
