"""Which gains of eq. (4) are passive at the devices: the leak of a held coupling against the dampings beside it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.analysis.arguments import number, one_of
from graspfx.analysis.passivity.display import symmetric
from graspfx.errors import InputError
from graspfx.exponential import expm1
from graspfx.numeric import SMALLEST, finite

FloatArray = NDArray[np.float64]
Integrator = Literal["explicit", "semi-implicit", "exact"]


@dataclass(frozen=True, eq=False)
class CouplingLimits:
    """Passive at the devices' ports, to every operator, for every mass of devices and object, if kip and kep are below.

    And only if: above `internal` always, above `external` for a heavy enough object where ked = 0.

    Attributes:
        internal: 2 (b - kid)/T, of the forces that squeeze [N/m]; infinity where no force is internal.
        external: min over modes of (2/T) (b B_i/(b + B_i) - ked), of those that move the object; infinity without any.
        modal_viscosity: B_i, eigenvalues of (G G')^-1/2 B_o (G G')^-1/2, rising [N s/m].
    """

    internal: float
    external: float
    modal_viscosity: FloatArray


def external_limit(damping: float, period: float, object_viscosity: float, *, coupling_damping: float = 0.0) -> float:
    """Compute k = (2/T) (b B/(b + B) - ked): a device and a viscous object on the two ends of a held spring [N/m].

    The leak of the spring, T/2 k per D^2/T of what it is stretched in a sample, is spread over two dampings in series.
    Passive at the device's port, to every operator, for every mass of device and object, if k is below; above it,
    without ked, a heavy enough object gives energy. It takes an object that moves exactly under a held force
    (integrator "exact"), and no lag.

    Args:
        damping: b of the device [N s/m].
        period: T [s].
        object_viscosity: B [N s/m]; infinity for an object that stands still.
        coupling_damping: ked, on the backward difference of e [N s/m].

    Returns:
        The largest stiffness, 0 if the damping alone leaks too much.
    """
    number("period", period, "s", zero=False)
    for name, value in (("damping", damping), ("object_viscosity", object_viscosity)):
        _damping_or_rigid(name, value)
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

    The leak matrix of K = kep P + kip (I - P) falls apart: squeezing moves no object, and in the frame (G G')^1/2 every
    external mode has the same kep on both sides. So the two limits do not depend on each other.

    Args:
        G: grasp matrix (w, m), rows of the object's free directions; dependent rows move nothing and are left out.
        damping: b of every device [N s/m].
        period: T [s].
        object_viscosity: B_o, one number for all, (w,) or symmetric (w, w) [N s/m; N m s/rad for rotations].
        external_damping, internal_damping: ked, kid, on backward differences of e [N s/m].

    Raises:
        InputError: shapes that do not fit, a negative damping, a period that is not positive.
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
    shape = left[:, significant] / sizes[significant]  # the columns of (G G')^-1/2 that count, up to a rotation
    viscosity = np.linalg.eigvalsh(shape.T @ Bo @ shape)
    external = (
        external_limit(damping, period, max(0.0, float(viscosity[0])), coupling_damping=external_damping)
        if len(viscosity)
        else math.inf
    )
    return CouplingLimits(internal if len(viscosity) < m else math.inf, external, viscosity)


def leak_matrix(K: ArrayLike, G: ArrayLike, period: float, *, damping: ArrayLike | None = None) -> FloatArray:
    """Compute L = [I; -G] (T/2 K + |D|) [I, -G'], (m + w, m + w) [N s/m]: the most that holding eq. (4) can create.

    On increments y = (Dx, Dq) of fingers and object a held force takes f_k'De = V_{k+1} - V_k - 1/2 De'K De, with
    De = Dx - G'Dq and V = 1/2 e'K e: it creates 1/2 De'K De = y'L y/T beyond what is stored. Damping on the backward
    difference, D (e_k - e_{k-1})/T, gives back up to De'|D| De/T at half the sampling rate. Frictions take at least
    y' diag(B_d, B_o) y/T. So the whole is passive, sample by sample, if diag(B_d, B_o) - L >= 0; without D also only
    if, for objects heavy enough.

    For a symmetric positive semidefinite K; without D, fingers that touch and let go without friction leak no more,
    because their force is the gradient of a convex energy no stiffer than K.

    Args:
        K: stiffness (m, m) [N/m]. D: damping (m, m) [N s/m] or None.
        G: grasp matrix (w, m); no rows for an object that stands still.
        period: T [s].
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
    """Compute the least eigenvalue of diag(B_d, B_o) - L: not negative iff frictions take all that holding can create.

    Its sign is the answer, also with rotations among the object's freedoms; its size mixes their units.

    Args:
        damping: B_d of the devices, one number, (m,) or (m, m) [N s/m].
        object_viscosity: B_o, one number, (w,) or (w, w).
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
    """Compute H(z) that devices feel from an object behind eq. (4), as (A, B, C, D) for `required_damping` and others.

    f = K e + D (e - e_{k-1})/T, e = x - G'q, M_o q'' + B_o q' = G f held over a sample; states q, q', e_{k-1}. Exact
    for this one object, where `leak_margin` holds for every mass. Contacts are fixed in the object, it turns little.

    Args:
        K, damping: (m, m) [N/m], [N s/m].
        G: (w, m), independent rows.
        mass: M_o, one number, (w,) or (w, w), positive definite.
        viscosity: B_o, one number, (w,) or (w, w); without any the display is not stable.
        integrator: of the object; "semi-implicit" moves by the new velocity, "explicit" by the old one.
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
    slows, pushes = np.linalg.solve(M, Bo), np.linalg.solve(M, G)
    zero, one = np.zeros((w, w)), np.eye(w)
    if integrator == "exact":
        flow = expm1(T * np.block([[zero, one, 0 * G], [zero, -slows, pushes], [np.zeros((m, 2 * w + m))]]))
        flow += np.eye(len(flow))
        move, push = flow[: 2 * w, : 2 * w], flow[: 2 * w, 2 * w :]
    else:
        speed = np.hstack([zero, one - T * slows])
        if integrator == "explicit":
            move, push = np.vstack([np.hstack([one, T * one]), speed]), np.vstack([0 * G, T * pushes])
        else:
            move = np.vstack([np.hstack([one, zero]) + T * speed, speed])
            push = np.vstack([T * T * pushes, T * pushes])
    stretch = np.hstack([-G.T, np.zeros((m, w))])  # e = x + stretch (q, q')
    C = np.hstack([(k + d / T) @ stretch, -d / T])
    D = k + d / T
    A = np.zeros((2 * w + m, 2 * w + m))
    A[: 2 * w, : 2 * w] = move
    A[: 2 * w] += push @ C
    A[2 * w :, : 2 * w] = stretch
    B = np.vstack([push @ D, np.eye(m)])
    if not d.any():  # then e_{k-1} is in no force
        A, B, C = A[: 2 * w, : 2 * w], B[: 2 * w], C[:, : 2 * w]
    return A, B, C, D


def _damping_or_rigid(name: str, argument: object) -> None:
    if not (isinstance(argument, float) and argument == math.inf):
        value = finite(name, argument, "a damping [N s/m], zero or above")
        if value.ndim or value < 0.0:
            raise InputError(name, argument, "a damping [N s/m], zero or above")


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
            'use form="symmetric": against a standing object an asymmetric one creates energy however damped',
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
