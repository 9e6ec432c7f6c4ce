"""Virtual linkage: internal forces as tensions of actuators between contacts and torques of joints at contacts."""

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
    """Split f = P f + (I - P) f of a linkage with a spherical joint at each contact and actuators between contacts.

    Only forces exert a wrench, f_F = W_F^+ w. The contacts' moments are joint torques and therefore internal (Williams
    and Khatib 1993). With G = [W_F W_T], the columns of forces and of moments,

        P = [W_F^+ (I - W_T H); H] G,    H = (N' W_T)^+ N',    N' W_F = 0,

    H is zero unless forces cannot exert some wrench (two contacts cannot rotate the object about the line through
    them). The moments then exert only that wrench. The internal forces are E t and tau - W_F^+ W_T tau. t = E^+ f_F are
    the tensions of the actuators, each a column [.. u_ij .. -u_ij ..] of E, and tau the torques of the joints.

    Without moments P = G^+ G. For frictionless and hard contacts this is the split of `grasp.split.Split` without a
    metric, for any choice of actuators, because E spans the null space of G and W_F^+ is orthogonal to it. With moments
    the linkage's split is the limit of that split as the torsion length goes to zero; the difference is proportional to
    (torsion length / contacts' radius)^2. The linkage needs no torsion length and does not depend on the unit of
    length. P is then not symmetric: use it for analysis, not for a coupling.

    Actuators alone form a linkage unless the contacts lie on a line, or four or more lie in a plane in space. In these
    cases `coordinates` adds bendings.

    Args:
        grasp: Contacts.
        actuators: Pairs of fingers, counted from 0; a well-conditioned choice if None.
        tolerance: Relative tolerance of the rank, as for `Split`.

    Attributes:
        rank: Rank of G.

    Raises:
        InputError: If the tolerance is outside [0, 1).
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
        E = np.zeros((self.components, len(A)))  # contact forces that make a wrench
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
        """Projector P on forces, (m, m)."""
        return self._distribute @ self._gather

    @cached_property
    def internal(self) -> FloatArray:
        """Projector I - P on forces, (m, m)."""
        return np.eye(self.components) - self.external

    def divide(self, force: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Divide contact forces (m,) or (..., m) into external and internal parts, whose sum is the force."""
        f = finite("force", force)
        if f.shape[-1:] != (self.components,):
            raise InputError("force", f, f"an array whose last axis has the {self.components} contact components")
        external = f @ self._gather.T @ self._distribute.T
        return external, f - external

    @cached_property
    def coordinates(self) -> InternalCoordinates:
        """Tensions of the actuators [N], positive if they pull the fingers together, and torques of the joints [N m].

        Raises:
            InputError: If the actuators are invalid, or their tensions are dependent or incomplete.
        """
        return self.internal_coordinates()

    def internal_coordinates(self, names: Sequence[str] | None = None) -> InternalCoordinates:
        """Return the named coordinates of the internal forces; `names` are those of the fingers."""
        return internal_coordinates(self.grasp, self, self.rank, names, self.actuators)
