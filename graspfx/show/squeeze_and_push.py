"""Squeeze and push: internal and external parts of a grasp as signed numbers, for figures."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

SMALL = 1e-9  # distance from the contacts' centre below which a contact has no direction towards it [m]


class Modes(NamedTuple):
    """Internal and external parts of forces or displacements of n fingers in N ticks, as signed numbers.

    Attributes:
        squeeze: Component of each finger's internal part towards the centre of the contacts (N, n). The squeeze is NaN
            for a free finger and while fewer than two fingers touch. For two fingers with forces or displacements e_1
            and e_2, it is the component of (e_1 - e_2)/2 along the line from finger 1 to finger 2, equal for both
            fingers (Kawai and Yoshikawa, eqs. (16) and (19)).
        push: Mean of the touching fingers' external parts (N, d) (Kawai and Yoshikawa, eqs. (13) and (15)); NaN while
            no finger touches.
    """

    squeeze: FloatArray
    push: FloatArray

    @property
    def mean_squeeze(self) -> FloatArray:
        """Mean of the squeeze over the touching fingers (N,)."""
        return mean(self.squeeze, np.isfinite(self.squeeze))


def modes(internal: FloatArray, external: FloatArray, inward: FloatArray, touching: BoolArray) -> Modes:
    """Compute squeeze and push from internal and external parts.

    Args:
        internal: Internal parts of forces on the object, or of displacements (N, n, d).
        external: External parts of the forces or displacements (N, n, d).
        inward: Unit vectors from each contact to the centre of all contacts (N, n, d), computed by `directions`.
        touching: Mask of touching fingers (N, n).
    """
    grasped = touching & (touching.sum(axis=1, keepdims=True) > 1)
    squeeze = np.where(grasped, (internal * inward).sum(axis=2), np.nan)
    return Modes(squeeze, mean(external, touching[:, :, None]))


def directions(contacts: FloatArray, displacement: FloatArray) -> FloatArray:
    """Compute unit vectors (N, n, d) from each contact to the centre of all contacts.

    If all contacts coincide, for example because all fingers are attached to the object's centre, the vectors do not
    exist.
    For two fingers, they are then replaced by the coordinate axis along which the fingers' displacements differ most
    during the run: finger 1 has the positive direction of this axis, finger 2 the negative. For more fingers, they are
    zero.

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
    """Average the values that the mask `counted` selects over axis 1; the mean is NaN where none is selected."""
    number = counted.sum(axis=1)
    total = np.where(counted, values, 0.0).sum(axis=1)
    return np.asarray(np.where(number > 0, total / np.maximum(number, 1), np.nan))
