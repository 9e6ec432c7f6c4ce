"""Responses of a sampled display from positions to held forces, and the motion that extracts the most energy."""

from __future__ import annotations

import cmath
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.analysis.checked_arguments import number
from graspfx.errors import InputError
from graspfx.numeric import count, finite

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

SYMMETRIC = 1e-9  # smaller relative asymmetries or negative parts of H(1) are rounding
AT_REST = 1e-9  # angle [rad] that replaces z = 1 for a function H, which may divide by z - 1
ROUNDED = 1e-7  # relative error that such a function may have near z = 1
LONGEST = 5000  # largest number of samples times channels, for a matrix of 200 MB


@dataclass(frozen=True, eq=False)
class StateSpace:
    """H(z) = C (z I - A)^-1 B + D with n channels, from position [m] to the opposing force [N].

    Attributes:
        A, B, C, D: Matrices (s, s), (s, n), (n, s), (n, n).
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray

    @property
    def channels(self) -> int:
        return len(self.D)

    @property
    def states(self) -> int:
        return len(self.A)

    def poles(self) -> ComplexArray:
        return np.linalg.eigvals(self.A).astype(complex)

    def stable(self) -> bool:
        """True if all poles lie inside the unit circle."""
        return not self.states or bool(np.abs(self.poles()).max() < 1.0)

    def response(self, angles: FloatArray) -> ComplexArray:
        """Evaluate H(e^{j th}) for angles (k,), (k, n, n)."""
        z = np.exp(1j * angles)[:, None, None]
        return np.asarray(self.C @ np.linalg.solve(z * np.eye(self.states) - self.A, self.B + 0j) + self.D)

    def static(self) -> FloatArray:
        """Evaluate H(1), the static stiffness, (n, n) [N/m]; H must be stable."""
        return np.asarray(self.C @ np.linalg.solve(np.eye(self.states) - self.A, self.B) + self.D)


@dataclass(frozen=True, eq=False)
class Function:
    """H(z) as a function of z that returns a number or (n, n); the caller guarantees that it is stable."""

    evaluate: Callable[[complex], Any]
    channels: int

    def response(self, angles: FloatArray) -> ComplexArray:
        """Evaluate H(e^{j th}) for angles (k,), (k, n, n)."""
        n = self.channels
        values = [np.asarray(self.evaluate(cmath.exp(1j * th)), dtype=complex).reshape(n, n) for th in angles.tolist()]
        H = np.array(values)
        if not np.isfinite(H).all():
            raise InputError("H", self.evaluate, "a function that is finite on the unit circle", "H must be stable")
        return H


Display = StateSpace | Function


def display(H: object, period: float) -> Display:
    """Create a display from a function of z, (A, B, C, D), an object with these (python-control, SciPy) or a stiffness.

    Raises:
        InputError: If shapes do not fit, values are not finite, or the system is continuous or has another period.
    """
    period = number("period", period, "s", zero=False)
    _check_sampling(H, period)
    if callable(H) and not all(hasattr(H, name) for name in "ABCD"):
        shape = np.shape(H(cmath.exp(1j)))
        if shape not in ((), (1,)) and (len(shape) != 2 or shape[0] != shape[1]):
            raise InputError(
                "H", H, "a function of z that returns a number or a square matrix", f"it returns shape {shape}"
            )
        return Function(H, shape[0] if len(shape) == 2 else 1)
    if not all(hasattr(H, name) for name in "ABCD") and hasattr(H, "to_ss"):
        H = H.to_ss()
    if all(hasattr(H, name) for name in "ABCD"):
        parts = [getattr(H, name) for name in "ABCD"]
    elif isinstance(H, tuple):
        parts = list(H)
    else:
        D = _square("H", H)
        return StateSpace(np.zeros((0, 0)), np.zeros((0, len(D))), np.zeros((len(D), 0)), D)
    if len(parts) != 4:
        raise InputError("H", H, "the four matrices (A, B, C, D)")
    D = _square("D", parts[3])
    n = len(D)
    A = np.zeros((0, 0)) if not np.size(parts[0]) else _square("A", parts[0])
    s = len(A)
    B, C = _real("B", parts[1]), _real("C", parts[2])
    if B.size != s * n or C.size != s * n:
        raise InputError("H", H, f"B ({s}, {n}) and C ({n}, {s}) for {s} states and {n} channels")
    return StateSpace(A, B.reshape(s, n), C.reshape(n, s), D)


def symmetric(name: str, matrix: ArrayLike, n: int) -> FloatArray:
    """Return a damping or a mass as (n, n), from a number, one per direction, or a symmetric matrix.

    Raises:
        InputError: If the shape is wrong, or the matrix is not finite or not symmetric.
    """
    b = _real(name, matrix)
    if b.shape not in ((), (n,), (n, n)):
        raise InputError(name, matrix, f"one number, {n} numbers or a matrix ({n}, {n})")
    if b.ndim < 2:
        return np.diag(np.broadcast_to(b, n)).astype(float)
    if b.size and np.abs(b - b.T).max() > SYMMETRIC * np.abs(b).max():
        raise InputError(name, b, "a symmetric matrix")
    return np.asarray((b + b.T) / 2)


def never_passive(system: Display, scale: float) -> bool:
    """True if no device damping is sufficient: H is unstable, or H(1) is not symmetric or is negative.

    With a skew part of H(1), a sufficiently slow circular motion gains energy; with a negative stiffness, a
    sufficiently long push gains energy. In both cases the energy exceeds the dissipation, which vanishes for slow
    motion. `scale` is the magnitude of H elsewhere [N/m].
    """
    if isinstance(system, StateSpace):
        if not system.stable():
            return True
        K, allowed = system.static(), SYMMETRIC
    else:
        K, allowed = system.response(np.array([AT_REST]))[0].real, ROUNDED
    allowed *= max(scale, float(np.abs(K).max()))
    return bool(np.abs(K - K.T).max() > allowed or np.linalg.eigvalsh((K + K.T) / 2)[0] < -allowed)


def _check_sampling(H: object, period: float) -> None:
    dt = getattr(H, "dt", None)
    if (dt is not None and not isinstance(dt, bool) and dt == 0) or hasattr(H, "to_discrete"):
        raise InputError("H", H, "a system in discrete time", "sample it with the hold of the display first")
    if isinstance(dt, int | float) and not isinstance(dt, bool) and abs(dt - period) > 1e-9 * period:
        raise InputError("H", H, f"a system sampled every {period} s", f"its own period is {dt} s")


def _real(name: str, value: object) -> FloatArray:
    return finite(name, value, "finite real numbers")


def _square(name: str, matrix: object) -> FloatArray:
    value = np.atleast_2d(_real(name, matrix))
    if value.ndim != 2 or value.shape[0] != value.shape[1] or not value.size:
        raise InputError(name, value, "a square matrix")
    return value


@dataclass(frozen=True, eq=False)
class WorstMotion:
    """Motion from rest that leaves the least energy in device and display.

    Attributes:
        margin: T E / sum |D_k|^2 [N s/m]: damping of the device in excess of what the motion requires; negative if the
            damping is too small.
        steps: Displacements D_k, (N, n), with sum |D_k|^2 = 1 m^2.
        energy: Lower bound E of the energy absorbed over these steps [J]; negative if the motion extracts energy.
    """

    margin: float
    steps: FloatArray
    energy: float


def worst_motion(H: object, damping: ArrayLike, period: float, samples: int) -> WorstMotion:
    """Minimise E = sum_k D_k'B D_k/T + f_k'D_k over D with sum_k |D_k|^2 = 1, for N samples from rest.

    f_k = sum_{j <= k} h_{k-j} x_j, with the impulse response h of H, and D_k = x_{k+1} - x_k, x_0 = 0. Of all motions
    between two samples, uniform motion dissipates least, D'B D/T. As N grows, T times the smallest eigenvalue of this
    form decreases to the damping margin, about as 1/N^2, and is never below it. A negative value is therefore proved by
    its motion.

    Args:
        H: (A, B, C, D), an object with them, or a stiffness; not a function of z.
        damping: Damping B of the device, a number, (n,) or (n, n) [N s/m].
        period: Period T [s].
        samples: Number N of samples. The computing time grows as (N n)^3, and N n may be at most 5000.

    Raises:
        InputError: If H is a function of z, or `samples` is zero or too large.
    """
    system = display(H, period)
    if not isinstance(system, StateSpace):
        raise InputError("H", H, "matrices (A, B, C, D)", "a function of z has no impulse response to start from")
    samples = count("samples", samples, 1)
    if samples * system.channels > LONGEST:
        most = f"at most {LONGEST // system.channels} samples"
        raise InputError("samples", samples, most, "fewer suffice: the margin converges as 1/N^2")
    n, B = system.channels, symmetric("damping", damping, system.channels)
    h = [system.D]  # impulse response
    x = system.B
    for _ in range(samples - 1):
        h.append(system.C @ x)
        x = system.A @ x
    step = np.cumsum(h, axis=0)  # force on a unit step, (N, n, n)
    E = np.zeros((samples, n, samples, n))
    for k in range(samples):
        E[k, :, k] = B / period
        E[k, :, :k] = step[:k][::-1].transpose(1, 0, 2)
    form = E.reshape(samples * n, samples * n)
    from scipy.linalg import eigh

    values, vectors = eigh((form + form.T) / 2, subset_by_index=[0, 0])
    least = float(values[0])
    return WorstMotion(period * least, vectors[:, 0].reshape(samples, n), least)
