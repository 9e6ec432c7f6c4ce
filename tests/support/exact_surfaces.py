"""The nearest point c of each surface at 50 digits, and the direction p - c or its opposite, unnormalised."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mpmath import mp, mpf

Exact = list[Any]
Oracle = Callable[[Exact, Exact], tuple[Exact, Exact]]


def norm(v: Exact) -> Any:
    return mp.sqrt(sum(t * t for t in v))


def exact_flat(size: Exact, p: Exact) -> tuple[Exact, Exact]:
    n = [v / norm(size) for v in size]
    height = sum(u * v for u, v in zip(n, p, strict=True))
    return [v - height * u for u, v in zip(n, p, strict=True)], n


def exact_sphere(size: Exact, p: Exact) -> tuple[Exact, Exact]:
    return [size[0] * v / norm(p) for v in p], p


def exact_capsule(size: Exact, p: Exact) -> tuple[Exact, Exact]:
    t = min(max(p[2], -size[1]), size[1])
    u = [p[0], p[1], p[2] - t]
    c = [size[0] * v / norm(u) for v in u]
    return [c[0], c[1], t + c[2]], u


def exact_stadium(size: Exact, p: Exact) -> tuple[Exact, Exact]:
    c, u = exact_capsule(size, [p[1], mpf(0), p[0]])
    return [c[2], c[0], mpf(0)], [u[2], u[0], mpf(0)]


def exact_cylinder(size: Exact, p: Exact) -> tuple[Exact, Exact]:
    """All five candidates: clamped to the solid, the mantle, the caps; the nearest of those on the surface."""
    radius, half = size[:2]
    rho = norm(p[:2])
    outside = rho > radius or abs(p[2]) > half
    sign = 1 if p[2] >= 0 else -1
    if outside:
        k = min(rho, radius) / rho
        c = [k * p[0], k * p[1], min(max(p[2], -half), half)]
        return c, [u - v for u, v in zip(p, c, strict=True)]
    if radius - rho < half - abs(p[2]):
        return [radius * p[0] / rho, radius * p[1] / rho, p[2]], [p[0], p[1], mpf(0)]
    return [p[0], p[1], sign * half], [mpf(0), mpf(0), mpf(sign)]


def exact_ellipsoid(size: Exact, p: Exact) -> tuple[Exact, Exact]:
    """The largest root of |y(s)| = 1 by bisection in log s: nothing of the kernel's iteration."""
    axes = [e for e in size if e > 0]
    q = p[: len(axes)]
    least = min(axes)
    apart = [(e - least) * (e + least) for e in axes]
    low, high = mpf(10) ** -220, norm([e * v for e, v in zip(axes, q, strict=True)])
    while high - low > mpf(10) ** -44 * high:
        s = mp.sqrt(low * high) if high > 2 * low else (low + high) / 2
        if sum((e * v / (s + t)) ** 2 for e, v, t in zip(axes, q, apart, strict=True)) > 1:
            low = s
        else:
            high = s
    c = [e * e * v / (low + t) for e, v, t in zip(axes, q, apart, strict=True)]
    n = [v / (e * e) for v, e in zip(c, axes, strict=True)]
    return [*c, mpf(0)][:3], [*n, mpf(0)][:3]
