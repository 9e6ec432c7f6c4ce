"""Arrays and triangles as they stand in a page: base64 of little-endian numbers, 24 bits of each number."""

from __future__ import annotations

from base64 import b64encode
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.live.scenery import Solid
from graspfx.show.picture.painter import corner_normals

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

RESOLUTION = 2.0**-24  # relative error of a number, at most: that of rounding it to 24 bits
NORMAL = 127  # of a unit normal, in whole numbers
SAME = 1e-3  # normals that differ by less are one


class Packed(NamedTuple):
    """Triangles whose corners have one normal each: where a surface has a crease, it has corners on either side."""

    vertices: FloatArray
    normals: FloatArray
    faces: IntArray


def packed(values: ArrayLike, kind: str = "f4") -> dict[str, str]:
    """Pack an array.

    Args:
        values: of any shape; the page knows it.
        kind: of numbers, as numpy has it without the order of bytes: "f4", "i1", "u1", "u2" or "u4".
    """
    array = np.asarray(values)
    if kind == "f4":  # what is too large for it is infinite, what is too small is zero, and NaN stays NaN
        with np.errstate(over="ignore", under="ignore"):
            array = array.astype("<f4")
    return {"kind": kind, "data": b64encode(np.ascontiguousarray(array, dtype=f"<{kind}").tobytes()).decode("ascii")}


def packed_solid(solid: Solid, number: int) -> dict[str, Any]:
    """Pack an object or an obstacle; `number` is that of the object with which it moves, -1 for none."""
    mesh = with_normals(solid.vertices, solid.faces)
    return {
        "name": solid.name, "colour": solid.colour, "endless": solid.endless,
        "object": number,
        "vertices": packed(mesh.vertices), "normals": packed(np.round(NORMAL * mesh.normals), "i1"),
        "faces": packed(mesh.faces, "u2" if len(mesh.vertices) < 1 << 16 else "u4"),
    }  # fmt: skip


def with_normals(vertices: FloatArray, faces: IntArray) -> Packed:
    """Give each corner its normal, as pictures have it, and merge those that are the same."""
    normals = corner_normals(vertices, faces).reshape(-1, 3)
    keys = np.column_stack([faces.reshape(-1), np.round(normals / SAME).astype(np.int64)])
    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return Packed(vertices[faces.reshape(-1)[first]], normals[first], number.reshape(-1, 3))
