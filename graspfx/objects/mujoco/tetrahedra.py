"""Concave meshes as convex pieces: a thin tetrahedron under each triangle."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError
from graspfx.objects.body import FloatArray

IntArray = NDArray[np.integer]

HOLLOW = 1e-6  # how far a corner may lie in front of a triangle of a convex mesh, over the mesh's size
MOST_PIECES = 5000


def is_hollow(vertices: FloatArray, faces: IntArray) -> bool:
    """Tell whether a closed surface is not convex: the end of an edge's neighbour stands out before a triangle."""
    normals, centres = _planes(vertices, faces)
    size = float(np.ptp(vertices, axis=0).max())
    first, second = _neighbours(faces)
    far = np.einsum("ij,ij->i", centres[second] - centres[first], normals[first])
    return bool((far > HOLLOW * size).any())


def pieces(vertices: FloatArray, faces: IntArray) -> Iterator[FloatArray]:
    """List a tetrahedron (4, 3) for each triangle: its corners, and a point below its incentre.

    The point is as deep as the inscribed circle is wide, or less where the surface turns back below the triangle: a
    tetrahedron stays within half the angle at each of its triangle's edges, so that none looks out of the body there.

    Raises:
        InputError: more than 5000 triangles.
    """
    if len(faces) > MOST_PIECES:
        raise InputError(
            "obstacle", f"a concave mesh of {len(faces)} triangles", f"at most {MOST_PIECES} with MuJoCo",
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
    sides = np.linalg.norm(corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]], axis=2)  # opposite each corner
    around = sides.sum(axis=1)
    incentres = np.einsum("ij,ijk->ik", sides, corners) / around[:, None]
    radii = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / around
    points = incentres - (slopes * radii)[:, None] * normals
    for triangle, point in zip(corners, points, strict=True):
        yield np.vstack([triangle, point])


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
