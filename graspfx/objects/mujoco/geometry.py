"""Conversion of shapes to MuJoCo's: primitives, convex hulls, and convex pieces of concave obstacles."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.records import numbers
from graspfx.errors import InputError
from graspfx.objects.body import FloatArray
from graspfx.objects.floor.floor import FLAT_KINDS, SHEET, hull_points
from graspfx.spatial import Quaternion, quaternion
from graspfx.surfaces.closed_form import proxy

UPRIGHT = (1.0, 0.0, 0.0, 0.0)
ALONG_X = (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0)  # a capsule's axis in the plane; MuJoCo's is z
FLATTEST = 2e-4  # ratio of thickness to width of a flat mesh; MuJoCo needs a volume, from vertices of 24 bits
THICK = 1.0  # relative to the largest size: thickness of shapes in a plane or on a line


@dataclass(frozen=True)
class Geometry:
    """A convex shape of MuJoCo, in the frame of its body.

    Attributes:
        kind: MuJoCo's name of the kind of shape.
        size: Size in MuJoCo's convention; unused for a mesh.
        points: Vertices of a mesh, (n, 3) [m]; None for other kinds.
        position: Position, (3,) [m].
        quaternion: Orientation, as a quaternion (w, x, y, z).
    """

    kind: str
    size: tuple[float, ...] = ()
    points: FloatArray | None = None
    position: tuple[float, ...] = (0.0, 0.0, 0.0)
    quaternion: tuple[float, ...] = UPRIGHT

    def at(self, position: FloatArray, rotation: FloatArray) -> Geometry:
        """Return a copy of this shape, whose position is the origin, rotated and then moved to `position`."""
        r, i, j, k = self.quaternion
        x, y, z, w = numbers(quaternion(rotation.ravel().tolist()) @ Quaternion(i, j, k, r))
        return replace(self, position=tuple(position.tolist()), quaternion=(w, x, y, z))


def geometries(shape: Any, d: int, *, fixed: bool = False) -> Iterator[Geometry]:
    """Yield MuJoCo's shapes that represent a shape of the scene; none if the shape is None.

    Args:
        shape: Shape of the scene.
        d: Number of dimensions of the scene. Shapes in a plane or on a line are extruded.
        fixed: Whether the shape is an obstacle. A concave mesh stays concave if it is an obstacle; otherwise it is
            replaced by its convex hull.

    Raises:
        InputError: If the shape is a plane or half-space, or MuJoCo has no such shape.
    """
    if shape is None:
        return
    if hasattr(shape, "vertices"):
        if fixed:
            yield from (Geometry("MESH", points=p) for p in parts(shape.vertices, shape.faces, shell=shape.shell))
        else:
            yield Geometry("MESH", points=_with_volume(hull_points(shape.vertices)))
        return
    if shape.kind in FLAT_KINDS:
        raise InputError("shape", shape, "a bounded shape", "make it an obstacle")
    a, b, c = shape.parameters
    if shape.kind == proxy.BOX:
        across = THICK * max(a, b, c)
        yield Geometry("BOX", (a, b if d > 1 else across, c if d > 2 else across))
    elif shape.kind == proxy.SPHERE:
        yield Geometry("SPHERE", (a, 0.0, 0.0))
    elif shape.kind == proxy.CAPSULE:
        yield Geometry("CAPSULE", (a, b, 0.0), quaternion=UPRIGHT if d > 2 else ALONG_X)
    elif shape.kind == proxy.CYLINDER:
        yield Geometry("CYLINDER", (a, b, 0.0))
    elif shape.kind == proxy.ELLIPSOID:
        yield Geometry("ELLIPSOID", (a, b, c if d > 2 else THICK * max(a, b)))
    else:
        raise InputError(
            "shape", shape, "a shape that MuJoCo supports", "add it to `geometries`, or use other dynamics"
        )


def _with_volume(points: FloatArray) -> FloatArray:
    """Return points (n, 3) of a hull with a volume: points in a plane are copied to both sides of the plane."""
    _, widths, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    if widths[2] > SHEET * widths[0]:
        return points
    offset = 0.5 * FLATTEST * float(np.ptp(points, axis=0).max()) * axes[2]
    return np.vstack([points - offset, points + offset])


IntArray = NDArray[np.integer]

HOLLOW = 1e-6  # relative to the mesh's size: height of a vertex in front of a triangle that makes a mesh non-convex
ROUNDING = 2e-7  # relative to the mesh's size: rounding of vertices (24 bits in files), which tilts narrow triangles
TILT = 1e-3  # largest tilt of a triangle that is attributed to rounding
THIN = 0.02  # relative to a shell's size: largest depth of its pieces
MOST_PIECES = 5000
MOST_PAIRS = 40_000_000  # largest number of pairs of a triangle and a vertex: a fraction of a second
BLOCK = 1_000_000  # number of pairs that are processed together


def parts(vertices: FloatArray, faces: IntArray, *, shell: bool = False) -> Iterator[FloatArray]:
    """Yield convex pieces of a surface, each as its vertices (n, 3): closed convex parts, or tetrahedra.

    A surface that is a shell has no inside, even if it is closed, and is divided into thin tetrahedra.

    Raises:
        InputError: If the surface must be divided into tetrahedra, and has more than 5000 triangles.
    """
    if not shell:
        owners = _components(faces)
        own = [faces[owners == k] for k in range(int(owners.max()) + 1)]
        if len(own) <= MOST_PIECES and not any(is_hollow(vertices, each) for each in own):
            yield from (vertices[np.unique(each)] for each in own)
            return
    yield from pieces(vertices, faces, shell=shell)


def is_hollow(vertices: FloatArray, faces: IntArray) -> bool:
    """Return whether a surface is open, or a vertex lies in front of the plane of a triangle.

    If neither is the case, the surface bounds a convex body. All vertices are tested, not only those of neighbouring
    triangles, because a fine mesh of a shallow dish is nearly flat at every edge. If there are many triangles, all
    edges are tested, and all vertices are tested against an evenly spaced subset of the triangles.
    """
    first, second = _neighbours(faces)
    if len(first) != 3 * len(faces):
        return True
    corners = vertices[np.unique(faces)]
    size = float(np.ptp(corners, axis=0).max())
    normals, centres = _planes(vertices, faces)
    if (np.einsum("ij,ij->i", centres[second] - centres[first], normals[first]) > HOLLOW * size).any():
        return True
    some = slice(None, None, 1 + len(faces) * len(corners) // MOST_PAIRS)
    sides, areas = _sizes(vertices[faces[some]])
    tilts = np.minimum(TILT, ROUNDING * size * sides.max(axis=1) / areas)
    behind = np.einsum("ij,ij->i", centres[some], normals[some]) + size * (HOLLOW + tilts)
    directions = normals[some]
    stride = max(1, BLOCK // len(corners))
    return any(
        bool(((directions[k : k + stride] @ corners.T).max(axis=1) > behind[k : k + stride]).any())
        for k in range(0, len(directions), stride)
    )


def pieces(vertices: FloatArray, faces: IntArray, *, shell: bool = False) -> Iterator[FloatArray]:
    """Yield a tetrahedron (4, 3) for each triangle: the triangle's vertices, and a point below its incentre.

    The depth of the point is at most the inradius of the triangle and at most half the distance to the surface below.
    At each edge the tetrahedron stays within half the angle between the triangle and its neighbour, so that it does not
    protrude from the body. The depth in a shell is at most 1/50 of the shell's size.

    Raises:
        InputError: If there are more than 5000 triangles.
    """
    if len(faces) > MOST_PIECES:
        kind = "shell" if shell else "concave mesh"
        raise InputError(
            "obstacle", f"a {kind} with {len(faces)} triangles", f"at most {MOST_PIECES} with MuJoCo",
            "simplify the mesh, split it into convex obstacles, or use bullet",
        )  # fmt: skip
    normals, _ = _planes(vertices, faces)
    first, second = _neighbours(faces)
    cosine = np.clip(np.einsum("ij,ij->i", normals[first], normals[second]), -1.0, 1.0)
    centres = vertices[faces].mean(axis=1)
    bulges = np.einsum("ij,ij->i", centres[second] - centres[first], normals[first]) < 0.0
    slopes = np.ones(len(faces))  # tangent of half the angle inside the body, at most one
    half = np.where(bulges, np.sqrt((1.0 + cosine) / np.maximum(1.0 - cosine, 1e-300)), 1.0)
    np.minimum.at(slopes, first, half)
    corners = vertices[faces]
    sides, areas = _sizes(corners)
    around = sides.sum(axis=1)
    incentres = np.einsum("ij,ijk->ik", sides, corners) / around[:, None]
    depths = slopes * areas / around
    if shell:
        depths = np.minimum(depths, THIN * float(np.ptp(vertices, axis=0).max()))
    depths = np.minimum(depths, 0.5 * _ways(corners, incentres, normals, 2.0 * depths))
    points = incentres - depths[:, None] * normals
    for triangle, point in zip(corners, points, strict=True):
        yield np.vstack([triangle, point])


def _ways(corners: FloatArray, starts: FloatArray, normals: FloatArray, reach: FloatArray) -> FloatArray:
    """Compute the distance from each incentre, along the inward normal, to the nearest other triangle, (f,) [m].

    The distance is infinite if there is no other triangle within `reach` (f,). Intersections are computed by the method
    of Moeller and Trumbore (1997).
    """
    least = 1e-9 * float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    middles = corners.mean(axis=1)
    around = np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1)
    ways = np.full(len(corners), np.inf)
    for k, (start, normal) in enumerate(zip(starts, -normals, strict=True)):
        apart = middles - start
        near = corners[np.einsum("ij,ij->i", apart, apart) <= (around + reach[k]) ** 2]
        a, one, two = near[:, 0], near[:, 1] - near[:, 0], near[:, 2] - near[:, 0]
        across = np.cross(normal, two)
        scale = np.einsum("ij,ij->i", one, across)
        scale = np.where(scale == 0.0, np.nan, scale)  # parallel to the ray
        from_a = start - a
        u = np.einsum("ij,ij->i", from_a, across) / scale
        turned = np.cross(from_a, one)
        v = turned @ normal / scale
        far = np.einsum("ij,ij->i", two, turned) / scale
        met = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (far > least)
        if met.any():
            ways[k] = far[met].min()
    return ways


def _sizes(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the lengths of the sides opposite each vertex (f, 3) [m], and twice the areas (f,) [m^2], of triangles."""
    sides = np.linalg.norm(corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]], axis=2)
    return sides, np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)


def _components(faces: IntArray) -> IntArray:
    """Return for each triangle the number of the connected part of the surface to which it belongs, (f,), from 0."""
    first, second = _neighbours(faces)
    owners = np.arange(len(faces))
    while True:
        least = owners.copy()
        np.minimum.at(least, first, owners[second])
        least = least[least]  # pointer jumping: the distance doubles in each step
        if np.array_equal(least, owners):
            return np.unique(owners, return_inverse=True)[1]
        owners = least


def _planes(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the unit normals (f, 3) and the centres (f, 3) [m] of triangles."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    return normals / np.linalg.norm(normals, axis=1)[:, None], (a + b + c) / 3.0


def _neighbours(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Return the indices of the first and of the second triangle of each pair with a common edge, in both orders."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    owners = np.repeat(np.arange(len(faces)), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    same = (edges[order[1:]] == edges[order[:-1]]).all(axis=1)
    one, other = owners[order[:-1]][same], owners[order[1:]][same]
    return np.concatenate([one, other]), np.concatenate([other, one])
