"""Exact sums and products of two floats, and arithmetic of float pairs for contact points."""

from __future__ import annotations

import math

HALVES = 134217729.0  # 2^27 + 1 splits a 53-bit significand into two halves


def exact_sum(a: float, b: float) -> tuple[float, float]:
    """Compute a + b = (s, r) exactly: the rounded sum and its rounding error (Knuth 1969)."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


def exact_product(a: float, b: float) -> tuple[float, float]:
    """Compute a b = (p, r) exactly, unless it over- or underflows (Dekker 1971)."""
    p = a * b
    t = HALVES * a
    ah = t - (t - a)
    al = a - ah
    t = HALVES * b
    bh = t - (t - b)
    bl = b - bh
    return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl


def radial_excess(x: float, y: float, radius: float) -> float:
    """Compute |(x, y)| - radius to full relative accuracy: exact x^2 + y^2 - radius^2, over |(x, y)| + radius."""
    p, pr = exact_product(x, x)
    q, qr = exact_product(y, y)
    r, rr = exact_product(radius, radius)
    if p < q:
        p, pr, q, qr = q, qr, p, pr
    s, sr = exact_sum(p, -r)
    s, tr = exact_sum(s, q)
    return (s + (((pr - rr) + qr) + (sr + tr))) / (math.sqrt(p + q) + radius)
