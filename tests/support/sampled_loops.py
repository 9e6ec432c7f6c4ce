"""Sampled loops of one device written out as matrices, and eigenvalues of them: what the limits are held against."""

from __future__ import annotations

from functools import cache

import mpmath
import numpy as np
from scipy.linalg import expm


def held(A: np.ndarray, b: np.ndarray, T: float) -> tuple[np.ndarray, np.ndarray]:
    """x' = A x + b u with u held over T: x+ = Ad x + bd u."""
    n = len(A)
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n] = A, b
    E = expm(block * T)
    return E[:n, :n], E[:n, n]


@cache
def held_device(m: float, b: float, k: float, T: float) -> tuple[np.ndarray, np.ndarray]:
    return held(np.array([[0.0, 1.0], [-k / m, -b / m]]), np.array([0.0, 1.0 / m]), T)


@cache
def stepped_object(M: float, B: float, T: float, integrator: str) -> tuple[np.ndarray, np.ndarray]:
    """The integrators as THEORY names them, by their two assignments."""
    x, v, f = np.eye(3)
    if integrator == "exact":
        return held(np.array([[0.0, 1.0], [0.0, -B / M]]), np.array([0.0, 1.0 / M]), T)
    if integrator == "bullet":
        A, b = held(np.array([[-B / M]]), np.array([1.0 / M]), T)
        new = A[0, 0] * v + b[0] * f
        moved = x + T * new
    elif integrator == "explicit":
        new, moved = v + T / M * (f - B * v), x + T * v
    else:
        new = v + T / M * (f - B * v)
        moved = x + T * new
    rows = np.array([moved, new])
    return rows[:, :2], rows[:, 2]


def radius(A: np.ndarray) -> float:
    return float(np.abs(np.linalg.eigvals(A)).max())


def wall_loop(
    m: float, b: float, T: float, K: float, *, spring: float = 0.0, B: float = 0.0, delay: int = 0
) -> np.ndarray:
    """States x, x', x_(k-1), the forces on their way."""
    A, h = held_device(m, b, spring, T)
    unit = np.eye(3 + delay)
    f = K * unit[0] + B * (unit[0] - unit[2]) / T
    queue = [f, *unit[3:]]
    state = A @ unit[:2] - np.outer(h, queue[delay])
    return np.array([*state, unit[0], *queue[:delay]])


def external_loop(
    m: float, b: float, T: float, M: float, B: float, k: float, *, spring: float = 0.0, integrator: str = "exact",
    delay: int = 0, object_delay: int = 0, damping: float = 0.0,
) -> np.ndarray:  # fmt: skip
    """States x, x', x_o, v_o, x_(k-1), the forces on their way to either."""
    A, h = held_device(m, b, spring, T)
    late = max(delay, object_delay)
    unit = np.eye(5 + late)
    x, _, q, w, old = unit[:5]
    if integrator == "implicit":  # v+ = (v + T/M f)/(1 + T B/M), f = k (x - q - T v+) + d (x' - v+), solved for v+
        d = damping
        top = w + T / M * (k * (x - q) + d * (x - old) / T)
        new = top / (1.0 + T * B / M + T / M * (k * T + d))
        moved = q + T * new
        f = k * (x - moved) + d * ((x - old) / T - new)
        queue = [f, *unit[5:]]
        body = [moved, new]
    else:
        f = k * (x - q) + damping * ((x - old) / T - w)
        queue = [f, *unit[5:]]
        Ao, ho = stepped_object(M, B, T, integrator)
        body = list(Ao @ unit[2:4] + np.outer(ho, queue[object_delay]))
    state = A @ unit[:2] - np.outer(h, queue[delay])
    return np.array([*state, *body, x, *queue[:late]])


def exact_limit(mass: float, friction: float, period: float, latency: float, damping: float) -> float:
    """K of the first crossing of a free device on a wall, 40 digits: the largest root by bisection, split by hand."""
    with mpmath.workdps(40):
        m, b, T, late, D = (mpmath.mpf(float(each)) for each in (mass, friction, period, latency, damping))
        n = int(mpmath.floor(late / T))
        rest = (n + 1) * T - late  # the new force acts so long
        p = b / m

        def shift(t: mpmath.mpf) -> mpmath.mpf:
            return (t - (1 - mpmath.exp(-p * t)) / p) / b

        def speed(t: mpmath.mpf) -> mpmath.mpf:
            return (1 - mpmath.exp(-p * t)) / b

        new, old = (shift(rest), speed(rest)), (shift(T) - shift(rest), speed(T) - speed(rest))
        E, R = mpmath.exp(-p * T), (1 - mpmath.exp(-p * T)) / p
        numerator = [new[0], R * new[1] - E * new[0] + old[0], R * old[1] - E * old[0]]  # of z^1, z^0, z^-1

        def unstable(K: mpmath.mpf) -> bool:
            poly = [mpmath.mpf(1), -(1 + E), E] + [mpmath.mpf(0)] * (n + 2)  # z^(n+2) times the denominator
            for i, c in enumerate(numerator):
                poly[i + n + 1] += (K + D / T) * c
                poly[i + n + 2] -= D / T * c
            while not poly[-1]:  # roots at zero that coincide are found slowly
                poly.pop()
            return max(abs(z) for z in mpmath.polyroots(poly[::-1], maxsteps=300, extraprec=300, asc=True)) > 1

        low = high = b / (20 * (T + late))
        while not unstable(high):
            low, high = high, 2 * high
        for _ in range(45):
            middle = (low + high) / 2
            low, high = (low, middle) if unstable(middle) else (middle, high)
        return float(low)
