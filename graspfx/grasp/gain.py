"""Checks, formatting and rotation of an impedance's gains: numbers, numbers per finger, or matrices."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.card import span
from graspfx.errors import InputError
from graspfx.numeric import finite

FloatArray = NDArray[np.float64]
Gain = float | FloatArray

SYMMETRIC = 1e-9  # relative asymmetry up to which a matrix counts as symmetric


def turned_gain(gain: Gain, R: FloatArray) -> Gain:
    """Rotate a matrix gain to R K R'; for a full matrix, R is the block-diagonal matrix of the fingers' rotations."""
    K, d = np.asarray(gain), R.shape[-1]
    if K.ndim < 2:
        return gain
    if K.ndim == 2 and K.shape != (d, d):
        R = block_diagonal(R, K.shape[0] // d)
    return even(R @ K @ np.swapaxes(R, -1, -2))


def block_diagonal(blocks: FloatArray, n: int) -> FloatArray:
    """Assemble one matrix (d, d) for all fingers, or n matrices (n, d, d), into a block-diagonal matrix (n d, n d)."""
    d = blocks.shape[-1]
    whole = np.zeros((n * d, n * d))
    whole.reshape(n, d, n, d)[np.arange(n), :, np.arange(n), :] = blocks
    return whole


def even(K: FloatArray) -> FloatArray:
    """Remove the skew part that rounding adds to a symmetric matrix."""
    return np.asarray(0.5 * (K + np.swapaxes(K, -1, -2)))


def checked_gain(name: str, argument: ArrayLike) -> Gain:
    """Check a gain, and copy it.

    Raises:
        InputError: If a number is negative or not finite, a matrix is not symmetric positive semidefinite, or the shape
            is wrong.
    """
    value = finite(name, argument)
    if value.ndim == 0:
        if value < 0.0:
            raise InputError(name, float(value), "a number that is not negative")
        return float(value)
    if value.ndim == 1:
        if not len(value) or (value < 0.0).any():
            raise InputError(name, value.tolist(), "numbers that are not negative, one per finger")
    elif value.ndim > 3 or value.shape[-1] != value.shape[-2] or not value.size:
        raise InputError(name, value, "a number, or an array (n,), (d, d), (n, d, d) or (m, m)")
    else:
        size = np.abs(value).max()
        if np.abs(value - np.swapaxes(value, -1, -2)).max() > SYMMETRIC * size:
            raise InputError(name, value.tolist(), "a symmetric matrix")
        lowest = np.linalg.eigvalsh(value).min()
        if lowest < -SYMMETRIC * size:
            raise InputError(
                name, value.tolist(), "a positive semidefinite matrix", f"its smallest eigenvalue is {lowest:.3g}"
            )
    value.setflags(write=False)
    return value


def gain_text(gain: Gain, unit: str) -> str:
    """Format a gain: the number, the range over the fingers, or a matrix's shape and range of eigenvalues."""
    if isinstance(gain, float):
        return f"{gain:g} {unit}"
    if gain.ndim == 1:
        return f"{span(gain, unit)} for {len(gain)} fingers"
    return f"{' x '.join(map(str, gain.shape))} matrix of {span(np.linalg.eigvalsh(gain).ravel(), unit)}"


def equal_gains(outer: Gain, inner: Gain) -> bool:
    """Return whether two gains are equal, even if one is given for all fingers and the other per finger."""
    a, b = np.asarray(outer), np.asarray(inner)
    if a.ndim == b.ndim:
        return np.array_equal(a, b)
    if {a.ndim, b.ndim} not in ({0, 1}, {2, 3}) or (a.ndim and b.ndim and a.shape[-2:] != b.shape[-2:]):
        return False
    return bool((a == b).all())
