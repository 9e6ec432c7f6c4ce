"""Triangles from GLB, the binary form of glTF 2.0: positions, indices and the poses of nodes, nothing else."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np

from graspfx.surfaces.mesh_text import LARGEST, MeshFault
from graspfx.surfaces.tree import FloatArray, IntArray

JSON, BINARY = 0x4E4F534A, 0x004E4942
FLOAT = 5126
TYPES = {5121: "<u1", 5123: "<u2", 5125: "<u4", FLOAT: "<f4"}
TRIANGLES = 4
POINTS_AND_LINES = (0, 1, 2, 3)
SIZES = {"SCALAR": 1, "VEC3": 3}


def read_glb(data: bytes, most: int) -> tuple[FloatArray, IntArray]:
    """Read every mesh where the nodes of the file's scene place it.

    Raises:
        MeshFault: no GLB, numbers that lead out of the file, a node twice, or what is compressed or elsewhere.
    """
    tables, binary = _chunks(data)
    parts: dict[int, list[tuple[FloatArray, IntArray]]] = {}  # of each mesh, read once however often it is placed
    vertices, faces, start, count = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.intp)], 0, 0
    for number, pose in _placed(tables):
        if number not in parts:
            parts[number] = list(_parts(tables, binary, number))
        for points, corners in parts[number]:
            count += len(corners)
            if count > most:
                raise MeshFault(f"{count} triangles and more, above the {most} of most_triangles")
            vertices.append(points @ pose[:3, :3].T + pose[:3, 3])
            faces.append(corners + start)
            start += len(points)
    return np.vstack(vertices), np.vstack(faces)


def _parts(tables: dict[str, Any], binary: bytes, number: int) -> Iterator[tuple[FloatArray, IntArray]]:
    """Points (n, 3) and triangles (f, 3) of a mesh's parts, those that have any."""
    for k, primitive in enumerate(_tables(_item(tables, "meshes", number), "primitives")):
        if primitive.get("mode", TRIANGLES) in POINTS_AND_LINES:
            continue
        if primitive.get("mode", TRIANGLES) != TRIANGLES:
            raise MeshFault(f"mesh {number} is of strips or fans, and not of triangles")
        points = _accessor(tables, binary, _whole(_table(primitive, "attributes"), "POSITION"), "VEC3")
        if "indices" in primitive:
            corners = _accessor(tables, binary, _whole(primitive, "indices"), "SCALAR").reshape(-1)
        else:
            corners = np.arange(len(points))
        if len(corners) % 3 or (len(corners) and not 0 <= corners.min() <= corners.max() < len(points)):
            raise MeshFault(f"mesh {number}, part {k}: corners that are not there, or no triangles of three")
        used, label = np.unique(corners, return_inverse=True)
        if len(corners):
            yield points[used], label.reshape(-1, 3).astype(np.intp)


def _chunks(data: bytes) -> tuple[dict[str, Any], bytes]:
    """The file's tables, and its binary chunk."""
    if len(data) < 20 or data[:4] != b"glTF":
        raise MeshFault("it does not begin as a GLB")
    version, length, size, kind = struct.unpack_from("<IIII", data, 4)
    if version != 2 or kind != JSON:
        raise MeshFault("no glTF of version 2 with its tables first")
    if length > len(data) or 20 + size > length:
        raise MeshFault(f"its header promises {max(length, 20 + size)} bytes, the file has {len(data)}")
    try:
        tables = json.loads(data[20 : 20 + size])
    except (ValueError, RecursionError) as error:
        raise MeshFault("its tables are no JSON") from error
    if not isinstance(tables, dict):
        raise MeshFault("its tables are no JSON object")
    at = 20 + size
    if at + 8 > length:
        return tables, b""
    size, kind = struct.unpack_from("<II", data, at)
    if kind != BINARY or at + 8 + size > length:
        raise MeshFault("its binary chunk ends beyond the file")
    return tables, data[at + 8 : at + 8 + size]


def _placed(tables: dict[str, Any]) -> list[tuple[int, FloatArray]]:
    """The meshes by number, and the pose (4, 4) of each, from the roots of the scene down."""
    nodes = _tables(tables, "nodes")
    if not nodes:
        return [(k, np.eye(4)) for k in range(len(_tables(tables, "meshes")))]
    if "scenes" in tables:
        roots = _item(tables, "scenes", _whole(tables, "scene") if "scene" in tables else 0).get("nodes", [])
    else:
        below = {child for node in nodes for child in _numbers(node, "children")}
        roots = [k for k in range(len(nodes)) if k not in below]
    todo = [(k, np.eye(4)) for k in _numbers({"nodes": roots}, "nodes")]
    seen: set[int] = set()
    placed = []
    while todo:
        number, above = todo.pop()
        if number in seen:
            raise MeshFault(f"node {number} is below two others, or below itself")
        seen.add(number)
        node = _item(tables, "nodes", number)
        pose = above @ _pose(node)
        if "mesh" in node:
            placed.append((_whole(node, "mesh"), pose))
        todo += [(child, pose) for child in _numbers(node, "children")]
    return placed


def _pose(node: dict[str, Any]) -> FloatArray:
    """A node's own, (4, 4): its matrix, or a translation, a turn and a scale."""
    if "matrix" in node:
        return _floats(node, "matrix", 16).reshape(4, 4).T
    pose = np.eye(4)
    x, y, z, w = _floats(node, "rotation", 4) if "rotation" in node else (0.0, 0.0, 0.0, 1.0)
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    pose[:3, :3] = turn * _floats(node, "scale", 3) if "scale" in node else turn
    pose[:3, 3] = _floats(node, "translation", 3) if "translation" in node else 0.0
    return pose


def _accessor(tables: dict[str, Any], binary: bytes, number: int, shape: str) -> Any:
    """The rows of an accessor, (n, 3) or (n, 1), as it stands in the binary chunk."""
    accessor = _item(tables, "accessors", number)
    where = f"accessor {number}"
    if "sparse" in accessor or "bufferView" not in accessor:
        raise MeshFault(f"{where} is sparse or compressed: write the file without")
    if accessor.get("type") != shape or (accessor.get("componentType") == FLOAT) != (shape == "VEC3"):
        raise MeshFault(f"{where} is no {shape} of its kind")
    kind = TYPES.get(_whole(accessor, "componentType"))
    view = _item(tables, "bufferViews", _whole(accessor, "bufferView"))
    buffer = _item(tables, "buffers", _whole(view, "buffer"))
    if kind is None or "uri" in buffer:
        raise MeshFault(f"{where} is of another file, or of another kind of number")
    count, columns, width = _whole(accessor, "count"), SIZES[shape], np.dtype(kind).itemsize
    start = _whole(view, "byteOffset", 0) + _whole(accessor, "byteOffset", 0)
    stride = _whole(view, "byteStride", columns * width)
    end = start + (stride * (count - 1) + columns * width if count else 0)
    if stride < columns * width or end > len(binary):
        raise MeshFault(f"{where} promises {count} rows up to byte {end}, of {len(binary)}")
    rows = np.ndarray((count, columns), kind, binary, start, (stride, width))
    return rows.astype(np.float64 if shape == "VEC3" else np.int64)


def _item(tables: dict[str, Any], name: str, number: int) -> dict[str, Any]:
    items = tables.get(name, [])
    if not isinstance(items, list) or not number < len(items) or not isinstance(items[number], dict):
        raise MeshFault(f"there is no number {number} of its {name}")
    item: dict[str, Any] = items[number]
    return item


def _tables(table: dict[str, Any], name: str) -> list[dict[str, Any]]:
    items = table.get(name, [])
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise MeshFault(f"its {name} are no list of tables")
    return items


def _table(table: dict[str, Any], name: str) -> dict[str, Any]:
    value = table.get(name)
    if not isinstance(value, dict):
        raise MeshFault(f"its {name} are no table")
    return value


def _whole(table: dict[str, Any], name: str, default: int | None = None) -> int:
    value = table.get(name, default)
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < LARGEST:
        raise MeshFault(f"{name} is no whole number of zero or more")
    return value


def _numbers(table: dict[str, Any], name: str) -> list[int]:
    values = table.get(name, [])
    if not isinstance(values, list):
        raise MeshFault(f"its {name} are no list")
    return [_whole({name: value}, name) for value in values]


def _floats(table: dict[str, Any], name: str, size: int) -> FloatArray:
    values = table[name]
    if not isinstance(values, list) or len(values) != size:
        raise MeshFault(f"a {name} of a node has not {size} numbers")
    if not all(isinstance(value, int | float) and abs(value) < LARGEST for value in values):
        raise MeshFault(f"a {name} of a node has not {size} numbers")
    return np.array(values, dtype=np.float64)
