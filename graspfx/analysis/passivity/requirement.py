"""Device damping that a display requires: by an adaptive grid for functions of z, without a grid for matrices."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.analysis.passivity.display import Display, StateSpace, display, never_passive, symmetric

FloatArray = NDArray[np.float64]

SLOW = 10.0 ** np.arange(-6.0, -1.4, 0.25)  # candidates for the start of the grid [rad]
PARTED = 100.0  # factor on the smallest difference so far, above which extrapolations count as separate
ROUNDS = 60  # largest number of bisections of an interval, and of levels of the pencil
STEP = 1e-10  # relative distance of the next level above a value that is known to be attained
NEAR = 1e-4  # distance from the unit circle up to which eigenvalues are examined; an extra eigenvalue only costs time


def required_damping(H: object, period: float) -> float:
    """Compute sup over w in (0, pi/T] of T/(2 (1 - cos wT)) Re{(1 - e^{-jwT}) H(e^{jwT})} [N s/m].

    A device with mass and damping b that displays H through a hold is passive for every operator if and only if b
    exceeds this value (Colgate and Schenkel 1997). For n channels the value is the largest eigenvalue of the Hermitian
    part, for devices of equal b.

    Matrices are searched without a grid, to a relative error of about 1e-9 (`PositiveReal`). A function of z is
    searched on an adaptive grid, to a relative error of about 1e-9 if H has no time constant above 10000 samples and no
    resonance much narrower than pi/256 rad.

    Args:
        H: Opposing force per position [N/m]: a function of z that returns a number or (n, n); (A, B, C, D); an object
            with these, for example from python-control or SciPy; or a constant stiffness.
        period: Period T [s].

    Returns:
        The damping; inf if none is sufficient, because H is unstable (for a function this is not tested), or H(1) is
        not symmetric or is negative. It is negative if H itself dissipates at every frequency.

    Raises:
        InputError: If matrices do not fit, or the system is continuous or has another period.
    """
    system = display(H, period)
    return _lack(system, np.zeros((system.channels, system.channels)), period)


def damping_margin(H: object, damping: ArrayLike, period: float) -> float:
    """Compute the smallest eigenvalue over th of B - T/(2 (1 - cos th)) Herm{(1 - e^{-j th}) H(e^{j th})} [N s/m].

    The margin is non-negative if and only if a device with damping B displays H passively at all its channels together
    (the Loewner order), for every operator who may hold all channels; -inf if no damping is sufficient.

    Args:
        H, period: As for `required_damping`.
        damping: Damping B, a number, (n,) or a symmetric (n, n) [N s/m].
    """
    system = display(H, period)
    return -_lack(system, symmetric("damping", damping, system.channels), period)


def _lack(system: Display, B: FloatArray, T: float) -> float:
    scale = float(np.abs(required_at(system, np.array([np.pi]), T)).max()) / T
    if never_passive(system, scale):
        return math.inf
    if isinstance(system, StateSpace):
        return PositiveReal(system, B, T).worst()[0]
    return worst_on_grid(system, B, T)[0]


def required_at(system: Display, angles: FloatArray, T: float) -> NDArray[np.complex128]:
    """Compute T/2 [Herm H + cot(th/2) j Skew H] with Herm, Skew = (H ± H*)/2, Hermitian (k, n, n) [N s/m].

    This equals T/(2 (1 - cos th)) Herm{(1 - e^{-j th}) H(e^{j th})} (Colgate and Schenkel 1997), in a form without
    cancellation: (1 - e^{-j th})/(2 (1 - cos th)) = (1 + j cot(th/2))/2.
    """
    H = system.response(angles)
    adjoint = H.conj().transpose(0, 2, 1)
    cot = (np.cos(angles / 2) / np.sin(angles / 2))[:, None, None]
    return np.asarray(T / 4 * ((H + adjoint) + 1j * cot * (H - adjoint)))


def worst_on_grid(system: Display, B: FloatArray, T: float) -> tuple[float, float]:
    """Compute sup over th in (0, pi] of the largest eigenvalue of `required_at` - B [N s/m], and th.

    Intervals are bisected as long as their curvature permits a larger value; then the peak is polished, and slow motion
    is extrapolated. The result is accurate to about 1e-9 of the damping if time constants of H are below 10000 samples,
    and H has no resonance much narrower than the spacing pi/256 of the first grid. A narrower resonance of a function
    can be missed; for matrices the poles are examined.
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
    """Find an angle above which `required_at` is free of rounding, and its limit for th -> 0, (n, n).

    Close to z = 1 the rounding of H is amplified by 2/th. Far from z = 1 the extrapolation of the real part of
    `required_at`, which is even in th, from th, 2 th and 4 th to zero is inaccurate. The chosen angle has the smallest
    difference of two extrapolations, among the angles before these first separate. Beyond a slow pole the
    extrapolations would agree again, on a limit that is wrong.
    """
    G = required_at(system, (SLOW[:, None] * [1.0, 2.0, 4.0]).ravel(), T).real
    G = G.reshape(len(SLOW), 3, *G.shape[1:])
    limits = (64 * G[:, 0] - 20 * G[:, 1] + G[:, 2]) / 45
    apart = np.abs(np.diff(limits, axis=0)).max(axis=(1, 2))
    parted = apart > PARTED * np.minimum.accumulate(apart)
    k = int(apart[: int(parted.argmax()) if parted.any() else None].argmin())
    return float(SLOW[k]), limits[k]


def refined(value: Callable[[FloatArray], FloatArray], angles: FloatArray) -> tuple[float, float]:
    """Find a function's largest value on a grid that is refined where a larger value is still possible."""
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
        # a parabola through the three values exceeds them by less than its curvature
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
    """Refine a peak, whose angle is known to 1 %, until only rounding errors remain."""
    from scipy.optimize import minimize_scalar

    for width in (1e-2, 1e-4, 1e-6):
        ends = max(at * (1 - width), 0.0), min(at * (1 + width), np.pi)
        result = minimize_scalar(
            lambda th: -float(value(np.array([th]))[0]), bounds=ends, method="bounded", options={"xatol": 1e-12}
        )
        if -result.fun > best:
            best, at = -float(result.fun), float(result.x)
    return best, at


class PositiveReal:
    """W(z) = B/T + H(z)/(z - 1) without its pole: T Herm W = B - T/2 H(1) + T Herm X(z), for symmetric H(1).

    X(z) = (H(z) - H(1))/(z - 1) = -C (I - A)^-1 (z I - A)^-1 B, and Herm{1/(z - 1)} = -1/2 on the circle. A display is
    passive on a device with damping B if and only if T Herm W >= 0 on the circle, including z = 1, and H(1) >= 0
    (discrete positive real lemma, Hitz and Anderson 1969). H must be stable with symmetric H(1).
    """

    def __init__(self, system: StateSpace, B: FloatArray, T: float) -> None:
        K = system.static()
        self.rest = B - T / 4 * (K + K.T)
        self.A, self.B = system.A, system.B
        self.C = -T * np.linalg.solve((np.eye(system.states) - system.A).T, system.C.T).T
        sizes = np.linalg.norm(self.B), np.linalg.norm(self.C)
        if min(sizes) > 0.0:  # scale states so that the pencil's blocks are of similar size
            ratio = np.sqrt(sizes[1] / sizes[0])
            self.B, self.C = self.B * ratio, self.C / ratio

    def lack(self, angles: FloatArray) -> FloatArray:
        """Compute the missing damping at angles (k,): largest eigenvalue of -T Herm W(e^{j th}) [N s/m]."""
        z = np.exp(1j * angles)[:, None, None]
        X = self.C @ np.linalg.solve(z * np.eye(len(self.A)) - self.A, self.B + 0j)
        return np.asarray(np.linalg.eigvalsh(-self.rest - (X + X.conj().transpose(0, 2, 1)) / 2)[:, -1])

    def crossings(self, level: float, near: float = NEAR) -> FloatArray:
        """Find the angles in [0, pi] at which an eigenvalue of -T Herm W equals `level`, in ascending order.

        On the unit circle: z x = A x + B u, p = z (A'p + C'u), 0 = C x + B'p + 2 (rest + level) u, a symplectic pencil
        whose eigenvalues on the circle have these angles.
        """
        from scipy.linalg import eig

        s, n = self.B.shape
        M, N = np.zeros((2, 2 * s + n, 2 * s + n))
        M[:s, :s], M[:s, 2 * s :] = self.A, self.B
        M[s : 2 * s, s : 2 * s] = np.eye(s)
        M[2 * s :, :s], M[2 * s :, s : 2 * s] = self.C, self.B.T
        M[2 * s :, 2 * s :] = 2 * (self.rest + level * np.eye(n))
        N[:s, :s] = np.eye(s)
        N[s : 2 * s, s : 2 * s], N[s : 2 * s, 2 * s :] = self.A.T, self.C.T
        over, under = eig(M, N, right=False, homogeneous_eigvals=True)
        on = (np.abs(np.abs(over) - np.abs(under)) < near * np.abs(under)) & (np.abs(under) > 0.0)
        return np.sort(np.abs(np.angle(over[on] / under[on])))

    def worst(self) -> tuple[float, float]:
        """Maximise `lack` [N s/m] over th, and return th; no level above the maximum is crossed.

        Each round computes the crossings of the largest value so far, which enclose all larger values, and evaluates
        the midpoints of those intervals. The iteration converges quadratically (Boyd and Balakrishnan 1990; Bruinsma
        and Steinbuch 1990, for the H-infinity norm).
        """
        start = np.concatenate([[0.0, np.pi], np.abs(np.angle(np.linalg.eigvals(self.A)))])
        values = self.lack(start)
        k = int(values.argmax())
        best, at = float(values[k]), float(start[k])
        if not len(self.A):
            return best, np.pi  # without memory, all frequencies are equal
        scale = float(np.abs(values).max() + np.abs(self.rest).max())
        for _ in range(ROUNDS):
            edges = self.crossings(best + STEP * scale)
            if not len(edges):
                break
            edges = np.concatenate([[0.0], edges, [np.pi]])
            angles = np.concatenate([edges, (edges[1:] + edges[:-1]) / 2])
            values = self.lack(angles)
            k = int(values.argmax())
            if values[k] <= best + STEP * scale:
                break
            best, at = float(values[k]), float(angles[k])
        return polished(self.lack, best, at)
