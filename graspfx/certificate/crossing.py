"""Where an eigenvalue crosses the unit circle: Newton's method on it alone, or a bracket on the spectral radius."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from graspfx.certificate.whole_loop import Family, Line

FloatArray = NDArray[np.float64]

STEPS = 12  # of Newton's method
SAME = 1e-13  # relative: steps that are rounding
NEAREST = 1e-12  # relative: the width of a bracket that is narrow enough
MOST_HALVINGS = 200


def crossings(starts: Sequence[tuple[Family, float, complex]]) -> list[float | None]:
    """Follow one eigenvalue z of A(s) = A_0 + s A_1 of each family to |z| = 1, from a factor s and z there.

    With right and left eigenvectors x and y, by inverse iteration, z = y'A x / y'x and dz/ds = y'A_1 x / y'x; Newton's
    steps on log |z|. Families whose A is no line in s, and eigenvalues that are lost on the way, give None.
    """
    answers: list[float | None] = [None] * len(starts)
    groups: defaultdict[int, list[tuple[int, Line, float, complex]]] = defaultdict(list)
    for k, (family, s, z) in enumerate(starts):
        line = _line_of(family, s, z)
        if line is not None:
            groups[len(line.still)].append((k, line, s, z))
    for group in groups.values():
        for (k, *_), answer in zip(group, _newton(group), strict=True):
            answers[k] = answer
    return answers


def _line_of(family: Family, s: float, z: complex) -> Line | None:
    """Give A_0 and A_1 of the part that z is an eigenvalue of."""
    lines = family.lines
    if lines is None:
        return None
    if len(lines) == 1:
        return lines[0]
    distances = [np.abs(np.linalg.eigvals(line(s)) - z).min(initial=np.inf) for line in lines]
    return lines[int(np.argmin(distances))]


def _newton(group: Sequence[tuple[int, Line, float, complex]]) -> list[float | None]:
    """Take Newton's steps for matrices of one size together."""
    A_0 = np.stack([line.still for _, line, _, _ in group]).astype(complex)
    A_1 = np.stack([line.slope for _, line, _, _ in group]).astype(complex)
    s, z = np.array([each[2] for each in group]), np.array([each[3] for each in group])
    f, n, _ = A_0.shape
    x = y = np.ones((f, n, 1), dtype=complex) + 0.1 * np.cos(np.arange(n))[None, :, None]
    done = np.zeros(f, dtype=bool)
    for step in range(STEPS):
        A = A_0 + s[:, None, None] * A_1
        M = A - (z * (1.0 + 1e-15j))[:, None, None] * np.eye(n)
        try:
            for _ in range(2 if step == 0 else 1):
                x, y = np.linalg.solve(M, x), np.linalg.solve(M.conj().swapaxes(1, 2), y)
                x, y = x / np.linalg.norm(x, axis=1, keepdims=True), y / np.linalg.norm(y, axis=1, keepdims=True)
        except np.linalg.LinAlgError:
            return [None] * f
        left = y.conj().swapaxes(1, 2)
        with np.errstate(all="ignore"):
            scale = (left @ x)[:, 0, 0]
            z, slope = (left @ A @ x)[:, 0, 0] / scale, (left @ A_1 @ x)[:, 0, 0] / scale
            change = -np.log(np.abs(z)) * np.abs(z) ** 2 / (z.conj() * slope).real
        if not np.isfinite(change).all():
            return [None] * f
        done = np.abs(change) <= SAME * s
        s, z = s + change, z + slope * change
        if done.all():
            break
    return [float(each) if ok else None for each, ok in zip(s, done, strict=True)]


def bracketed(function: Callable[[float], float], low: float, high: float) -> float:
    """Find a zero between two factors at which a function has unlike signs, by the method of Chandrupatla (1997).

    Inverse quadratic interpolation where three points allow it, else the middle; the bracket shrinks in every step.
    """
    a, b = high, low
    f_a, f_b = function(a), function(b)
    c, f_c = a, f_a
    t = 0.5
    for _ in range(MOST_HALVINGS):
        x = a + t * (b - a)
        f_x = function(x)
        if (f_x > 0.0) == (f_a > 0.0):
            c, f_c = a, f_a
        else:
            c, b, f_c, f_b = b, a, f_b, f_a
        a, f_a = x, f_x
        best, f_best = (a, f_a) if abs(f_a) < abs(f_b) else (b, f_b)
        least = 0.5 * NEAREST * abs(best) / abs(b - a) if b != a else 1.0
        if least > 0.5 or f_best == 0.0:
            return best
        xi, phi = (a - b) / (c - b), (f_a - f_b) / (f_c - f_b) if f_c != f_b else 1.0
        if phi**2 < xi and (1.0 - phi) ** 2 < 1.0 - xi:
            t = f_a / (f_b - f_a) * f_c / (f_b - f_c) + (c - a) / (b - a) * f_a / (f_c - f_a) * f_b / (f_c - f_b)
        else:
            t = 0.5
        t = min(max(t, least), 1.0 - least)
    return best
