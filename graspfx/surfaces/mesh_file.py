"""Mesh files as corners and triangles: STL, OBJ, PLY, OFF or GLB, up to a size, and no file that they name."""

from __future__ import annotations

from os import PathLike

import numpy as np

from graspfx.errors import InputError
from graspfx.paths import require_file, to_path
from graspfx.surfaces.mesh_glb import read_glb
from graspfx.surfaces.mesh_ply import read_ply
from graspfx.surfaces.mesh_text import MeshFault, read_obj, read_off, read_stl_text
from graspfx.surfaces.tree import FloatArray, IntArray

MOST_BYTES = 100_000_000
MOST_TRIANGLES = 500_000

FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
HEADER = 84  # [bytes]


def read_mesh_file(path: str | PathLike[str], most_bytes: int, most_triangles: int) -> tuple[FloatArray, IntArray]:
    """Read vertices (v, 3) and triangles (f, 3) as they stand in a file.

    Raises:
        InputError: no such file, another ending, more bytes or triangles than are taken, or a content that is damaged.
    """
    file = to_path("mesh", path)
    require_file("mesh", str(path), file, do="paths are relative to the scene's file")
    reader = READERS.get(file.suffix.lower())
    if reader is None:
        endings = ", ".join(sorted(READERS))
        raise InputError("mesh", str(path), f"a file that ends in {endings}", "convert it to one of these")
    try:
        with file.open("rb") as content:
            data = content.read(most_bytes + 1)
    except OSError as error:
        raise InputError("mesh", str(path), "a file that can be read", error.strerror or "") from error
    if len(data) > most_bytes:
        raise InputError("mesh", str(path), f"a file of at most {most_bytes} bytes", "raise most_bytes if it is meant")
    try:
        vertices, faces = reader(data, most_triangles)
        if len(faces) and not 0 <= faces.min() <= faces.max() < len(vertices):
            raise MeshFault(f"a triangle of vertices that are not there: there are {len(vertices)}")
        return vertices, faces
    except MeshFault as fault:
        raise InputError("mesh", str(path), f"a sound {file.suffix.lower()[1:]} file", str(fault)) from fault


def read_stl(data: bytes, most: int) -> tuple[FloatArray, IntArray]:
    """Read the facets of an STL, binary where its length is that of so many facets as its header says.

    Raises:
        MeshFault: neither form, or too many facets.
    """
    count = int.from_bytes(data[HEADER - 4 : HEADER], "little") if len(data) >= HEADER else -1
    if count < 0 or len(data) != HEADER + count * FACET.itemsize:
        if data[:HEADER].lstrip()[:5].lower() == b"solid" and b"\0" not in data[:HEADER]:
            return read_stl_text(data, most)
        if count < 0:
            raise MeshFault("neither text from `solid` on, nor long enough for a header")
        holds = (len(data) - HEADER) / FACET.itemsize
        raise MeshFault(f"its header promises {count} facets, the file has the bytes of {holds:.6g}")
    if count > most:
        raise MeshFault(f"{count} triangles, more than the {most} of most_triangles")
    corners = np.frombuffer(data, FACET, count, HEADER)["corners"]
    return corners.reshape(-1, 3).astype(np.float64), np.arange(3 * count, dtype=np.intp).reshape(-1, 3)


READERS = {".stl": read_stl, ".obj": read_obj, ".ply": read_ply, ".off": read_off, ".glb": read_glb}
