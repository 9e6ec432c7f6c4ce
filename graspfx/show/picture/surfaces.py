"""Surfaces of shapes for drawing: triangles in space, or outlines in the plane."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.compile.records import numbers
from graspfx.errors import InputError
from graspfx.spatial import Quaternion, quaternion_matrix

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

POLE = 1e-12  # fraction of a radius below which a ring is a point
TURN = 96  # facets of a full circle
GRID = 14  # cells along the edge of a box
LINE = 0.3  # half the drawn height of shapes on a line, as a fraction of their width
BAND = 0.08  # drawn depth of the ground below a half-space, as a fraction of the picture


@dataclass(frozen=True)
class Surface:
    """Surface to draw: triangles in space, or one polygon in the plane.

    Attributes:
        vertices: Vertices (v, 3) in space, or corners of the outline (v, 2) in the plane [m].
        faces: Triangles (f, 3), counter-clockwise seen from outside; empty in the plane.
    """

    vertices: FloatArray
    faces: IntArray

    def placed(self, position: ArrayLike, orientation: ArrayLike | None) -> Surface:
        """Return the surface rotated by `orientation`, as in `rotation`, and then translated by `position` [m]."""
        x = np.zeros(self.vertices.shape[1])
        x[: np.size(position)] = position  # a position on a line is along x
        return Surface(self.vertices @ rotation(orientation, len(x)).T + x, self.faces)


def rotation(orientation: ArrayLike | None, dimensions: int) -> FloatArray:
    """Return the matrix (d, d) of a rotation: of a quaternion x, y, z, w in space, or of an angle [rad] in the plane.

    If the orientation is None, the matrix is the identity.
    """
    if orientation is None:
        return np.eye(dimensions)
    if dimensions == 2:
        c, s = float(np.cos(orientation)), float(np.sin(orientation))
        return np.array([[c, -s], [s, c]])
    q = np.asarray(orientation, dtype=float)
    R = quaternion_matrix(Quaternion(*(q / np.linalg.norm(q)).tolist()))
    return np.array(list(numbers(R))).reshape(3, 3)


def surface(shape: Mapping[str, Any], dimensions: int, extent: float, folder: Path | None = None) -> Surface:
    """Build the surface that a shape's table describes, in the shape's frame.

    Args:
        shape: Table with `kind` and the lengths of this kind, with `mesh` (path of a file), or with `vertices` and
            `faces`.
        dimensions: Number of dimensions of the drawing, 2 or 3; a shape on a line is drawn in the plane.
        extent: Size of the drawn part of a plane or of the surface of a half-space [m].
        folder: Folder to which a relative path of a mesh refers; the current folder if None.

    Raises:
        InputError: If the kind cannot be drawn, the table is incomplete, or the mesh is invalid.
    """
    kind = shape.get("kind", "mesh" if "mesh" in shape or "vertices" in shape else None)
    if kind == "mesh" and dimensions == 3:
        return _mesh(shape, folder)
    makers = SOLIDS if dimensions == 3 else OUTLINES
    if kind not in makers:
        raise InputError("shape", kind, f"a kind that can be drawn: {', '.join([*makers, 'mesh'])}")
    try:
        return makers[kind](shape, extent)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise InputError("shape", dict(shape), f"a {kind} that can be drawn", str(error)) from error


def ball(radius: float, turn: int = 24) -> Surface:
    """Build a sphere about the origin, with `turn` facets around its equator."""
    return _revolved(*_arc(radius, 0.0, pi, turn // 2), turn)


# In space ------------------------------------------------------------------------------------------------------------


def _arc(radius: float, begin: float, end: float, steps: int) -> tuple[FloatArray, FloatArray]:
    """Return distances from the z axis and heights of points on an arc; `begin` and `end` are angles from +z [rad]."""
    angle = np.linspace(begin, end, steps + 1)
    r = radius * np.sin(angle)
    return np.where(r > POLE * radius, r, 0.0), radius * np.cos(angle)


def _revolved(r: FloatArray, z: FloatArray, turn: int = TURN) -> Surface:
    """Revolve a profile about the z axis.

    Args:
        r, z: Distances from the axis and heights of the profile's points, from top to bottom [m].
        turn: Number of facets of a full circle.
    """
    angle = 2.0 * pi * np.arange(turn) / turn
    rings = np.stack(
        [np.outer(r, np.cos(angle)), np.outer(r, np.sin(angle)), np.repeat(z[:, None], turn, axis=1)], axis=2
    )
    i, j = np.arange(turn), (np.arange(turn) + 1) % turn
    faces = []
    for k in range(len(r) - 1):
        low, high = (k + 1) * turn, k * turn
        if r[k + 1] > 0.0:
            faces.append(np.column_stack([high + i, low + i, low + j]))
        if r[k] > 0.0:
            faces.append(np.column_stack([high + i, low + j, high + j]))
    return Surface(rings.reshape(-1, 3), np.concatenate(faces))


def _box(shape: Mapping[str, Any], _: float) -> Surface:
    half = 0.5 * np.array(shape["size"], dtype=float)
    steps = np.linspace(-1.0, 1.0, GRID + 1)
    u, v = (each.ravel() for each in np.meshgrid(steps, steps, indexing="ij"))
    k = np.arange(GRID * (GRID + 1)).reshape(GRID, GRID + 1)[:, :GRID].ravel()
    quads = np.concatenate([
        np.column_stack([k, k + GRID + 1, k + GRID + 2]), np.column_stack([k, k + GRID + 2, k + 1])
    ])  # fmt: skip
    vertices: list[FloatArray] = []
    faces: list[IntArray] = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            corner = np.empty((len(u), 3))
            corner[:, axis], corner[:, (axis + 1) % 3], corner[:, (axis + 2) % 3] = side, u, v
            faces.append((quads if side > 0.0 else quads[:, ::-1]) + sum(len(each) for each in vertices))
            vertices.append(corner)
    return Surface(np.concatenate(vertices) * half, np.concatenate(faces))


def _sphere(shape: Mapping[str, Any], _: float) -> Surface:
    return ball(float(shape["radius"]), TURN)


def _ellipsoid(shape: Mapping[str, Any], _: float) -> Surface:
    unit = ball(1.0, TURN)
    return Surface(unit.vertices * np.array(shape["semi_axes"], dtype=float), unit.faces)


def _capsule(shape: Mapping[str, Any], _: float) -> Surface:
    radius, half = float(shape["radius"]), 0.5 * float(shape["length"])
    (r, z), (low_r, low_z) = (_arc(radius, *ends, TURN // 4) for ends in ((0.0, 0.5 * pi), (0.5 * pi, pi)))
    wall = np.linspace(half, -half, _steps(2.0 * half, radius))[1:-1]
    heights = np.concatenate([z + half, wall, low_z - half])
    return _revolved(np.concatenate([r, np.full(len(wall), radius), low_r]), heights)


def _cylinder(shape: Mapping[str, Any], _: float) -> Surface:
    radius, half = float(shape["radius"]), 0.5 * float(shape["length"])
    cap = np.linspace(0.0, radius, TURN // 6)
    wall = np.linspace(half, -half, _steps(2.0 * half, radius))[1:-1]
    r = np.concatenate([cap, np.full(len(wall), radius), cap[::-1]])
    return _revolved(r, np.concatenate([np.full(len(cap), half), wall, np.full(len(cap), -half)]))


def _steps(length: float, radius: float) -> int:
    """Return the number of points along a cylinder's wall, including its ends, for approximately square cells."""
    return 2 + min(GRID * 4, int(length / (2.0 * pi * radius / TURN)))


def _patch(shape: Mapping[str, Any], extent: float) -> Surface:
    """Build a square of edge `extent` in the plane through the origin with the shape's normal."""
    w = np.array(shape["normal"], dtype=float)
    w /= np.linalg.norm(w)
    u = np.cross(w, np.eye(3)[np.abs(w).argmin()])
    u /= np.linalg.norm(u)
    corners = 0.5 * extent * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ np.array([u, np.cross(w, u)])
    return Surface(corners, np.array([[0, 1, 2], [0, 2, 3]]))


def _mesh(shape: Mapping[str, Any], folder: Path | None) -> Surface:
    from graspfx.surfaces.triangles.mesh import load_mesh, make_mesh

    settings = {"scale": shape.get("scale", 1.0), "shell": bool(shape.get("shell", False))}
    if shape.get("mesh") is None:
        mesh = make_mesh(shape["vertices"], shape["faces"], **settings)
    else:
        mesh = load_mesh((folder or Path()) / str(shape["mesh"]), **settings)
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.faces))


# In the plane, and on a line -----------------------------------------------------------------------------------------


def _ellipse(a: float, b: float) -> Surface:
    angle = np.linspace(0.0, 2.0 * pi, 2 * TURN, endpoint=False)
    return _outline(np.column_stack([a * np.cos(angle), b * np.sin(angle)]))


def _outline(corners: ArrayLike) -> Surface:
    return Surface(np.asarray(corners, dtype=float), np.empty((0, 3), dtype=np.int64))


def _rectangle(shape: Mapping[str, Any], _: float) -> Surface:
    size = [*map(float, shape["size"])]
    a, b = 0.5 * size[0], 0.5 * size[1] if len(size) > 1 else LINE * size[0]
    return _outline([[-a, -b], [a, -b], [a, b], [-a, b]])


def _stadium(shape: Mapping[str, Any], _: float) -> Surface:
    radius, half = float(shape["radius"]), 0.5 * float(shape["length"])
    angle = np.linspace(-0.5 * pi, 0.5 * pi, TURN)
    right = np.column_stack([half + radius * np.cos(angle), radius * np.sin(angle)])
    return _outline(np.concatenate([right, -right]))


def _ground(shape: Mapping[str, Any], extent: float) -> Surface:
    """Build the drawn part of length `extent` in the plane: a strip for a half-space, a line for a plane."""
    w = np.zeros(2)
    w[: len(shape["normal"])] = shape["normal"]
    w /= np.linalg.norm(w)
    u = np.array([-w[1], w[0]])
    depth = (0.0 if shape["kind"] == "plane" else BAND) * extent
    a = 0.5 * extent * u
    return _outline([a, -a, -a - depth * w, a - depth * w])


Maker = Callable[[Mapping[str, Any], float], Surface]
SOLIDS: dict[str, Maker] = {
    "box": _box,
    "sphere": _sphere,
    "capsule": _capsule,
    "cylinder": _cylinder,
    "ellipsoid": _ellipsoid,
    "plane": _patch,
    "half-space": _patch,
}
OUTLINES: dict[str, Maker] = {
    "box": _rectangle,
    "sphere": lambda shape, _: _ellipse(float(shape["radius"]), float(shape["radius"])),
    "capsule": _stadium,
    "ellipsoid": lambda shape, _: _ellipse(*map(float, shape["semi_axes"])),
    "plane": _ground,
    "half-space": _ground,
}
