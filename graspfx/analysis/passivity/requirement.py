"""Damping of the device that makes a sampled display passive for every operator."""

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
    """Compute the damping that a device needs to display H passively, for every operator.

    The damping is the supremum over angular frequencies w in (0, pi/T] of

        T/(2 (1 - cos wT)) Re{(1 - e^{-jwT}) H(e^{jwT})}

    A device with mass and damping b that displays H through a zero-order hold is passive if and only if b exceeds this
    value (Colgate and Schenkel 1997). For n > 1 channels, all devices have the same b, and Re{...} is replaced by the
    largest eigenvalue of the Hermitian part.

    The relative error is about 1e-9 for matrices. For a function of z it is about 1e-9 if H has no time constant above
    10000 samples and no resonance much narrower than pi/256 rad.

    Args:
        H: Display from positions to opposing forces [N/m]: a function of z that returns a number or an array (n, n),
            matrices (A, B, C, D), an object with these attributes, for example of python-control or SciPy, or a
            constant stiffness.
        period: Sampling period T [s].

    Returns:
        The damping [N s/m]. It is negative if H itself dissipates energy at every frequency. It is inf if no damping is
        sufficient, because H is unstable, or because H(1) is not symmetric or has a negative eigenvalue. Functions of z
        are assumed to be stable.

    Raises:
        InputError: If shapes of the matrices do not match, or the system is in continuous time or has another sampling
            period.
    """
    system = display(H, period)
    return _lack(system, np.zeros((system.channels, system.channels)), period)


def damping_margin(H: object, damping: ArrayLike, period: float) -> float:
    """Compute the smallest eigenvalue over th in (0, pi] of the device's damping minus the damping that H requires.

    With the Hermitian part Herm, this is the smallest eigenvalue of

        B - T/(2 (1 - cos th)) Herm{(1 - e^{-j th}) H(e^{j th})}

    The margin is non-negative if and only if a device with damping B displays H passively for every operator, who may
    hold all channels at once.

    Args:
        H, period: As for `required_damping`.
        damping: Damping B of the device, a number, (n,) or a symmetric matrix (n, n) [N s/m].

    Returns:
        The margin [N s/m]; -inf if no damping is sufficient.
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
    """Compute the required damping at angles th (k,), T/(2 (1 - cos th)) Herm{(1 - e^{-j th}) H(e^{j th})}.

    It is evaluated without cancellation as T/2 [Herm H + j cot(th/2) Skew H], with Herm H = (H + H*)/2 and Skew H = (H
    - H*)/2. The result is Hermitian, (k, n, n) [N s/m].
    """
    H = system.response(angles)
    adjoint = H.conj().transpose(0, 2, 1)
    cot = (np.cos(angles / 2) / np.sin(angles / 2))[:, None, None]
    return np.asarray(T / 4 * ((H + adjoint) + 1j * cot * (H - adjoint)))


def worst_on_grid(system: Display, B: FloatArray, T: float) -> tuple[float, float]:
    """Compute the supremum over th in (0, pi] of the largest eigenvalue of `required_at` - B [N s/m], and its th.

    Intervals of the grid are bisected as long as their curvature permits a larger value. The value for th -> 0 is
    extrapolated. The relative error is about 1e-9 if time constants of H are below 10000 samples, and H has no
    resonance much narrower than the spacing pi/256 of the first grid. A narrower resonance of a function of z can be
    missed; for matrices, the grid is refined near the poles.
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
    """Find the smallest angle th for the grid [rad], and the limit of the real part of `required_at` for th -> 0.

    The limit is extrapolated from th, 2 th and 4 th, in even powers of th. If th is too small, the rounding of H is
    amplified by 2/th; if th is too large, the extrapolation is inaccurate. Extrapolations from neighbouring candidates
    of th are therefore compared, and the candidate with the smallest difference is chosen. Only candidates below the
    first large difference are considered, because above a slow pole the extrapolations agree on a wrong limit.
    """
    G = required_at(system, (SLOW[:, None] * [1.0, 2.0, 4.0]).ravel(), T).real
    G = G.reshape(len(SLOW), 3, *G.shape[1:])
    limits = (64 * G[:, 0] - 20 * G[:, 1] + G[:, 2]) / 45
    apart = np.abs(np.diff(limits, axis=0)).max(axis=(1, 2))
    parted = apart > PARTED * np.minimum.accumulate(apart)
    k = int(apart[: int(parted.argmax()) if parted.any() else None].argmin())
    return float(SLOW[k]), limits[k]


def refined(value: Callable[[FloatArray], FloatArray], angles: FloatArray) -> tuple[float, float]:
    """Find the maximum of a function of an angle, and the angle, on a grid refined where larger values are possible."""
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
    """Refine the maximum `best` of a function at the angle `at`, which is known to 1 %, to rounding."""
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
    """Hermitian part of W(z) = B/T + H(z)/(z - 1) on the unit circle, for a display H and a device with damping B.

    The pole of W at z = 1 is removed: with X(z) = (H(z) - H(1))/(z - 1) = -C (I - A)^-1 (z I - A)^-1 B and Herm{1/(z -
    1)} = -1/2 on the circle, T Herm W = B - T/2 H(1) + T Herm X(z). H must be stable with symmetric H(1). It is passive
    if and only if T Herm W on the circle, including z = 1, and H(1) are positive semidefinite (discrete positive real
    lemma, Hitz and Anderson 1969).
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
        """Compute the missing damping at angles th (k,), the largest eigenvalue of -T Herm W(e^{j th}) [N s/m]."""
        z = np.exp(1j * angles)[:, None, None]
        X = self.C @ np.linalg.solve(z * np.eye(len(self.A)) - self.A, self.B + 0j)
        return np.asarray(np.linalg.eigvalsh(-self.rest - (X + X.conj().transpose(0, 2, 1)) / 2)[:, -1])

    def crossings(self, level: float, near: float = NEAR) -> FloatArray:
        """Find the angles in [0, pi] at which an eigenvalue of -T Herm W equals `level` [N s/m], in ascending order.

        They are the angles of the eigenvalues z on the unit circle of the symplectic pencil z x = A x + B u, p = z (A'p
        + C'u), 0 = C x + B'p + 2 (rest + level) u.
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
        """Find the maximum of `lack` over the angle [N s/m], and the angle [rad].

        Each iteration computes the `crossings` of the largest value found so far and evaluates `lack` at the midpoints
        of the intervals between them, which contain all larger values. The iteration converges quadratically (Boyd and
        Balakrishnan 1990; Bruinsma and Steinbuch 1990, for the H-infinity norm).
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
