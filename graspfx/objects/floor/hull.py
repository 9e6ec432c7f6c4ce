"""Convex hulls of meshes: the vertices that can touch a plane."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from graspfx import installed
from graspfx.compile.value_cache import through_cache

FloatArray = NDArray[np.float64]

SHEET = 1e-9  # ratio of thickness to width below which a mesh is flat, and Qhull finds no volume


def hull_points(vertices: FloatArray) -> FloatArray:
    """Select the vertices on the convex hull, (h, 3); for a flat sheet, on its hull in the plane.

    Vertex indices are cached on disk, because loading scipy.spatial takes longer than most runs.
    """
    corners = np.ascontiguousarray(vertices, dtype=np.float64)
    points: FloatArray = vertices[_hull_vertices(corners.shape, corners.tobytes())]
    return points


@lru_cache(maxsize=8)
def _hull_vertices(shape: tuple[int, ...], entries: bytes) -> NDArray[np.intp]:
    """Load the indices of the hull's vertices from disk, or compute and store them."""
    settings = "hull", installed.version("scipy"), installed.version("numpy"), shape
    return through_cache(settings, entries, lambda: _hull(np.frombuffer(entries).reshape(shape)))


def _hull(vertices: FloatArray) -> NDArray[np.intp]:
    """Find the indices of the hull's vertices, in ascending order."""
    from scipy.spatial import ConvexHull

    _, widths, axes = np.linalg.svd(vertices - vertices.mean(axis=0), full_matrices=False)
    seen = vertices @ axes[:2].T if widths[2] <= SHEET * widths[0] else vertices
    return np.sort(ConvexHull(seen).vertices).astype(np.intp)
