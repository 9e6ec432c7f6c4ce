"""Singular values of the grasp matrix in comparable units, as measures of how well contact forces exert wrenches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.errors import InputError
from graspfx.grasp.matrix import GraspMatrix, moments
from graspfx.numeric import finite, number

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Measures:
    """Ellipsoid of the wrenches that contact forces with |f| <= 1 N can exert (Yoshikawa and Nagai 1991).

    Let G_s be the grasp matrix with rows of moments divided by a length L, and torsion columns multiplied by a length
    l. The singular values sigma_1 >= ... >= sigma_w of G_s are the half axes of the ellipsoid [N per N], one for each
    degree of freedom of the object. Degrees of freedom in which the grasp can exert no wrench have the value zero.

    Attributes:
        singular_values: Half axes, (w,), in descending order.
        directions: Directions of the half axes as columns, (w, w), forces before moments divided by L.
        length: Length L [m].
        torsion_length: Length l [m].
    """

    singular_values: FloatArray
    directions: FloatArray
    length: float
    torsion_length: float

    @property
    def isotropy(self) -> float:
        """sigma_w / sigma_1: 1 for a ball, 0 if some wrench cannot be exerted (Prattichizzo and Trinkle 2016)."""
        values = self.singular_values
        return float(values[-1] / values[0]) if values.size and values[0] > 0.0 else 0.0

    @property
    def volume(self) -> float:
        """Manipulability sqrt(det(G_s G_s')) = sigma_1 ... sigma_w.

        This is the volume of the ellipsoid divided by that of the unit ball."""
        return float(np.prod(self.singular_values))

    @property
    def minimum(self) -> float:
        """sigma_w, the largest wrench that |f| = 1 N exerts in the weakest direction of the grasp."""
        return float(self.singular_values[-1]) if self.singular_values.size else 0.0


def measures(
    grasp: GraspMatrix,
    *,
    length: float | None = None,
    about: ArrayLike | None = None,
    torsion_length: float | None = None,
) -> Measures:
    """Compute the singular values of a grasp in comparable units; see `Measures`.

    Args:
        grasp: Contacts.
        length: Length L that divides moments [m]. If None, the contacts' rms distance from their centroid is used.
        about: Reference point of moments [m], for example the object's centre of mass. If None, the contacts' centroid
            is used, or the grasp's origin if a translation is locked.
        torsion_length: Length l [m]: a torsion of l N m has the same weight as a force of 1 N. If None, L is used.

    Raises:
        InputError: If a length is not positive, or no length is given and all contacts coincide.
    """
    L = moment_length(grasp, length)
    ell = L if torsion_length is None else _positive("torsion_length", torsion_length)
    d = grasp.dimensions
    arms = (grasp.points - reference_point(grasp, about))[grasp.finger_of_column]
    a = grasp.contacts.force_axes
    turns = moments(arms, a) / L + grasp.contacts.moment_axes * (ell / L)
    G = np.hstack([a, turns]).T[grasp.free]  # (w, m)
    w = len(G)
    if not w:
        return Measures(np.zeros(0), np.zeros((0, 0)), L, ell)
    directions, singular, _ = np.linalg.svd(G, full_matrices=True)
    values = np.zeros(w)
    values[: len(singular)] = singular
    # in exact arithmetic this is zero for contacts on a line; in floats it is rounding
    values[values <= max(G.shape) * np.finfo(float).eps * values[0]] = 0.0
    return Measures(values, directions, L if d > 1 else 1.0, ell)


def moment_length(grasp: GraspMatrix, length: float | None) -> float:
    """Return the length that divides moments [m]: the argument, or the contacts' rms distance from their centroid."""
    if length is not None:
        return _positive("length", length)
    if not grasp.moment_rows.any():
        return 1.0
    arms = grasp.points - grasp.points[0]
    arms = arms - arms.mean(axis=0)
    radius = float(np.sqrt((arms**2).sum() / grasp.fingers))
    if radius == 0.0:
        raise InputError(
            "length", None, "a length [m] for moments", "all contacts coincide, so that their rms radius is zero"
        )
    return radius


def reference_point(grasp: GraspMatrix, about: ArrayLike | None) -> FloatArray:
    """Return the reference point of moments, (d,) [m]: the argument, the centroid, or the origin (see `measures`)."""
    if about is not None:
        point = finite("about", about)
        if point.shape != (grasp.dimensions,):
            raise InputError("about", point, f"a point of {grasp.dimensions} coordinates")
        return point
    if not grasp.free[: grasp.dimensions].all():
        return grasp.origin
    first = grasp.points[0]
    return np.asarray(first + (grasp.points - first).mean(axis=0))


def _positive(name: str, value: float) -> float:
    return number(name, value, "a positive length [m]", zero=False)
