"""Limits of stability to 30 digits: the gain at which the largest eigenvalue of the sampled loop is on the circle."""

from __future__ import annotations

from typing import Any

from graspfx.bench.oracles.exact import digits

DIGITS = 30
NEAR = 1e-6  # of the gain: where the secant starts beside it
STEPS = 30


def crossing(plants: list[tuple[float, float, float]], period: float, near: float) -> float:
    """Find the k near a given one at which f = k (x_1 - x_2), or k x_1 for one plant, has an eigenvalue of length one.

    Args:
        plants: m, b and k_s of m x'' + b x' + k_s x = u under zero-order hold: the device, and what it moves.
        period: T [s].
        near: where to look; the nearest loss of stability on either side is found.
    """
    mp = digits()
    with mp.workdps(DIGITS):
        sampled = [_sampled(mp, mp.mpf(m), mp.mpf(b), mp.mpf(k_s), mp.mpf(period)) for m, b, k_s in plants]
        a, b = mp.mpf(near), mp.mpf(near) * (1 + mp.mpf(NEAR))
        at_a, at_b = (_excess(mp, sampled, k) for k in (a, b))
        for _ in range(STEPS):
            if at_a == at_b:
                break
            a, b, at_a = b, b - at_b * (b - a) / (at_b - at_a), at_b
            if abs(b - a) <= mp.mpf(10) ** (5 - DIGITS) * abs(b):
                break
            at_b = _excess(mp, sampled, b)
        return float(b)


def _sampled(mp: Any, m: Any, b: Any, k_s: Any, T: Any) -> tuple[Any, Any]:
    """Give A (2, 2) and B (2, 1) of one sample."""
    whole = mp.expm(mp.matrix([[0, 1, 0], [-k_s / m, -b / m, 1 / m], [0, 0, 0]]) * T)
    return whole[:2, :2], whole[:2, 2]


def _excess(mp: Any, plants: list[tuple[Any, Any]], k: Any) -> Any:
    size = 2 * len(plants)
    A = mp.zeros(size)
    for i, (F, B) in enumerate(plants):
        for r in range(2):
            for c in range(2):
                A[2 * i + r, 2 * i + c] += F[r, c]
            for j in range(len(plants)):
                A[2 * i + r, 2 * j] += B[r] * (k if i != j else -k)
    return max(abs(z) for z in mp.eig(A, left=False, right=False)) - 1
