"""Passive gains of eq. (4) at the devices: energy created by a held coupling versus dissipation by damping."""

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
    """Limits of kip and kep for passivity at the devices' ports, for all operators and masses of devices and object.

    The limit `internal` is also necessary. The limit `external` is necessary for a sufficiently heavy object if ked =
    0. Below, b is the damping of each device, T the period, and B_o the object's viscosity.

    Attributes:
        internal: Limit of kip, 2 (b - |kid|)/T, for squeezing [N/m]; inf if no force is internal.
        external: Limit of kep, the minimum over modes of (2/T) (b B_i/(b + B_i) - |ked|), for moving the object
            [N/m]; inf if there are no such modes.
        modal_viscosity: Eigenvalues B_i of (G G')^-1/2 B_o (G G')^-1/2 in ascending order [N s/m].
    """

    internal: float
    external: float
    modal_viscosity: FloatArray


def external_limit(damping: float, period: float, object_viscosity: float, *, coupling_damping: float = 0.0) -> float:
    """Compute k = (2/T) (b B/(b + B) - |ked|) [N/m]: a device and a viscous object at the two ends of a held spring.

    If the spring stretches by D in a sample, it generates k D^2/2; the two dampings in series dissipate at least
    b B/(b + B) D^2/T. Below this stiffness the system is passive at the device's port for every operator and all masses
    of device and object. Above this stiffness, without ked, a sufficiently heavy object generates energy. The object
    must move exactly under a held force (integrator "exact"), without delay.

    Args:
        damping: Damping b of the device [N s/m].
        period: Period T [s].
        object_viscosity: Viscosity B of the object [N s/m]; inf for a fixed object.
        coupling_damping: Damping ked on the backward difference of e [N s/m].

    Returns:
        The largest passive stiffness [N/m]; 0 if ked alone generates too much energy.
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
    """Compute the limits of kep and kip for equal devices of damping b in all directions; see `CouplingLimits`.

    For K = kep P + kip (I - P) the leak matrix is block diagonal: squeezing does not move the object, and in the object
    coordinates (G G')^1/2 q each external mode couples one coordinate of the devices to one of the object with
    stiffness kep. The two limits are therefore independent.

    Args:
        G: Grasp matrix (w, m), with rows for the object's free directions; dependent rows are left out.
        damping: Damping b of every device [N s/m].
        period: Period T [s].
        object_viscosity: Viscosity B_o, a number, (w,) or symmetric (w, w) [N s/m; N m s/rad for rotations].
        external_damping, internal_damping: Dampings ked and kid on backward differences of e [N s/m].

    Raises:
        InputError: If shapes do not fit, a damping is negative, or the period is not positive.
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
    """Compute L = [I; -G] (T/2 K + |D|) [I, -G'], (m + w, m + w) [N s/m]: bound of the energy that the hold creates.

    On increments y = (Dx, Dq) of fingers and object, a held force absorbs f_k'De = V_{k+1} - V_k - 1/2 De'K De, with
    De = Dx - G'Dq and V = 1/2 e'K e. The force thus generates 1/2 De'K De = y'L y/T beyond the stored energy. Damping
    on the backward difference, D (e_k - e_{k-1})/T, returns up to De'|D| De/T at half the sampling rate. Frictions
    dissipate at least y' diag(B_d, B_o) y/T. Device, coupling and object together are therefore passive in every sample
    if diag(B_d, B_o) - L >= 0; without D this condition is also necessary for sufficiently heavy objects.

    K must be symmetric positive semidefinite. Without D, frictionless fingers that touch and let go generate no more
    energy, because their force is the gradient of a convex energy that is at most as stiff as K.

    Args:
        K: Stiffness, (m, m) [N/m].
        G: Grasp matrix (w, m); without rows for a fixed object.
        period: Period T [s].
        damping: Damping D, (m, m) [N s/m], or None.
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
    """Compute the smallest eigenvalue of diag(B_d, B_o) - L; if >= 0, friction dissipates all that the hold creates.

    The sign of the eigenvalue is meaningful even if the object can rotate; the magnitude then mixes units.

    Args:
        K, G, period: As for `leak_matrix`.
        damping: Damping B_d of the devices, a number, (m,) or (m, m) [N s/m].
        object_viscosity: Viscosity B_o, a number, (w,) or (w, w) [N s/m; N m s/rad for rotations].
        coupling_damping: Damping D of the coupling, (m, m) [N s/m], or None.
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
    """Compute H(z) at the devices of an object coupled by eq. (4), as (A, B, C, D), for example for `required_damping`.

    f = K e + D (e - e_{k-1})/T, e = x - G'q, M_o q'' + B_o q' = G f held over a sample, with states q, q', e_{k-1}. The
    result is exact for this object, while `leak_margin` is valid for every mass. Contacts are fixed in the object,
    whose rotation is small.

    Args:
        K, damping: Stiffness and damping, (m, m) [N/m], [N s/m].
        G: Grasp matrix (w, m) with independent rows.
        mass: Mass M_o, a number, (w,) or (w, w), positive definite [kg, kg m^2].
        viscosity: Viscosity B_o, a number, (w,) or (w, w) [N s/m, N m s/rad]; with zero viscosity, the display is not
            stable.
        period: Period T [s].
        integrator: Integrator of the object; "semi-implicit" moves with the new velocity, "explicit" with the old one.
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
            'use form="symmetric": on a fixed object an asymmetric one generates energy at any damping',
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
