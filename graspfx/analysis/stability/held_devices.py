"""Devices and the hands that hold them, moved exactly while forces are held."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.linearisation import Linearisation
from graspfx.analysis.operator_matrices import OperatorMatrices
from graspfx.exponential import expm1

FloatArray = NDArray[np.float64]


def held_devices(linear: Linearisation, duration: float | None = None) -> tuple[FloatArray, FloatArray]:
    """Map (x, x') and forces held on the devices to (x, x') after T: (2 m, 2 m), (2 m, m).

    With limbs y, (x, x', y, y'): (2 m + 2 l, 2 m + 2 l), (2 m + 2 l, m).

    Args:
        linear: the grasp.
        duration: in place of T [s].
    """
    m, T = len(linear.mass), linear.period if duration is None else duration
    K, B = linear.hand_stiffness, linear.hand_damping
    if linear.operator is not None and linear.operator.limbs:
        E = _with_limbs(linear, linear.operator, T)
        states = len(E)
        return E[:, :states], E[:, states : states + m]
    if linear.operator is not None:
        B = B + linear.operator.friction
        linear = linear.with_arrays(hand_damping=B)
    if not (K - np.diag(np.diag(K))).any() and not (B - np.diag(np.diag(B))).any():
        return _apart(linear, T)
    per_mass = 1.0 / linear.mass[:, None]
    E = advance(per_mass * K, per_mass * (np.diag(linear.friction) + B), per_mass * np.eye(m), T)
    return E[:, : 2 * m], E[:, 2 * m :]


def held_limbs(linear: Linearisation) -> FloatArray:
    """Map forces held on limbs to (x, x', y, y') after T, (2 m + 2 l, l)."""
    if linear.operator is None or not linear.operator.limbs:
        return np.zeros((2 * len(linear.mass), 0))
    E = _with_limbs(linear, linear.operator, linear.period)
    return E[:, len(E) + len(linear.mass) :]


def _with_limbs(linear: Linearisation, operator: OperatorMatrices, T: float) -> FloatArray:
    """Map (x, x', y, y') and forces held on devices and limbs to (x, x', y, y') after T."""
    m, limbs = operator.limb.shape
    S, tip, damper = operator.limb, linear.hand_stiffness, linear.hand_damping
    push = np.zeros((m + limbs, m + limbs))
    push[:m, :m], push[m:, m:] = np.diag(1.0 / linear.mass), np.linalg.inv(operator.limb_mass)
    K = np.block([[tip, -tip @ S], [-S.T @ tip, S.T @ tip @ S + operator.limb_stiffness]])
    B = np.block([[damper, -damper @ S], [-S.T @ damper, S.T @ damper @ S + operator.limb_damping]])
    B[:m, :m] += np.diag(linear.friction) + operator.friction
    E = advance(push @ K, push @ B, push, T)
    at = np.arange(3 * (m + limbs)).reshape(3, m + limbs)
    order = np.concatenate([at[0, :m], at[1, :m], at[0, m:], at[1, m:]])
    return np.asarray(E[np.ix_(order, np.concatenate([order, at[2]]))])


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
