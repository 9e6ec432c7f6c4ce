"""Device damping that a display requires at each frequency, and the worst frequency by an adaptive grid."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.passivity.display import Display, StateSpace

FloatArray = NDArray[np.float64]

SLOW = 10.0 ** np.arange(-6.0, -1.4, 0.25)  # [rad] where the grid may begin
PARTED = 100.0  # times the least difference so far
ROUNDS = 60  # halvings of an interval at most: down to the spacing of floats


def required_at(system: Display, angles: FloatArray, T: float) -> NDArray[np.complex128]:
    """Compute T/2 [Herm H + cot(th/2) j Skew H] with Herm, Skew = (H ± H*)/2, Hermitian (k, n, n) [N s/m].

    The same as T/(2 (1 - cos th)) Herm{(1 - e^{-j th}) H(e^{j th})} (Colgate and Schenkel 1997), written so that
    nothing cancels: (1 - e^{-j th})/(2 (1 - cos th)) = (1 + j cot(th/2))/2.
    """
    H = system.response(angles)
    adjoint = H.conj().transpose(0, 2, 1)
    cot = (np.cos(angles / 2) / np.sin(angles / 2))[:, None, None]
    return np.asarray(T / 4 * ((H + adjoint) + 1j * cot * (H - adjoint)))


def worst_on_grid(system: Display, B: FloatArray, T: float) -> tuple[float, float]:
    """Find sup over th in (0, pi] of the largest eigenvalue of `required_at` - B [N s/m], and th.

    Intervals are halved as long as their curvature leaves room for a larger value, then the peak is polished; slow
    motion is extrapolated. Accurate to about 1e-9 of the damping where the time constants of H are below 10000 samples
    and it has no resonance much narrower than the first grid's pi/256: such a one can be missed in a function; of
    matrices the poles are looked at.
    """
    first, limit = at_rest(system, T)
    angles = np.concatenate([np.geomspace(first, 0.1, 80), np.linspace(0.1, np.pi, 256)[1:]])
    if isinstance(system, StateSpace) and system.states:
        poles = system.poles()
        near = np.abs(np.angle(poles))[:, None] + (1.0 - np.abs(poles))[:, None] * np.array([-2, -1, 0, 1, 2])
        angles = np.concatenate([angles, near[(near > first) & (near < np.pi)]])
    angles = np.unique(angles)

    def value(th: FloatArray) -> FloatArray:
        return np.asarray(np.linalg.eigvalsh(required_at(system, th, T) - B)[:, -1])

    best, at = polished(value, *refined(value, angles))
    slow = float(np.linalg.eigvalsh(limit - B)[-1])
    return (slow, 0.0) if slow > best else (best, at)


def at_rest(system: Display, T: float) -> tuple[float, FloatArray]:
    """Find an angle from which on `required_at` is free of rounding, and its limit for th -> 0, (n, n).

    Close to z = 1 the rounding of H counts 2/th-fold, far from it the extrapolation of its real part, which is even,
    from th, 2 th and 4 th fails: the angle is taken where two extrapolations differ least, on this side of where they
    first part (on the far side of a slow pole they would agree again, on another limit).
    """
    G = required_at(system, (SLOW[:, None] * [1.0, 2.0, 4.0]).ravel(), T).real
    G = G.reshape(len(SLOW), 3, *G.shape[1:])
    limits = (64 * G[:, 0] - 20 * G[:, 1] + G[:, 2]) / 45
    apart = np.abs(np.diff(limits, axis=0)).max(axis=(1, 2))
    parted = apart > PARTED * np.minimum.accumulate(apart)
    k = int(apart[: int(parted.argmax()) if parted.any() else None].argmin())
    return float(SLOW[k]), limits[k]


def refined(value: Callable[[FloatArray], FloatArray], angles: FloatArray) -> tuple[float, float]:
    """Find a function's largest value on a grid that is halved where it could still hold a larger one."""
    values = value(angles)
    left, right, low, high = angles[:-1], angles[1:], values[:-1], values[1:]
    k = int(values.argmax())
    best, at = float(values[k]), float(angles[k])
    scale = float(np.abs(values).max())
    for _ in range(ROUNDS):
        middle = (left + right) / 2
        if not len(middle):
            break
        largest = value(middle)
        k = int(largest.argmax())
        if largest[k] > best:
            best, at = float(largest[k]), float(middle[k])
        # a parabola through the three values rises above them by less than its curvature
        rise = 4 * np.abs(largest - (low + high) / 2)
        open_ = (np.maximum(np.maximum(low, high), largest) + rise > best) & (rise > 1e-9 * scale)
        open_ &= right - left > 1e-13
        left, right, low, high = (
            np.concatenate([left[open_], middle[open_]]),
            np.concatenate([middle[open_], right[open_]]),
            np.concatenate([low[open_], largest[open_]]),
            np.concatenate([largest[open_], high[open_]]),
        )
    return best, at


def polished(value: Callable[[FloatArray], FloatArray], best: float, at: float) -> tuple[float, float]:
    """Sharpen a peak, known to within a millesimal of its angle, to rounding."""
    from scipy.optimize import minimize_scalar

    for width in (1e-2, 1e-4, 1e-6):
        ends = max(at * (1 - width), 0.0), min(at * (1 + width), np.pi)
        result = minimize_scalar(
            lambda th: -float(value(np.array([th]))[0]), bounds=ends, method="bounded", options={"xatol": 1e-12}
        )
        if -result.fun > best:
            best, at = -float(result.fun), float(result.x)
    return best, at
