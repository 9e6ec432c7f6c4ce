"""Triangles from PLY, as text or binary: the vertices' x, y, z and the faces' lists of vertices."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from graspfx.surfaces.mesh_text import LARGEST, MeshFault, Triangles
from graspfx.surfaces.tree import FloatArray, IntArray

TYPES = {
    "char": "b", "int8": "b", "uchar": "B", "uint8": "B", "short": "h", "int16": "h", "ushort": "H", "uint16": "H",
    "int": "i", "int32": "i", "uint": "I", "uint32": "I", "float": "f", "float32": "f", "double": "d", "float64": "d",
}  # fmt: skip
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
CORNERS = ("vertex_indices", "vertex_index")
LONGEST_HEADER = 100_000  # [bytes]

Row = dict[str, list[float]]  # by property; of one that is no list, a list of one


@dataclass
class Element:
    """One kind of row: how many there are, and by property its type, or those of a list's length and of its items."""

    name: str
    count: int
    properties: dict[str, tuple[str, ...]] = field(default_factory=dict)


def read_ply(data: bytes, most: int) -> tuple[FloatArray, IntArray]:
    """Read vertices and faces, in whichever of the three forms the header says.

    Raises:
        MeshFault: no PLY, a header that promises what the file does not hold, or faces that are none.
    """
    order, elements, start = _header(data)
    counts = {element.name: element.count for element in elements}
    read = Triangles(most)
    read.require(counts.get("face", 0))
    if sum(element.count for element in elements) > len(data) - start:
        raise MeshFault("its header promises more rows than the file has bytes")
    rows = _Binary(data, start, order) if order else _Text(data[start:])
    for element in elements:
        if element.name not in ("vertex", "face"):
            deque(rows.of(element), maxlen=0)  # read past
        elif element.name == "vertex":
            _require(element, 1, "x", "y", "z")
            for row in rows.of(element):
                read.corner([row["x"][0], row["y"][0], row["z"][0]], "vertices")
        else:
            name = next((name for name in CORNERS if name in element.properties), CORNERS[0])
            _require(element, 2, name)
            for k, row in enumerate(rows.of(element)):
                if not all(abs(corner) < LARGEST and corner == int(corner) for corner in row[name]):
                    raise MeshFault(f"face {k}: corners that are no whole numbers")
                read.polygon([int(corner) for corner in row[name]], f"face {k}")
    return read.arrays()


def _require(element: Element, types: int, *names: str) -> None:
    """Require properties of one type, or lists, which have two."""
    for name in names:
        if len(element.properties.get(name, ())) != types:
            kind = "number" if types == 1 else "list"
            raise MeshFault(f"the element {element.name} has no {kind} {name}")


def _header(data: bytes) -> tuple[str, list[Element], int]:
    """The order of bytes (none for text), the elements, and where their rows begin."""
    begin = data[:LONGEST_HEADER]
    end = begin.find(b"\nend_header")
    after = begin.find(b"\n", end + 1)
    if not begin.startswith(b"ply") or end < 0 or after < 0:
        raise MeshFault("no header from `ply` to `end_header`")
    order: str | None = None
    elements: list[Element] = []
    for line in begin[:end].decode("latin-1").splitlines()[1:]:
        words = line.split()
        if words[:1] == ["format"] and len(words) > 1:
            order = ORDERS.get(words[1])
        elif words[:1] == ["element"]:
            if len(words) != 3 or not words[2].isdecimal() or len(words[2]) > 18:
                raise MeshFault(f"no element in its header: {line[:60]!r}")
            elements.append(Element(words[1], int(words[2])))
        elif words[:1] == ["property"]:
            types = words[2:-1] if words[1:2] == ["list"] else words[1:-1]
            size = 2 if words[1:2] == ["list"] else 1
            known = len(types) == size and all(each in TYPES for each in types)
            if not elements or not known or (size == 2 and TYPES[types[0]] in "fd"):
                raise MeshFault(f"no property in its header: {line[:60]!r}")
            elements[-1].properties[words[-1]] = tuple(TYPES[each] for each in types)
    if order is None:
        raise MeshFault("no format in its header that is ascii or binary")
    return order, elements, after + 1


class _Text:
    """Rows as words."""

    def __init__(self, body: bytes) -> None:
        self._words = iter(body.split())

    def of(self, element: Element) -> Iterator[Row]:
        for _ in range(element.count):
            yield {name: self._take(len(types) == 2, element) for name, types in element.properties.items()}

    def _take(self, is_list: bool, element: Element) -> list[float]:
        try:
            size = int(next(self._words)) if is_list else 1
            return [float(next(self._words)) for _ in range(size)]
        except (StopIteration, ValueError) as error:
            raise MeshFault(f"its rows are fewer than the {element.count} of {element.name}, or no numbers") from error


class _Binary:
    """Rows as bytes."""

    def __init__(self, data: bytes, at: int, order: str) -> None:
        self._data, self._at, self._order = data, at, order

    def of(self, element: Element) -> Iterator[Row]:
        alike = self._alike(element)
        yield from self._each(element) if alike is None else alike

    def _alike(self, element: Element) -> list[Row] | None:
        """All rows at once, where all lists are as long as those of the first; else None."""
        if not element.count:
            return []
        begin = self._at
        first = next(self._each(element))
        layout: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
        lists = {}
        for k, (name, types) in enumerate(element.properties.items()):
            if len(types) == 2:
                lists[f"n{k}"] = len(first[name])
                layout.append((f"n{k}", self._order + types[0]))
            layout.append((f"p{k}", self._order + types[-1], (len(first[name]),)))
        kind = np.dtype(layout)
        whole = len(self._data) - begin >= element.count * kind.itemsize
        table = np.frombuffer(self._data, kind, element.count if whole else 0, begin)
        if not whole or any((table[name] != size).any() for name, size in lists.items()):
            self._at = begin
            return None
        self._at = begin + table.nbytes
        columns = [table[f"p{k}"].tolist() for k in range(len(element.properties))]
        return [dict(zip(element.properties, row, strict=True)) for row in zip(*columns, strict=True)]

    def _each(self, element: Element) -> Iterator[Row]:
        for _ in range(element.count):
            row: Row = {}
            for name, types in element.properties.items():
                size = int(self._take(types[0], 1, element)[0]) if len(types) == 2 else 1
                row[name] = self._take(types[-1], size, element)
            yield row

    def _take(self, kind: str, size: int, element: Element) -> list[float]:
        length = struct.calcsize(f"{self._order}{kind}")
        if size < 0 or self._at + size * length > len(self._data):
            raise MeshFault(f"it ends before its {element.count} rows of {element.name}")
        values = struct.unpack_from(f"{self._order}{size}{kind}", self._data, self._at)
        self._at += size * length
        return list(values)
