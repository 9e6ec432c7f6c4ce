"""Meshes as convex pieces: closed parts that are convex, else a thin tetrahedron under each triangle."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError
from graspfx.objects.body import FloatArray

IntArray = NDArray[np.integer]

HOLLOW = 1e-6  # how far a corner may stand before a triangle of a convex mesh, over the mesh's size
ROUNDING = 2e-7  # of corners, over the mesh's size: files have 24 bits, and a narrow triangle is tilted by them
TILT = 1e-3  # of a triangle at most that is put down to rounding
THIN = 0.02  # depth of a shell's pieces at most, over the shell's size
MOST_PIECES = 5000
MOST_PAIRS = 40_000_000  # of a triangle and a corner: a fraction of a second
BLOCK = 1_000_000  # pairs of a triangle and a corner that are looked at together


def parts(vertices: FloatArray, faces: IntArray, *, shell: bool = False) -> Iterator[FloatArray]:
    """List convex pieces (n, 3) of a surface: the corners of each closed part if all are convex, else tetrahedra.

    A shell has no inside, whether it closes or not, so that it is never filled.

    Raises:
        InputError: more than 5000 triangles of a surface that is not convex.
    """
    if not shell:
        owners = _components(faces)
        own = [faces[owners == k] for k in range(int(owners.max()) + 1)]
        if len(own) <= MOST_PIECES and not any(is_hollow(vertices, each) for each in own):
            yield from (vertices[np.unique(each)] for each in own)
            return
    yield from pieces(vertices, faces, shell=shell)


def is_hollow(vertices: FloatArray, faces: IntArray) -> bool:
    """Tell whether a surface is not that of a convex body: it is open, or a corner stands before a triangle's plane.

    All corners count, not those of neighbours alone: a fine mesh of a shallow dish is flat at every edge. Of many
    triangles some are looked at so, evenly spread: what lies between them is found at its edges.
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
    """List a tetrahedron (4, 3) for each triangle: its corners, and a point below its incentre.

    The point is as deep as the inscribed circle is wide, or less where the surface turns back below the triangle: a
    tetrahedron stays within half the angle at each of its triangle's edges, so that none looks out of the body there.
    Nor does its point get further than half the way to the surface below. A shell's are thin, 1/50 of its size at most.

    Raises:
        InputError: more than 5000 triangles.
    """
    if len(faces) > MOST_PIECES:
        kind = "shell" if shell else "concave mesh"
        raise InputError(
            "obstacle", f"a {kind} of {len(faces)} triangles", f"at most {MOST_PIECES} with MuJoCo",
            "simplify the mesh, part it into convex obstacles, or use bullet",
        )  # fmt: skip
    normals, _ = _planes(vertices, faces)
    first, second = _neighbours(faces)
    cosine = np.clip(np.einsum("ij,ij->i", normals[first], normals[second]), -1.0, 1.0)
    centres = vertices[faces].mean(axis=1)
    bulges = np.einsum("ij,ij->i", centres[second] - centres[first], normals[first]) < 0.0
    slopes = np.ones(len(faces))  # tangent of half the angle inside the body, one at most
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
    """Compute how far it is from each triangle's incentre along its normal, inwards, to another triangle (f,) [m].

    A triangle is met as Moeller and Trumbore (1997) say; infinite where none is, or none within `reach` (f,).
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
        scale = np.where(scale == 0.0, np.nan, scale)  # edge on
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
    """Compute triangles' sides, opposite each corner (f, 3) [m], and twice their areas (f,) [m^2]."""
    sides = np.linalg.norm(corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]], axis=2)
    return sides, np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)


def _components(faces: IntArray) -> IntArray:
    """Number the parts of a surface that edges connect (f,): each triangle takes the least number in reach."""
    first, second = _neighbours(faces)
    owners = np.arange(len(faces))
    while True:
        least = owners.copy()
        np.minimum.at(least, first, owners[second])
        least = least[least]  # the number of that number: steps double
        if np.array_equal(least, owners):
            return np.unique(owners, return_inverse=True)[1]
        owners = least


def _planes(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, FloatArray]:
    """Compute the triangles' unit normals and centres, (f, 3) each."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    return normals / np.linalg.norm(normals, axis=1)[:, None], (a + b + c) / 3.0


def _neighbours(faces: IntArray) -> tuple[IntArray, IntArray]:
    """List pairs of triangles with an edge in common, both ways."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    owners = np.repeat(np.arange(len(faces)), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    same = (edges[order[1:]] == edges[order[:-1]]).all(axis=1)
    one, other = owners[order[:-1]][same], owners[order[1:]][same]
    return np.concatenate([one, other]), np.concatenate([other, one])
