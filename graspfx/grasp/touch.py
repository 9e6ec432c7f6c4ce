"""Touching and letting go for a given stiffness: eqs. (24)-(26) as a projection, for n fingers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.errors import InputError
from graspfx.grasp.kernels import complement, contact_frame, release, settle

FloatArray = NDArray[np.float64]
Status = Literal["free", "stick", "slide"]


@dataclass(frozen=True)
class Touch:
    """What the fingers do to the object.

    Attributes:
        force: f, (m,) on the object [N].
        status: per finger "free" (no force), "stick" (held in every direction) or "slide" (pushes along the normal).
        residual: the largest violation of f = K (e + s), f_n >= 0, s_n >= 0, f_n s_n = 0, from the answer [N].
    """

    force: FloatArray
    status: tuple[Status, ...]
    residual: float


def unilateral_force(
    stiffness: ArrayLike,
    displacement: ArrayLike,
    normals: ArrayLike,
    friction: float | Sequence[float] | Literal["stick"] | None = None,
) -> Touch:
    """Fingertip forces that only push: f in C, s in C*, f's = 0, f = K (e + s).

    C is {lambda n, lambda >= 0} per finger without friction; with "stick" a finger holds in every direction while it
    pushes and is released whole where its normal force would pull. For two opposed fingers this is the rule of Kawai
    and Yoshikawa, eqs. (24)-(26): finger i touches inside x_ci of (25), and alone it feels 2 kep kip/(kep + kip). For a
    symmetric K it is the projection argmin over f in C of 1/2 (f - K e)' K^-1 (f - K e); K may be singular.

    Args:
        stiffness: K, (m, m) [N/m], m = n d; its symmetric part positive semidefinite.
        displacement: e = p - c, (m,) [m].
        normals: (n, d), into the object; scaled to unit length.
        friction: None or 0 (normal forces only) or "stick".

    Raises:
        InputError: shapes that do not fit, values that are not finite, a friction coefficient.
    """
    n_ = np.asarray(normals, dtype=float)
    if n_.ndim != 2 or n_.shape[1] not in (1, 2, 3) or n_.shape[0] == 0:
        raise InputError("normals", n_, "an array (n, d) with d = 1, 2 or 3")
    n, d = n_.shape
    m = n * d
    K = np.asarray(stiffness, dtype=float)
    e = np.asarray(displacement, dtype=float)
    if K.shape != (m, m):
        raise InputError("stiffness", K, f"an array ({m}, {m}) for {n} fingers in {d} dimensions")
    if e.shape != (m,):
        raise InputError("displacement", e, f"an array ({m},)")
    if not (np.isfinite(K).all() and np.isfinite(e).all() and np.isfinite(n_).all()):
        raise InputError("stiffness, displacement, normals", "NaN or infinity", "finite numbers")
    lengths = np.linalg.norm(n_, axis=1)
    if not lengths.all():
        raise InputError("normals", f"a normal of length zero for finger {int(np.argmin(lengths))}", "directions")
    if np.linalg.eigvalsh(0.5 * (K + K.T))[0] < -1e-9 * np.abs(K).max(initial=0.0):
        raise InputError("stiffness", "a symmetric part with a negative eigenvalue", "a matrix that only pushes back")
    stick = friction == "stick"
    if not stick and friction is not None and np.any(np.asarray(friction, dtype=float) != 0.0):
        raise InputError("friction", friction, "None, 0 or 'stick'", "a coefficient is not supported")

    # One buffer: normal and frame per finger, the square, the vector, its diagonal, the displacement, marks, states.
    frames, square = 3 * n, 3 * n + 9 * n
    vector = square + m * m
    diagonal, displaced, marks, state = (vector + k * m for k in range(1, 5))
    block = np.zeros(state + n)
    S = memoryview(block)
    block[: 3 * n].reshape(n, 3)[:, :d] = n_ / lengths[:, None]
    F = np.zeros((m, m))
    for i in range(n):
        contact_frame(S, 3 * i, d, frames + 9 * i)
        F[i * d : (i + 1) * d, i * d : (i + 1) * d] = block[frames + 9 * i : frames + 9 * i + 9].reshape(3, 3)[:d, :d]
    K_f, e_f = F @ K @ F.T, F @ e
    block[displaced:marks] = e_f

    def attempt(back: bool) -> int:
        block[square:vector] = K_f.ravel()
        block[vector:diagonal] = K_f @ e_f
        block[diagonal:displaced] = K_f.diagonal()
        block[state:] = 1.0
        if not stick:
            block[marks:state] = np.arange(m) % d > 0
            release(S, square, m, vector, m, m, marks, diagonal)
        scale = float(np.abs(block[vector:diagonal]).max())
        return complement(S, square, m, vector, m, n, d, stick, back, state, diagonal, scale)

    unresolved = attempt(True)
    if unresolved and stick:
        unresolved = attempt(False)
    if unresolved:
        raise InputError("stiffness", K, "a matrix for which the contact forces are unique")
    settle(S, square, m, vector, displaced, n, d, stick, state)
    f = block[vector:diagonal].reshape(n, d)
    pushes = f[:, 0] > 0.0
    status: tuple[Status, ...] = tuple("free" if not p else "stick" if stick else "slide" for p in pushes)
    return Touch(F.T @ f.ravel(), status, residual(K_f, e_f, f, stick))


def residual(K: FloatArray, e: FloatArray, f: FloatArray, stick: bool) -> float:
    """How far f (n, d), in contact frames, is from f = K (e + s) with s where a force is released, as a force [N]."""
    n, d = f.shape
    held = np.zeros((n, d), dtype=bool)
    held[f[:, 0] > 0.0, : d if stick else 1] = True
    free = ~held.ravel()
    s = np.zeros(n * d)
    if free.any():
        s[free] = np.linalg.lstsq(K[np.ix_(free, free)], -(K @ e)[free], rcond=None)[0]
    gap = np.abs(K @ (e + s) - f.ravel()).max()
    if stick:
        return float(gap)
    pull = np.maximum(-s.reshape(n, d)[:, 0], 0.0) * np.diag(K).reshape(n, d)[:, 0]
    return float(max(gap, pull.max()))
