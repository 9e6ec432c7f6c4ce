"""Oracle of a surface of triangles: every triangle looked at, in long double."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def brute_force(vertices: FloatArray, faces: NDArray[np.intp], p: FloatArray) -> tuple[Any, Any]:
    """Find the nearest point and distance over all triangles in long double, (3,) and a number."""
    a, b, c = np.moveaxis(vertices[faces].astype(np.longdouble), 1, 0)
    g = p.astype(np.longdouble)
    best = [_on_segments(a, b, g), _on_segments(b, c, g), _on_segments(c, a, g)]
    foot, within = _feet(a, b, c, g, 0.0)
    points = np.concatenate([*best, foot[within]])
    square = ((points - g) ** 2).sum(axis=1)
    k = int(square.argmin())
    return points[k], np.sqrt(square[k])


def perpendicular_feet(vertices: FloatArray, faces: NDArray[np.intp], p: FloatArray, tolerance: float) -> Any:
    """Find the feet (k, 3) of perpendiculars from p on all triangles that meet theirs, up to `tolerance` [m] outside.

    Where the surface is convex, they are all the points that a finger inside may be held by.
    """
    a, b, c = np.moveaxis(vertices[faces].astype(np.longdouble), 1, 0)
    foot, within = _feet(a, b, c, p.astype(np.longdouble), tolerance)
    return foot[within]


def winding_number(vertices: FloatArray, faces: NDArray[np.intp], p: FloatArray) -> float:
    """Sum of the triangles' solid angles over 4 pi (van Oosterom and Strackee, 1983): 1 inside, 0 outside."""
    a, b, c = np.moveaxis((vertices[faces] - p).astype(np.longdouble), 1, 0)
    la, lb, lc = (np.sqrt((v * v).sum(axis=1)) for v in (a, b, c))
    top = (a * np.cross(b, c)).sum(axis=1)
    bottom = la * lb * lc + (a * b).sum(axis=1) * lc + (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
    return float(np.arctan2(top, bottom).sum() / (2 * np.pi))


def _on_segments(a: Any, b: Any, g: Any) -> Any:
    u = b - a
    t = np.clip(((g - a) * u).sum(axis=1) / (u * u).sum(axis=1), 0, 1)
    return a + t[:, None] * u


def _feet(a: Any, b: Any, c: Any, g: Any, tolerance: float) -> tuple[Any, Any]:
    """Find the foot of the perpendicular on each triangle's plane, and whether it is in the triangle."""
    n = np.cross(b - a, c - a)
    n /= np.sqrt((n * n).sum(axis=1, keepdims=True))
    foot = g - ((g - a) * n).sum(axis=1, keepdims=True) * n
    sides = ((a, b), (b, c), (c, a))
    inwards = [(np.cross(v - u, foot - u) * n).sum(axis=1) / np.sqrt(((v - u) ** 2).sum(axis=1)) for u, v in sides]
    return foot, np.all([distance >= -tolerance for distance in inwards], axis=0)
