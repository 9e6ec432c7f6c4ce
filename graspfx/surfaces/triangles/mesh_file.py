"""Reader of mesh files (STL, OBJ, PLY, OFF and GLB) with a limit on their size; referenced files are not opened."""

from __future__ import annotations

import io
import re
import warnings
from importlib import import_module
from os import PathLike
from typing import Any

import numpy as np

from graspfx.environment import require_file, to_path
from graspfx.errors import InputError, MissingPackageError
from graspfx.surfaces.triangles.tree import FloatArray, IntArray

MOST_BYTES = 100_000_000
MOST_TRIANGLES = 500_000
ENDINGS = (".glb", ".obj", ".off", ".ply", ".stl")
GEOMETRY = re.compile(rb"^[ \t]*(?:v|f)[ \t].*$", re.MULTILINE)  # other lines of an OBJ name files or cost time
STL_HEAD, STL_TRIANGLE = 84, 50  # bytes of a binary STL: the header including the count, and each triangle
LAST_LINE = 1000  # bytes at the end of a text STL that contain its last line
LONGEST = 200  # largest number of letters of a foreign error message


def read_mesh_file(path: str | PathLike[str], most_bytes: int, most_triangles: int) -> tuple[FloatArray, IntArray]:
    """Read vertices (v, 3) and triangles (f, 3) from a mesh file; other elements are ignored.

    Raises:
        InputError: If the file is missing or damaged, exceeds `most_bytes` or `most_triangles`, or has an unsupported
            suffix.
        MissingPackageError: If trimesh is not installed.
    """
    file = to_path("mesh", path)
    require_file("mesh", str(path), file, do="paths are relative to the scene's file")
    kind = file.suffix.lower()
    if kind not in ENDINGS:
        raise InputError("mesh", str(path), f"a file that ends in {', '.join(ENDINGS)}", "convert it to one of these")
    try:
        with file.open("rb") as content:
            data = content.read(most_bytes + 1)
    except OSError as error:
        raise InputError("mesh", str(path), "a file that can be read", error.strerror or "") from error
    if len(data) > most_bytes:
        raise InputError(
            "mesh", str(path), f"a file of at most {most_bytes} bytes", "increase most_bytes to read the file"
        )
    if kind == ".stl" and (missing := _missing_of_stl(data)):
        raise InputError("mesh", str(path), "a valid stl file", f"it is truncated: {missing}; copy or export it again")
    trimesh = load_trimesh()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # arithmetic on non-finite numbers, which are refused below
            vertices, faces, count = _surface(trimesh, kind[1:], data, most_triangles)
    except Exception as error:  # trimesh may raise anything on a damaged file
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:LONGEST]
        raise InputError("mesh", str(path), f"a valid {kind[1:]} file", f"trimesh cannot read it: {reason}") from error
    if count > most_triangles:
        fault = f"the file has {count} triangles, but most_triangles is {most_triangles}"
        raise InputError(
            "mesh",
            str(path),
            f"at most {most_triangles} triangles",
            f"{fault}; increase most_triangles to read the file",
        )
    fault = "it has no triangles" if not len(faces) else ""
    if len(faces) and not 0 <= faces.min() <= faces.max() < len(vertices):
        fault = f"a triangle refers to a missing vertex: there are {len(vertices)} vertices"
    if fault:
        raise InputError("mesh", str(path), f"a valid {kind[1:]} file", fault)
    return vertices, faces


def load_trimesh() -> Any:
    """Import trimesh.

    Raises:
        MissingPackageError: If trimesh is not installed.
    """
    try:
        return import_module("trimesh")
    except ImportError as error:
        raise MissingPackageError("trimesh", "a shape from a mesh", "pip install trimesh") from error


def _missing_of_stl(data: bytes) -> str:
    """Return a description of how an STL file is truncated; empty if the file is complete."""
    if _is_text_stl(data):
        return "" if b"endsolid" in data[-LAST_LINE:] else "it ends without endsolid"
    if len(data) < STL_HEAD:
        return f"it has {len(data)} bytes, but the header requires {STL_HEAD}"
    count = int.from_bytes(data[STL_HEAD - 4 : STL_HEAD], "little")
    whole = STL_HEAD + STL_TRIANGLE * count
    return f"it has {len(data)} bytes, but {count} triangles require {whole}" if len(data) < whole else ""


def _is_text_stl(data: bytes) -> bool:
    return data.lstrip()[:5] == b"solid" and b"\0" not in data[:STL_HEAD]


def _surface(trimesh: Any, kind: str, data: bytes, most: int) -> tuple[FloatArray, IntArray, int]:
    """Read vertices, triangles, and the number of triangles from a file's bytes.

    If there are more than `most` triangles, the returned arrays are empty.
    """
    if kind == "obj":
        data = b"\n".join(GEOMETRY.findall(data))
    is_text = kind in ("obj", "off") or (kind == "stl" and _is_text_stl(data))
    content = io.StringIO(data.decode(errors="replace")) if is_text else io.BytesIO(data)
    scene = trimesh.load_scene(
        content, file_type="stl_ascii" if is_text and kind == "stl" else kind, resolver=None, process=False,
        skip_materials=True,
    )  # fmt: skip
    graph = scene.graph
    count = sum(len(scene.geometry[graph[node][1]].faces) for node in graph.nodes_geometry)
    if count > most:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.intp), count
    surface = scene.to_mesh()
    return np.array(surface.vertices, dtype=np.float64), np.array(surface.faces, dtype=np.intp), count
