"""How far one gain of a whole loop can go with the others as they are: no modes needed, any fingers, any preload."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.linearisation import Linearisation
from graspfx.analysis.stability.fullloop import drift_free, loop_matrix, uncoupled

FloatArray = NDArray[np.float64]
Stiffness = Callable[[float], FloatArray]

LEAST, MOST = 0.01, 100.0  # of a gain: where it is looked for
GRID = 64  # factors between them, 16 % apart: a gap in what is stable narrower than that can be missed
BATCH = 16  # of them looked at together, upwards until one is not stable
ON = 1e-11  # what |z| may exceed 1 by rounding


@dataclass(frozen=True)
class Reach:
    """The largest factor of a gain and the frequency of the oscillation that begins there [Hz]; inf, nan for none."""

    factor: float
    frequency: float


class Family:
    """A(s) of the loop with K(s), s the factor of a gain: A(0) + W K(s) C but for the implicit integrator."""

    def __init__(self, linear: Linearisation, stiffness: Stiffness) -> None:
        self._linear, self._stiffness = linear, stiffness
        m, r = linear.coordinates
        self._motions = uncoupled(linear)
        self._still = loop_matrix(linear.with_changes(stiffness=0.0), self._motions)
        self._basis = drift_free(linear, len(self._still))
        self._W: FloatArray | None = None
        if linear.integrator != "implicit":
            unit = loop_matrix(linear.with_changes(stiffness=1.0), self._motions)
            self._W = (unit - self._still)[:, :m]
            self._C = np.zeros((m, len(unit)))
            self._C[:, :m], self._C[:, 2 * m : 2 * m + r] = np.eye(m), -linear.G_displacement.T

    def roots(self, factors: FloatArray) -> NDArray[np.complex128]:
        """Find the eigenvalues for each factor, (f, states), without motions that change no force."""
        loops = np.stack([self._matrix(self._stiffness(s)) for s in factors.tolist()])
        if self._basis is not None:
            loops = self._basis.T @ loops @ self._basis
        return np.asarray(np.linalg.eigvals(loops), dtype=complex)

    def radius(self, factor: float) -> float:
        """Find the largest |z| for a factor."""
        return float(np.abs(self.roots(np.array([factor]))).max(initial=0.0))

    def _matrix(self, K: FloatArray) -> FloatArray:
        if self._W is None:
            return loop_matrix(self._linear.with_changes(stiffness=K), self._motions)
        return self._still + self._W @ (K @ self._C)


def reach(linear: Linearisation, stiffness: Stiffness) -> Reach:
    """Find the first loss of stability above the present gain, or, where that is unstable, above the first stable one.

    Args:
        linear: with s = 1.
        stiffness: K(s).
    """
    family = Family(linear, stiffness)
    above = np.geomspace(1.0, MOST, GRID // 2)
    factors = above if family.radius(1.0) <= 1.0 + ON else np.geomspace(LEAST, 1.0, GRID // 2)
    before: float | None = None  # the last factor that is stable
    lost: float | None = None
    for start in range(0, len(factors), BATCH):
        some = factors[start : start + BATCH]
        for s, size in zip(some.tolist(), np.abs(family.roots(some)).max(axis=1, initial=0.0).tolist(), strict=True):
            if size <= 1.0 + ON:
                before = s
            elif before is not None:
                lost = s
                break
        if lost is not None:
            break
    if before is None:
        return Reach(0.0, math.nan)
    if lost is None:
        return Reach(math.inf, math.nan)
    low, high = before, lost
    from scipy.optimize import brentq

    if family.radius(low) >= 1.0:  # on the circle to rounding
        edge = float(low)
    else:
        edge = float(brentq(lambda s: family.radius(s) - 1.0, low, high, xtol=1e-14, rtol=1e-12))
    z = family.roots(np.array([edge * (1.0 + 1e-9)]))[0]
    worst = z[np.argmax(np.abs(z))]
    return Reach(edge, abs(float(np.angle(worst))) / (2 * math.pi * linear.period))


def bounded(value: Any) -> Any:
    """Give a value as JSON has it: None for what is no limit or no number, in nested lists too."""
    if isinstance(value, list):
        return [bounded(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
