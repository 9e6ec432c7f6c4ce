"""Sets of contacts on which eq. (4) is compared: how many fingers, how near to a line, how far from the origin."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

RADIUS = 0.05  # of a grasp [m]
REACH = 0.003  # of the displacements [m]
TOLERANCE = 1e-6  # of the radius: contacts nearer to a line turn about it by no force
FINE = 1e-12  # the same where contacts near a line are what is compared


@dataclass(frozen=True)
class ContactSet:
    """Points (N, n, 3) [m] and displacements (N, n, 3) [m] of N grasps of a kind, and how near a line counts as one."""

    name: str
    points: FloatArray
    displacements: FloatArray
    tolerance: float = TOLERANCE


def contact_sets(quick: bool) -> Iterator[ContactSet]:
    """Draw every kind, seeded."""
    rng = np.random.default_rng(4)
    N = 8 if quick else 16
    for n in (2, 5, 20) if quick else (2, 3, 5, 10, 20, 100):
        yield _set(rng, f"{n} fingers", RADIUS * _directions(rng, N, n))
    for power in (3, 9) if quick else range(1, 10):
        yield _set(rng, f"5 fingers, condition 1e{power}", _near_line(rng, N, 10.0**-power), FINE)
    far = 1000.0 * _directions(rng, N, 1)
    yield _set(rng, "5 fingers, 1 km from the origin", far + RADIUS * _directions(rng, N, 5))
    line = RADIUS * _directions(rng, N, 1) * np.linspace(-1.0, 1.0, 5)[:, None]
    yield _set(rng, "5 fingers on a line (rank 5)", line)
    yield _set(rng, "5 fingers at a point (rank 3)", np.repeat(RADIUS * _directions(rng, N, 1), 5, axis=1))
    yield _set(rng, "5 fingers on a line, 1 km away (rank 5)", far + line)


def _set(rng: np.random.Generator, name: str, points: FloatArray, tolerance: float = TOLERANCE) -> ContactSet:
    return ContactSet(name, points, REACH * rng.normal(size=points.shape), tolerance)


def _directions(rng: np.random.Generator, N: int, n: int) -> FloatArray:
    x = rng.normal(size=(N, n, 3))
    return np.asarray(x / np.linalg.norm(x, axis=2, keepdims=True))


def _near_line(rng: np.random.Generator, N: int, h: float) -> FloatArray:
    """Place five points whose distances from a line through the origin are h times those along it."""
    axes = np.linalg.qr(rng.normal(size=(N, 3, 3)))[0]
    along = np.linspace(-1.0, 1.0, 5) + 0.1 * rng.normal(size=(N, 5))
    local = np.concatenate([along[:, :, None], h * rng.normal(size=(N, 5, 2))], axis=2)
    return np.asarray(RADIUS * local @ axes.transpose(0, 2, 1))
