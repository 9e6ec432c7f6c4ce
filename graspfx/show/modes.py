"""Signed modes of a grasp over time: what squeezes the object, and what moves it, as a figure shows them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

SMALL = 1e-9  # [m]: contacts this near to their middle have no direction towards it


class Modes(NamedTuple):
    """Internal and external part of forces, or of displacements, as signed numbers.

    Attributes:
        squeeze: of each finger, its internal part towards the middle of the contacts (N, n); NaN where it is free, or
            where nobody else touches. That of two fingers is the one of Kawai and Yoshikawa's eqs. (16) and (19),
            (e_1 - e_2)/2 along the line from finger 1 to finger 2, and the same for both.
        push: mean of the touching fingers' external parts (N, d), as in eqs. (13) and (15); NaN where none touches.
    """

    squeeze: FloatArray
    push: FloatArray

    @property
    def mean_squeeze(self) -> FloatArray:
        """Mean of the touching fingers, (N,)."""
        return mean(self.squeeze, np.isfinite(self.squeeze))


def modes(internal: FloatArray, external: FloatArray, inward: FloatArray, touching: BoolArray) -> Modes:
    """Read signed modes from vectors.

    Args:
        internal: parts of forces on the object, or of displacements (N, n, d).
        external: the other parts (N, n, d).
        inward: unit vectors (N, n, d), from `directions`.
        touching: (N, n).
    """
    grasped = touching & (touching.sum(axis=1, keepdims=True) > 1)
    squeeze = np.where(grasped, (internal * inward).sum(axis=2), np.nan)
    return Modes(squeeze, mean(external, touching[:, :, None]))


def directions(contacts: FloatArray, displacement: FloatArray) -> FloatArray:
    """Point from each contact to the middle of all, unit vectors (N, n, d).

    Where contacts are all at one point, as those attached to an object's centre: two fingers point along the axis on
    which they are farthest from one another on the whole, so that they squeeze where finger 1 has gone in from below,
    and others have no direction.

    Args:
        contacts: where fingers touch (N, n, d) [m].
        displacement: of each finger from there (N, n, d) [m].
    """
    n = contacts.shape[1]
    away = contacts.mean(axis=1, keepdims=True) - contacts
    lengths = np.linalg.norm(away, axis=2, keepdims=True)
    inward: FloatArray = np.where(lengths > SMALL, away / np.where(lengths > SMALL, lengths, 1.0), 0.0)
    if n == 2:
        apart = displacement[:, 0] - displacement[:, 1]
        axis = int(np.nanargmax(np.nanmax(np.abs(apart), axis=0, initial=0.0)))
        flat = (lengths <= SMALL).all(axis=1)[:, 0]
        inward[flat] = np.eye(contacts.shape[2])[axis] * np.array([[1.0], [-1.0]])
    return inward


def mean(values: FloatArray, counted: BoolArray) -> FloatArray:
    """Average over axis 1 what counts; NaN where nothing does."""
    number = counted.sum(axis=1)
    total = np.where(counted, values, 0.0).sum(axis=1)
    return np.asarray(np.where(number > 0, total / np.maximum(number, 1), np.nan))
