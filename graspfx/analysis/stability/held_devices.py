"""Devices and the hands that hold them, moved exactly while forces are held."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.linearisation import Linearisation
from graspfx.exponential import expm1

FloatArray = NDArray[np.float64]


def held_devices(linear: Linearisation, duration: float | None = None) -> tuple[FloatArray, FloatArray]:
    """Map (x, x') and forces held on the devices to (x, x') after T: (2 m, 2 m), (2 m, m).

    Args:
        linear: the grasp.
        duration: in place of T [s].
    """
    m, T = len(linear.mass), linear.period if duration is None else duration
    K, B = linear.hand_stiffness, linear.hand_damping
    if not (K - np.diag(np.diag(K))).any() and not (B - np.diag(np.diag(B))).any():
        return _apart(linear, T)
    per_mass = 1.0 / linear.mass[:, None]
    E = advance(per_mass * K, per_mass * (np.diag(linear.friction) + B), per_mass * np.eye(m), T)
    return E[:, : 2 * m], E[:, 2 * m :]


def advance(stiffness: FloatArray, damping: FloatArray, push: FloatArray, T: float) -> FloatArray:
    """Map (x, x', F) to (x, x') after T under x'' = -stiffness x - damping x' + push F, (2 m, 3 m)."""
    m = len(push)
    A = np.zeros((3 * m, 3 * m))
    A[:m, m : 2 * m] = np.eye(m)  # in s = t/T, for x and T x'
    A[m : 2 * m, :m] = -T * T * stiffness
    A[m : 2 * m, m : 2 * m] = -T * damping
    A[m : 2 * m, 2 * m :] = T * T * push
    E = expm1(A)[: 2 * m]
    np.einsum("ii->i", E[:, : 2 * m])[:] += 1.0
    E[:m, m : 2 * m] *= T
    E[m:] /= T
    E[m:, m : 2 * m] *= T
    return E


def _apart(linear: Linearisation, T: float) -> tuple[FloatArray, FloatArray]:
    """Compute `held_devices` of coordinates that hands do not couple: each is alone."""
    m = len(linear.mass)
    rows = zip(linear.mass, linear.friction, np.diag(linear.hand_stiffness), np.diag(linear.hand_damping), strict=True)
    E = np.zeros((2, m, 3, m))
    i = np.arange(m)
    E[:, i, :, i] = [_advance_alone(float(k / mass), float((b + B) / mass), float(1.0 / mass), T)
                     for mass, b, k, B in rows]  # fmt: skip
    wide = E.reshape(2 * m, 3 * m)
    return wide[:, : 2 * m], wide[:, 2 * m :]


@lru_cache(maxsize=256)
def _advance_alone(stiffness: float, damping: float, push: float, T: float) -> FloatArray:
    """Compute `advance` of one coordinate; alike ones are many."""
    one = np.ones((1, 1))
    return advance(stiffness * one, damping * one, push * one, T)
