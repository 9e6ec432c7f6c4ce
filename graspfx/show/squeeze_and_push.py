"""Signed modes of a grasp over time, for figures: squeeze and push."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

SMALL = 1e-9  # distance from the contacts' centre below which a contact has no direction towards it [m]


class Modes(NamedTuple):
    """Internal and external part of forces or displacements as signed numbers.

    Attributes:
        squeeze: Internal part of each finger towards the centre of the contacts (N, n); NaN for a free finger, or if no
            other finger touches. For two fingers the squeeze is that of Kawai and Yoshikawa's eqs. (16) and (19),
            (e_1 - e_2)/2 along the line from finger 1 to finger 2, which is equal for both fingers.
        push: Mean of the touching fingers' external parts (N, d), as in eqs. (13) and (15); NaN if none touches.
    """

    squeeze: FloatArray
    push: FloatArray

    @property
    def mean_squeeze(self) -> FloatArray:
        """Mean squeeze of the touching fingers, (N,)."""
        return mean(self.squeeze, np.isfinite(self.squeeze))


def modes(internal: FloatArray, external: FloatArray, inward: FloatArray, touching: BoolArray) -> Modes:
    """Compute signed modes from vectors.

    Args:
        internal: Internal parts of forces on the object, or of displacements (N, n, d).
        external: External parts (N, n, d).
        inward: Unit vectors (N, n, d), from `directions`.
        touching: Mask of touching fingers (N, n).
    """
    grasped = touching & (touching.sum(axis=1, keepdims=True) > 1)
    squeeze = np.where(grasped, (internal * inward).sum(axis=2), np.nan)
    return Modes(squeeze, mean(external, touching[:, :, None]))


def directions(contacts: FloatArray, displacement: FloatArray) -> FloatArray:
    """Compute unit vectors (N, n, d) from each contact to the centre of all contacts.

    If all contacts coincide, such as contacts attached to an object's centre, two fingers get the coordinate axis along
    which their displacements differ most during the run; a squeeze is then positive if finger 1 pushes along this axis.
    More fingers get no direction.

    Args:
        contacts: Contact points (N, n, d) [m].
        displacement: Displacement of each finger from its contact (N, n, d) [m].
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
    """Average the counted values over axis 1; NaN if there are none."""
    number = counted.sum(axis=1)
    total = np.where(counted, values, 0.0).sum(axis=1)
    return np.asarray(np.where(number > 0, total / np.maximum(number, 1), np.nan))
