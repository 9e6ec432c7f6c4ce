"""The name of a grasp's mode, from how the fingers swing against their object."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def mode_name(
    swing: NDArray[np.complex128],
    arms: FloatArray,
    free: Sequence[bool],
    touching: NDArray[np.bool_],
    names: Sequence[str],
    gains: tuple[float, float] = (1.0, 1.0),
) -> str:
    """Name the part of a swing with most energy: internal, external translation or rotation; or who pushes alone.

    The split is eq. (3) of hard fingers, the best fit of a motion of the free object to the swing of those that touch.

    Args:
        swing: amplitudes of e = p - c, (n, d).
        arms: of the fingers from the object's centre (n, d) [m].
        free: which of the object's freedoms move (w,).
        touching: (n,).
        names: of the fingers.
        gains: kep and kip, by which parts are weighed.

    Returns:
        A name as certificates have it.
    """
    if not touching.any():
        touching = np.ones_like(touching)
    elif not touching.all():
        return f"pushing with {', '.join(name for name, on in zip(names, touching, strict=True) if on)}"
    n, d = arms.shape
    shifts = np.tile(np.eye(d), (n, 1))[:, np.array(free[:d], dtype=bool)]
    turns = _turns(arms)[:, np.array(free[d:], dtype=bool)]
    x = swing.ravel()
    shift = _fit(shifts, x)
    external = _fit(np.hstack([shifts, turns]), x)
    kep, kip = gains
    energies = {
        "external translation" if d > 1 and turns.shape[1] else "external": kep * _square(shift),
        "external rotation": kep * _square(external - shift),
        "internal": kip * _square(x - external),
    }
    return max(energies, key=lambda name: energies[name])


def _turns(arms: FloatArray) -> FloatArray:
    """Compute how fingers move as the object turns, (n d, 0), (n d, 1) or (n d, 3)."""
    n, d = arms.shape
    if d == 1:
        return np.zeros((n, 0))
    if d == 2:
        return np.stack([-arms[:, 1], arms[:, 0]], axis=1).reshape(n * d, 1)
    return np.stack([np.cross(axis, arms).ravel() for axis in np.eye(3)], axis=1)


def _fit(basis: FloatArray, x: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Fit the nearest combination of columns."""
    if not basis.shape[1]:
        return np.zeros_like(x)
    return np.asarray(basis @ np.linalg.lstsq(basis, x, rcond=None)[0], dtype=np.complex128)


def _square(x: NDArray[np.complex128]) -> float:
    return float((np.abs(x) ** 2).sum())
