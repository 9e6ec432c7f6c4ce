"""The virtual linkage: internal forces as tensions of actuators between contacts and torques of the joints there."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.errors import InputError
from graspfx.grasp.matrix import GraspMatrix
from graspfx.grasp.quality.internal import InternalCoordinates, internal_coordinates
from graspfx.grasp.split import fraction
from graspfx.numeric import finite

FloatArray = NDArray[np.float64]


class VirtualLinkage:
    """f = P f + (I - P) f of a linkage with a spherical joint at each contact and actuators between them.

    A wrench is made by forces alone, f_F = W_F^+ w, and the contacts' moments are torques of the joints, internal
    (Williams and Khatib 1993): with G = [W_F W_T], forces and moments apart,

        P = [W_F^+ (I - W_T H); H] G,    H = (N' W_T)^+ N',    N' W_F = 0,

    where H is zero unless some wrench cannot be made by forces (two contacts cannot turn the object about their line):
    that one alone is left to the moments. Internal are E t, and tau - W_F^+ W_T tau, with tensions t = E^+ f_F of the
    actuators, E a column [.. u_ij .. -u_ij ..] each, and torques tau of the joints.

    Without moments P = G^+ G: for frictionless and hard contacts this is the split of `grasp.split.Split` without a
    metric, whatever actuators are chosen, because E spans the null space of G and W_F^+ is orthogonal to it. With
    moments it is the limit of that split as the torsion length goes to zero, approached with the square of that length
    over the contacts' radius. It needs no torsion length and does not depend on the unit of length; P is then no
    symmetric matrix, so that it is meant for analysis, not for a coupling.

    A linkage of actuators alone exists unless contacts lie on a line, or four or more in a plane in space, where
    `coordinates` completes it with bendings.

    Args:
        grasp: the contacts.
        actuators: pairs of fingers counted from 0; chosen well if None.
        tolerance: as that of `Split`.

    Attributes:
        rank: of G.

    Raises:
        InputError: a tolerance outside [0, 1).
    """

    def __init__(
        self, grasp: GraspMatrix, *, actuators: Sequence[tuple[int, int]] | None = None, tolerance: float = 1e-6
    ) -> None:
        tolerance = fraction("tolerance", tolerance)
        self.grasp, self.actuators = grasp, actuators
        self.components = len(grasp.finger_of_column)
        A, size = grasp.unit_free()
        forces = ~grasp.torsion_columns
        least = max(tolerance * np.sqrt(grasp.fingers), max(A.shape) * np.finfo(float).eps)
        U, values, V = np.linalg.svd(A[:, forces])
        r = int((values > least).sum())
        E = np.zeros((self.components, len(A)))  # contact forces of a wrench
        E[forces] = (V[:r].T / values[:r]) @ U[:, :r].T
        unheld = U[:, r:].T @ A[:, ~forces]
        H = np.zeros((unheld.shape[1], len(A)))
        rest = 0
        if unheld.size:
            left, singular, right = np.linalg.svd(unheld, full_matrices=False)
            rest = int((singular > least).sum())
            H = (right[:rest].T / singular[:rest]) @ left[:, :rest].T @ U[:, r:].T
            E[forces] -= E[forces] @ A[:, ~forces] @ H
            E[~forces] = H
        self.rank = r + rest
        units = np.where(grasp.torsion_columns, size, 1.0)
        self._distribute, self._gather = units[:, None] * E, A / units

    @cached_property
    def external(self) -> FloatArray:
        """P on forces, (m, m)."""
        return self._distribute @ self._gather

    @cached_property
    def internal(self) -> FloatArray:
        """I - P on forces, (m, m)."""
        return np.eye(self.components) - self.external

    def divide(self, force: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Divide contact forces (m,) or (..., m) into external and internal parts; their sum is the force."""
        f = finite("force", force)
        if f.shape[-1:] != (self.components,):
            raise InputError("force", f, f"an array whose last axis has the {self.components} contact components")
        external = f @ self._gather.T @ self._distribute.T
        return external, f - external

    @cached_property
    def coordinates(self) -> InternalCoordinates:
        """Tensions of the actuators, positive where they draw fingers together [N], and torques of the joints [N m].

        Raises:
            InputError: actuators that do not fit, depend on one another or leave some tension out.
        """
        return self.internal_coordinates()

    def internal_coordinates(self, names: Sequence[str] | None = None) -> InternalCoordinates:
        """Give internal forces as named coordinates, with names for the fingers."""
        return internal_coordinates(self.grasp, self, self.rank, names, self.actuators)
