"""The largest stable gain of a sampled spring by others: eigenvalues with a root finder, python-control's margins."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Plant = tuple[float, float, float]  # m, b and k of m x'' + b x' + k x = u

FIRST = 1.0  # [N/m]: a gain at which the loops of the benchmark are stable


def by_eigenvalues(plants: Sequence[Plant], period: float) -> float:
    """Find the k at which the largest eigenvalue of A - k B C is on the unit circle, by doubling and Brent's method."""
    from scipy.optimize import brentq

    A, feedback = sampled_loop(plants, period)

    def excess(k: float) -> float:
        return float(np.abs(np.linalg.eigvals(A - k * feedback)).max()) - 1.0

    stable, other = FIRST, 2.0 * FIRST
    while excess(other) < 0.0:
        stable, other = other, 2.0 * other
    return float(brentq(excess, stable, other, xtol=1e-12, rtol=1e-14))


def sampled_loop(plants: Sequence[Plant], period: float) -> tuple[FloatArray, FloatArray]:
    """Give A and B C of one or two plants under zero-order hold: the force moves the first forward, the second back."""
    from scipy.linalg import expm

    size = 2 * len(plants)
    A, B, C = np.zeros((size, size)), np.zeros(size), np.zeros(size)
    for i, (m, b, k) in enumerate(plants):
        whole = expm(np.array([[0.0, 1.0, 0.0], [-k / m, -b / m, 1.0 / m], [0.0, 0.0, 0.0]]) * period)
        own, sign = slice(2 * i, 2 * i + 2), -1.0 if i else 1.0
        A[own, own], B[own], C[2 * i] = whole[:2, :2], sign * whole[:2, 2], sign
    return A, np.outer(B, C)


def by_control(plants: Sequence[Plant], period: float, method: str) -> float:
    """Ask python-control for the gain margin of the sampled plants.

    Its method "poly" finds crossings as roots of polynomials, quickly, and takes one that only touches the axis for
    one too; "best", its default, sees that coming and interpolates along the frequencies instead.
    """
    import control

    sampled = [control.sample_system(control.tf([1.0], [m, b, k]), period, "zoh") for m, b, k in plants]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that it interpolates, for each
        return float(control.stability_margins(sum(sampled[1:], sampled[0]), method=method)[0])


PEERS: Sequence[tuple[str, Callable[[Sequence[Plant], float], float], str]] = (
    ("numpy eigenvalues, Brent", by_eigenvalues, "scipy"),
    ("python-control, margins", partial(by_control, method="best"), "control"),
    ("python-control, margins by polynomials", partial(by_control, method="poly"), "control"),
)
