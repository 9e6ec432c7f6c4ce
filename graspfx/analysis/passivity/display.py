"""Sampled displays as functions from positions to held forces, and the motion that extracts most energy from them."""

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
    """Display H(z) = C (z I - A)^-1 B + D from n positions [m] to the n opposing forces [N].

    Attributes:
        A, B, C, D: Matrices (s, s), (s, n), (n, s), (n, n) for s states.
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
        """Return whether all poles lie inside the unit circle."""
        return not self.states or bool(np.abs(self.poles()).max() < 1.0)

    def response(self, angles: FloatArray) -> ComplexArray:
        """Evaluate H(z) at z = e^{j th} for angles th (k,) [rad]; the result is (k, n, n) [N/m]."""
        z = np.exp(1j * angles)[:, None, None]
        return np.asarray(self.C @ np.linalg.solve(z * np.eye(self.states) - self.A, self.B + 0j) + self.D)

    def static(self) -> FloatArray:
        """Evaluate the static stiffness H(1), (n, n) [N/m]; the display must be stable."""
        return np.asarray(self.C @ np.linalg.solve(np.eye(self.states) - self.A, self.B) + self.D)


@dataclass(frozen=True, eq=False)
class Function:
    """Display H(z) given as a function of z that returns a number or an array (n, n); it is assumed to be stable."""

    evaluate: Callable[[complex], Any]
    channels: int

    def response(self, angles: FloatArray) -> ComplexArray:
        """Evaluate H(z) at z = e^{j th} for angles th (k,) [rad]; the result is (k, n, n) [N/m]."""
        n = self.channels
        values = [np.asarray(self.evaluate(cmath.exp(1j * th)), dtype=complex).reshape(n, n) for th in angles.tolist()]
        H = np.array(values)
        if not np.isfinite(H).all():
            raise InputError("H", self.evaluate, "a function that is finite on the unit circle", "H must be stable")
        return H


Display = StateSpace | Function


def display(H: object, period: float) -> Display:
    """Create a display from H, given as a function of z, matrices (A, B, C, D), a system or a constant stiffness.

    A system is an object with attributes A, B, C and D, such as those of python-control and SciPy.

    Raises:
        InputError: If shapes do not match, a value is infinite or nan, or the system is in continuous time or has a
            sampling period other than `period`.
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
    """Return a damping or mass matrix (n, n), given as a number, one number per direction, or a symmetric matrix.

    Raises:
        InputError: If the shape is wrong, a value is infinite or nan, or the matrix is not symmetric.
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
    """Return whether no damping of the device makes a display passive.

    This is so if the display H is unstable, or if its static stiffness H(1) is not symmetric or has a negative
    eigenvalue. With an asymmetric H(1), a circular motion gains energy; with a negative eigenvalue, a push gains
    energy. If the motion is slow enough, this energy exceeds the energy that damping dissipates. `scale` is the
    magnitude of H at other frequencies [N/m].
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
        raise InputError("H", H, "a system in discrete time", "discretise the system with a zero-order hold first")
    if isinstance(dt, int | float) and not isinstance(dt, bool) and abs(dt - period) > 1e-9 * period:
        raise InputError("H", H, f"a system sampled every {period} s", f"the system is sampled every {dt} s")


def _real(name: str, value: object) -> FloatArray:
    return finite(name, value, "finite real numbers")


def _square(name: str, matrix: object) -> FloatArray:
    value = np.atleast_2d(_real(name, matrix))
    if value.ndim != 2 or value.shape[0] != value.shape[1] or not value.size:
        raise InputError(name, value, "a square matrix")
    return value


@dataclass(frozen=True, eq=False)
class WorstMotion:
    """Motion that extracts the most energy from a device and its display, relative to its squared displacements.

    Attributes:
        margin: Damping of the device minus the damping that the motion requires, T E / sum |D_k|^2 [N s/m]; negative if
            the damping is too small. T is the sampling period.
        steps: Displacements D_k in N samples, (N, n) [m], with sum |D_k|^2 = 1 m^2.
        energy: Lower bound E of the energy that device and display absorb in this motion [J]; negative if the motion
            extracts energy.
    """

    margin: float
    steps: FloatArray
    energy: float


def worst_motion(H: object, damping: ArrayLike, period: float, samples: int) -> WorstMotion:
    """Minimise the energy E = sum_k D_k'B D_k/T + f_k'D_k that a device and its display absorb in N samples.

    The minimum is over displacements D_k = x_{k+1} - x_k from x_0 = 0 with sum_k |D_k|^2 = 1. The displayed force is
    f_k = sum_{j <= k} h_{k-j} x_j, with the impulse response h of H. Of all motions between two samples, uniform motion
    dissipates the least energy, D_k'B D_k/T. The margin T E is an upper bound of `damping_margin` and converges to it
    about as 1/N^2. A negative margin therefore proves that the display is not passive.

    Args:
        H: Display: matrices (A, B, C, D), an object with these attributes, or a constant stiffness [N/m]; not a
            function of z.
        damping: Damping B of the device, a number, (n,) or (n, n) [N s/m].
        period: Sampling period T [s].
        samples: Number N of samples. The computing time grows as (N n)^3, and N n may be at most 5000.

    Raises:
        InputError: If H is a function of z, or `samples` is zero or too large.
    """
    system = display(H, period)
    if not isinstance(system, StateSpace):
        raise InputError("H", H, "matrices (A, B, C, D)", "the impulse response of a function of z is not known")
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
