"""Random numbers over many decades, random contacts from 1 um to 1 km, collinear, coincident and far away."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def decades(rng: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def rotation(rng: np.random.Generator, d: int = 3) -> FloatArray:
    """A random rotation (d, d)."""
    Q, R = np.linalg.qr(rng.normal(size=(d, d)))
    Q = Q * np.sign(np.diag(R))
    if np.linalg.det(Q) < 0.0:
        Q[:, 0] = -Q[:, 0]
    return np.asarray(Q)


@dataclass(frozen=True)
class ContactSet:
    """Contacts (n, d) [m] and how they were made."""

    points: FloatArray
    label: str


def contact_set(rng: np.random.Generator, d: int | None = None, most: int = 100) -> ContactSet:
    """1 to `most` contacts in d dimensions; a third of the sets nearly on a line, some with fingers in one place."""
    d = int(rng.integers(1, 4)) if d is None else d
    n = round(decades(rng, 1.0, most))
    size, away = decades(rng, 1e-6, 1e3), decades(rng, 1e-6, 1e3) * (rng.random() < 0.5)
    h = decades(rng, 1e-9, 1.0) if rng.random() < 0.5 else 1.0
    points = rng.normal(size=(n, d))
    points[:, 1:] *= h
    points = size * points @ rotation(rng, d).T + away * rng.normal(size=d)
    kind = "apart"
    if n > 1 and rng.random() < 0.2:
        kind = "two in one place"
        points[1] = points[0]
    if rng.random() < 0.05:
        kind = "all in one place"
        points[:] = points[0]
    return ContactSet(points, f"{n} fingers in {d}-D, {size:.1e} m, {away:.1e} m away, flat to {h:.1e}, {kind}")


def positive(rng: np.random.Generator, *shape: int) -> FloatArray:
    x = rng.normal(size=shape)
    return np.asarray(10.0 * x @ np.swapaxes(x, -1, -2) + 20.0 * np.eye(shape[-1]))
