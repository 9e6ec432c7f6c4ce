"""Passive gains of the coupling of eq. (4): energy that the hold generates, compared with dissipation by damping."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.analysis.checked_arguments import number, one_of
from graspfx.analysis.passivity.display import symmetric
from graspfx.analysis.stability.loop import object_matrices
from graspfx.errors import InputError
from graspfx.numeric import SMALLEST, finite

FloatArray = NDArray[np.float64]
Integrator = Literal["explicit", "semi-implicit", "exact"]


@dataclass(frozen=True, eq=False)
class CouplingLimits:
    """Largest internal and external stiffnesses kip and kep of a grasp that is passive for every operator.

    The limits hold for all masses of devices and object. The limit of kip is also necessary for passivity. The limit of
    kep is necessary if the object is sufficiently heavy and the damping ked is zero. In the formulas, b is the damping
    of each device, T the sampling period, G the grasp matrix and B_o the object's viscosity.

    Attributes:
        internal: Limit of kip, 2 (b - |kid|)/T [N/m]; inf if the grasp has no internal forces.
        external: Limit of kep, the minimum over i of (2/T) (b B_i/(b + B_i) - |ked|) [N/m]; inf if the fingers cannot
            move the object.
        modal_viscosity: Eigenvalues B_i of (G G')^-1/2 B_o (G G')^-1/2 in ascending order [N s/m].
    """

    internal: float
    external: float
    modal_viscosity: FloatArray


def external_limit(damping: float, period: float, object_viscosity: float, *, coupling_damping: float = 0.0) -> float:
    """Compute the largest passive stiffness k = (2/T) (b B/(b + B) - |ked|) of a spring between a device and an object.

    If the length of the spring changes by D in a sample, the hold generates the energy k D^2/2, and the dampings of
    device and object dissipate at least b B/(b + B) D^2/T. Up to this stiffness, the device is passive for every
    operator and all masses of device and object. With a larger stiffness and ked = 0, a sufficiently heavy object
    generates energy. The object must move exactly under a held force (integrator "exact"), without delay.

    Args:
        damping: Damping b of the device [N s/m].
        period: Sampling period T [s].
        object_viscosity: Viscosity B of the object [N s/m]; inf for a fixed object.
        coupling_damping: Damping ked of the coupling, on the backward difference of the spring's elongation [N s/m].

    Returns:
        The largest passive stiffness [N/m]; 0 if no stiffness is passive because |ked| is too large.
    """
    number("period", period, "s", zero=False)
    for name, value in (("damping", damping), ("object_viscosity", object_viscosity)):
        if not np.array_equal(value, math.inf):
            number(name, value, "N s/m")
    number("coupling_damping", coupling_damping, "N s/m", negative=True)
    return max(0.0, 2 / period * (_in_series(damping, object_viscosity) - abs(coupling_damping)))


def coupling_limits(
    G: ArrayLike,
    damping: float,
    period: float,
    object_viscosity: ArrayLike,
    *,
    external_damping: float = 0.0,
    internal_damping: float = 0.0,
) -> CouplingLimits:
    """Compute the limits of kep and kip for devices with the same damping in all directions; see `CouplingLimits`.

    Let P be the projector on external forces. For a stiffness kep P + kip (I - P), the two limits are independent,
    because internal motions do not move the object, and each external motion couples one device coordinate and one
    object coordinate by the stiffness kep.

    Args:
        G: Grasp matrix (w, m), with one row for each direction in which the object can move; linearly dependent rows
            are permitted.
        damping: Damping b of every device [N s/m].
        period: Sampling period T [s].
        object_viscosity: Viscosity B_o, a number, (w,) or symmetric (w, w) [N s/m; N m s/rad for rotations].
        external_damping, internal_damping: Dampings ked and kid of the coupling [N s/m], on the backward difference of
            the displacement.

    Raises:
        InputError: If shapes do not match, the damping of the devices is negative, or the period is not positive.
    """
    number("period", period, "s", zero=False)
    number("damping", damping, "N s/m")
    number("internal_damping", internal_damping, "N s/m", negative=True)
    G = _matrix("G", G)
    w, m = G.shape
    Bo = symmetric("object_viscosity", object_viscosity, w)
    internal = max(0.0, 2 / period * (damping - abs(internal_damping)))
    left, sizes, _ = np.linalg.svd(G, full_matrices=False)
    significant = sizes > max(SMALLEST, max(w, m) * np.finfo(float).eps * max(sizes, default=0.0))
    shape = left[:, significant] / sizes[significant]  # significant columns of (G G')^-1/2, up to a rotation
    viscosity = np.linalg.eigvalsh(shape.T @ Bo @ shape)
    external = (
        external_limit(damping, period, max(0.0, float(viscosity[0])), coupling_damping=external_damping)
        if len(viscosity)
        else math.inf
    )
    return CouplingLimits(internal if len(viscosity) < m else math.inf, external, viscosity)


def leak_matrix(K: ArrayLike, G: ArrayLike, period: float, *, damping: ArrayLike | None = None) -> FloatArray:
    """Compute the leak matrix L = [I; -G] (T/2 K + |D|) [I, -G'], which bounds the energy that the hold generates.

    In a sample, fingers move by dx and the object by dq, the displacement e = x - G'q changes by de = dx - G'dq, and
    the held force f_k = K e_k generates the energy 1/2 de'K de in addition to the change of the stored energy 1/2 e'K
    e. Damping D on the backward difference of e generates at most de'|D| de/T. Together this is y'L y/T, with y = (dx,
    dq). Devices with damping B_d and an object with viscosity B_o dissipate at least y' diag(B_d, B_o) y/T. Devices,
    coupling and object are therefore passive in every sample if diag(B_d, B_o) - L is positive semidefinite. If D is
    zero, this condition is also necessary for sufficiently heavy objects.

    If D is zero, frictionless fingers that touch and release the object do not generate more energy, because their
    force is the gradient of a convex energy that is at most as stiff as K.

    Args:
        K: Symmetric positive semidefinite stiffness, (m, m) [N/m].
        G: Grasp matrix (w, m); for a fixed object, w = 0.
        period: Sampling period T [s].
        damping: Symmetric damping D of the coupling, (m, m) [N s/m]; zero if None.

    Returns:
        Matrix L, (m + w, m + w) [N s/m].
    """
    number("period", period, "s", zero=False)
    G = _matrix("G", G)
    m = G.shape[1]
    loss = period / 2 * _stiffness(K, m)
    if damping is not None:
        values, axes = np.linalg.eigh(symmetric("damping", damping, m))
        loss = loss + (axes * np.abs(values)) @ axes.T
    stretch = np.vstack([np.eye(m), -G])
    return np.asarray(stretch @ loss @ stretch.T)


def leak_margin(
    K: ArrayLike,
    G: ArrayLike,
    damping: ArrayLike,
    object_viscosity: ArrayLike,
    period: float,
    *,
    coupling_damping: ArrayLike | None = None,
) -> float:
    """Compute the smallest eigenvalue of diag(B_d, B_o) - L, with the matrix L of `leak_matrix`.

    If the eigenvalue is not negative, damping dissipates at least the energy that the hold generates. If the object can
    rotate, only the sign of the eigenvalue is meaningful, because units are mixed.

    Args:
        K, G, period: As for `leak_matrix`.
        damping: Damping B_d of the devices, a number, (m,) or (m, m) [N s/m].
        object_viscosity: Viscosity B_o, a number, (w,) or (w, w) [N s/m; N m s/rad for rotations].
        coupling_damping: Damping D of the coupling, (m, m) [N s/m]; zero if None.
    """
    G = _matrix("G", G)
    w, m = G.shape
    L = leak_matrix(K, G, period, damping=coupling_damping)
    B = np.zeros_like(L)
    B[:m, :m] = symmetric("damping", damping, m)
    if w:
        B[m:, m:] = symmetric("object_viscosity", object_viscosity, w)
    return float(np.linalg.eigvalsh(B - L)[0])


def grasp_display(
    K: ArrayLike,
    G: ArrayLike,
    mass: ArrayLike,
    viscosity: ArrayLike,
    period: float,
    *,
    damping: ArrayLike | None = None,
    integrator: Integrator = "exact",
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Compute the display H(z) of an object coupled to devices by eq. (4), for example for `required_damping`.

    With finger positions x and object coordinates q, the displacement is e = x - G'q, the force f = K e + D (e -
    e_{k-1})/T, and the object moves by M_o q'' + B_o q' = G f, with f held over a sample. Unlike `leak_margin`, which
    is valid for every mass, the result is exact for the given mass. Contacts are fixed in the object, and its rotation
    is assumed to be small.

    Args:
        K, damping: Stiffness K [N/m] and damping D [N s/m] of the coupling, each (m, m).
        G: Grasp matrix (w, m) with linearly independent rows.
        mass: Mass M_o, a number, (w,) or a positive definite matrix (w, w) [kg, kg m^2].
        viscosity: Viscosity B_o, a number, (w,) or (w, w) [N s/m, N m s/rad]; if it is zero, the display is not stable.
        period: Sampling period T [s].
        integrator: Integrator of the object.

    Returns:
        Matrices (A, B, C, D) of H(z) from x to f, with the states q, q' and, if damping is not zero, e_{k-1}.
    """
    number("period", period, "s", zero=False)
    one_of("integrator", integrator, get_args(Integrator))
    G, T = _matrix("G", G), period
    w, m = G.shape
    k = _matrix("K", K)
    if k.shape != (m, m):
        raise InputError("K", k, f"a matrix ({m}, {m})")
    d = np.zeros((m, m)) if damping is None else symmetric("damping", damping, m)
    M, Bo = symmetric("mass", mass, w), symmetric("viscosity", viscosity, w)
    if w and not np.linalg.eigvalsh(M)[0] >= SMALLEST:
        raise InputError("mass", mass, "a positive definite mass")
    P, Q, R, S = object_matrices(integrator, M, Bo, T)
    move, push = np.block([[np.eye(w), P], [np.zeros((w, w)), R]]), np.vstack([Q @ G, S @ G])
    stretch = np.hstack([-G.T, np.zeros((m, w))])  # e = x + stretch (q, q')
    C = np.hstack([(k + d / T) @ stretch, -d / T])
    D = k + d / T
    A = np.zeros((2 * w + m, 2 * w + m))
    A[: 2 * w, : 2 * w] = move
    A[: 2 * w] += push @ C
    A[2 * w :, : 2 * w] = stretch
    B = np.vstack([push @ D, np.eye(m)])
    if not d.any():  # no force depends on e_{k-1}
        A, B, C = A[: 2 * w, : 2 * w], B[: 2 * w], C[:, : 2 * w]
    return A, B, C, D


def _in_series(b: float, B: float) -> float:
    if math.isinf(B) or math.isinf(b):
        return min(b, B)
    return b * B / (b + B) if b + B > 0.0 else 0.0


def _stiffness(K: ArrayLike, m: int) -> FloatArray:
    k = _matrix("K", K)
    if k.shape != (m, m) or np.abs(k - k.T).max() > 1e-9 * np.abs(k).max():
        raise InputError(
            "K",
            k,
            f"a symmetric matrix ({m}, {m})",
            'use form="symmetric": with an asymmetric stiffness, a fixed object generates energy at any damping',
        )
    k = (k + k.T) / 2
    if np.linalg.eigvalsh(k)[0] < -1e-9 * np.abs(k).max():
        raise InputError("K", k, "a positive semidefinite matrix")
    return k


def _matrix(name: str, argument: ArrayLike) -> FloatArray:
    value = finite(name, argument, "a finite matrix")
    if value.ndim != 2:
        raise InputError(name, value, "a finite matrix")
    return value
