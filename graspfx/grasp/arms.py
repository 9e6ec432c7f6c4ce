"""Moment arms of contacts about their centroid, accurate even for contacts far away or nearly on a line.

If contacts of rms radius R are at a distance of about h R from a line, a unit rotation about the line moves them by
h R, and other rotations move them by R. In ordinary arithmetic the arm about the line, a difference of products, has a
relative error of eps / h. Here the arm is computed in pairs of floats, value and rounding error (Dekker 1971, Knuth
1969), and rounded once.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Pair = tuple[FloatArray, FloatArray]

SPLITTER = 134217729.0  # 2^27 + 1 splits a double into two halves whose products are exact
NEXT, LAST = [1, 2, 0], [2, 0, 1]  # the other two coordinates of a cross product


def centred_arms(points: FloatArray, *, principal: bool) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute u_k x (c_i - c) for each axis of rotation u_k, where c is the centroid.

    Args:
        points: Contact points, (..., n, d) [m], d = 2 or 3.
        principal: Whether, in space, the axes u_k are the principal axes of the contacts instead of the world's axes.

    Returns:
        Axes: (1, 1) in the plane, (..., 3, 3) in space with one axis per row, or (3, 3) for the world's axes. Fields:
        (..., axes, n, d) [m]. Offset c - c_0 of the centroid from the first contact: (..., d) [m].
    """
    *sets, n, d = points.shape
    offset = two_sum(points, -points[..., :1, :])  # exact
    terms = np.swapaxes(np.concatenate(offset, axis=-2), -1, -2).reshape(-1, 2 * n).tolist()
    high = [math.fsum(row) for row in terms]
    low = [math.fsum([*row, -h]) for row, h in zip(terms, high, strict=True)]
    total, rest = (np.array(part).reshape(*sets, 1, d) for part in (high, low))
    arm = add(multiply(np.asarray(float(n)), offset), (-total, -rest))  # n (c_i - c)
    centroid = total[..., 0, :] / n
    if d == 2:
        field = np.stack([-arm[0][..., 1], arm[0][..., 0]], axis=-1) / n
        return np.ones((1, 1)), field[..., None, :, :], centroid
    axes = np.linalg.svd(arm[0], full_matrices=n < d)[2] if principal else np.eye(3)
    u = axes[..., :, None, :]
    high_arm, low_arm = arm[0][..., None, :, :], arm[1][..., None, :, :]
    plus = multiply(u[..., NEXT], (high_arm[..., LAST], low_arm[..., LAST]))
    minus = multiply(u[..., LAST], (high_arm[..., NEXT], low_arm[..., NEXT]))
    product = add(plus, (-minus[0], -minus[1]))
    return axes, (product[0] + product[1]) / n, centroid


def two_sum(a: FloatArray, b: FloatArray) -> Pair:
    """Compute a + b as a rounded sum and its exact remainder (Knuth)."""
    s = a + b
    v = s - a
    return s, (a - (s - v)) + (b - v)


def two_product(a: FloatArray, b: FloatArray) -> Pair:
    """Compute a b as a rounded product and its exact remainder (Dekker)."""
    p = a * b
    ca, cb = SPLITTER * a, SPLITTER * b
    ah, bh = ca - (ca - a), cb - (cb - b)
    al, bl = a - ah, b - bh
    return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl


def add(x: Pair, y: Pair) -> Pair:
    """Add two pairs, with an error of about 1e-32 times the larger pair."""
    s, e = two_sum(x[0], y[0])
    t, f = two_sum(x[1], y[1])
    s, e = two_sum(s, e + t)
    return two_sum(s, e + f)


def multiply(a: FloatArray, x: Pair) -> Pair:
    """Multiply a pair by an ordinary array, with NumPy's broadcasting."""
    p, e = two_product(a, x[0])
    return two_sum(p, e + a * x[1])
