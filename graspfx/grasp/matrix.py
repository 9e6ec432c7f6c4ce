"""Grasp matrix of n contacts, f_v = G f (eq. 2), with a description of its rows and columns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.errors import InputError
from graspfx.grasp.contact import MOMENTS, Contacts, Model, contact_points, contacts, point_contacts
from graspfx.numeric import finite, number

FloatArray = NDArray[np.float64]
Pair = tuple[FloatArray, FloatArray]

HARD = "hard"
CARRIED = "it is required, because the contacts carry moments"
SPLITTER = 134217729.0  # 2^27 + 1 splits a double into two halves whose products are exact
NEXT, LAST = [1, 2, 0], [2, 0, 1]  # the other two coordinates of a cross product


def grasp_matrix(
    points: ArrayLike,
    normals: ArrayLike | None = None,
    *,
    model: Model | Sequence[Model] = HARD,
    frames: ArrayLike | None = None,
    origin: ArrayLike | None = None,
    free: ArrayLike | None = None,
) -> FloatArray:
    """Compute G of f_v = G f (Kawai and Yoshikawa, eq. 2), (w, m). The arguments are those of `Grasp`.

    G is (..., w, m) for many sets of contacts.
    """
    return GraspMatrix(points, normals, model=model, frames=frames, origin=origin, free=free).matrix


def moments(arms: FloatArray, forces: FloatArray) -> FloatArray:
    """Compute r x a of vectors (..., d): (..., 0) on the line, (..., 1) in the plane, (..., 3) in space."""
    if arms.shape[-1] == 3:
        return np.asarray(arms[..., NEXT] * forces[..., LAST] - arms[..., LAST] * forces[..., NEXT])
    if arms.shape[-1] == 2:
        return np.asarray(arms[..., 0] * forces[..., 1] - arms[..., 1] * forces[..., 0])[..., None]
    return np.zeros((*np.broadcast_shapes(arms.shape, forces.shape)[:-1], 0))


class GraspMatrix:
    """Grasp matrix, with a description of its rows and columns. The arguments are those of `Grasp`."""

    fingers: int
    dimensions: int

    def __init__(
        self,
        points: ArrayLike,
        normals: ArrayLike | None = None,
        *,
        model: Model | Sequence[Model] = HARD,
        frames: ArrayLike | None = None,
        origin: ArrayLike | None = None,
        free: ArrayLike | None = None,
    ) -> None:
        if model is HARD and normals is None and frames is None:  # most frequent case: computes only what is needed
            self.points, self.point_contacts = contact_points(points), True
        else:
            self.contacts = contacts(points, normals, model=model, frames=frames)
            self.points = self.contacts.points
            self.point_contacts = frames is None and set(self.contacts.models) == {HARD}
        self.points.setflags(write=False)
        *sets, self.fingers, self.dimensions = self.points.shape
        self.sets = tuple(sets)
        d = self.dimensions
        if origin is not None:
            self.origin = finite("origin", origin)
            if self.origin.shape not in ((d,), (*self.sets, d)):
                raise InputError("origin", self.origin, f"a point of {d} coordinates")
        if free is not None:
            self.free = _mask(free, d + MOMENTS[d])
            self.point_contacts = self.point_contacts and bool(self.free.all())

    @cached_property
    def contacts(self) -> Contacts:
        """Contacts with their components."""
        return point_contacts(self.points)

    @cached_property
    def origin(self) -> FloatArray:
        """Reference point of moments, (d,) or one for each set (..., d) [m]."""
        return np.zeros(self.dimensions)

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """Mask of the object's free degrees of freedom, (1,), (3,) or (6,), translations before rotations."""
        return np.ones(self.dimensions + MOMENTS[self.dimensions], dtype=bool)

    @property
    def components(self) -> int:
        """Number m of force components, the columns of G."""
        return self.fingers * self.dimensions if self.point_contacts else len(self.finger_of_column)

    @property
    def finger_of_column(self) -> NDArray[np.int64]:
        """Index of the contact of each column, (m,)."""
        return self.contacts.finger

    @property
    def torsion_columns(self) -> NDArray[np.bool_]:
        """Mask of the columns that are moments [N m], (m,)."""
        return self.contacts.moment

    @property
    def forces_of_each(self) -> int:
        """Number of forces of each contact.

        The result is 0 if this number is not the same for all contacts, or if they transmit moments.
        """
        if self.point_contacts:
            return self.dimensions
        counts = np.bincount(self.finger_of_column, minlength=self.fingers)
        is_alike = bool((counts == counts[0]).all()) and not self.torsion_columns.any()
        return int(counts[0]) if is_alike else 0

    @cached_property
    def moment_rows(self) -> NDArray[np.bool_]:
        """Mask of the rows of G that are moments, (w,)."""
        d = self.dimensions
        moments: NDArray[np.bool_] = np.arange(d + MOMENTS[d]) >= d
        return moments[self.free]

    @cached_property
    def matrix(self) -> FloatArray:
        """G, (w, m) or (..., w, m) for many sets, with moments about the given origin."""
        arms = (self.points - self.origin[..., None, :])[..., self.finger_of_column, :]  # (..., m, d)
        a = np.broadcast_to(self.contacts.force_axes, arms.shape)
        rows = np.concatenate([a, moments(arms, a) + self.contacts.moment_axes], axis=-1)
        return transposed(rows)[..., self.free, :]

    def unit_free(self) -> tuple[FloatArray, FloatArray]:
        """Return a matrix (..., w, m) with the row space of G after scaling of torsion columns by R, and R (...) [m].

        The rows are the object's free motions at the contacts: translations, and rotations about the contacts'
        centroid, divided by R. R is the rms distance of the contacts from their centroid, or 1 if this distance is zero
        or no rotation is free. If a translation is locked, a rotation's row includes the motion of the centroid in the
        locked direction, so that a knob rotates about its own axis.
        """
        d, free = self.dimensions, self.free
        a = self.contacts.force_axes
        shifts = np.broadcast_to(transposed(a)[..., free[:d], :], (*self.sets, int(free[:d].sum()), self.components))
        if not free[d:].any():
            return shifts, np.ones(self.sets)
        axes, fields, centroid = centred_arms(self.points, principal=bool(free[d:].all()))
        square = (fields**2).sum(axis=(-3, -2, -1))  # sum_k |u_k x r|^2 = (d - 1) |r|^2
        radius = np.sqrt(square / (self.fingers * max(d - 1, 1)))
        size = np.where(radius > 0.0, radius, 1.0)
        if not free[:d].all():
            offset = centroid + (self.points[..., 0, :] - self.origin)
            carried = (
                moments(axes, offset[..., None, :])
                if d == 3
                else np.stack([-offset[..., 1], offset[..., 0]], axis=-1)[..., None, :]
            )
            carried[..., free[:d]] = 0.0
            fields = fields + carried[..., :, None, :]
        rows = (fields[..., self.finger_of_column, :] * a[..., None, :, :]).sum(axis=-1)  # (..., turns, m) [m]
        turns = rows / size[..., None, None] + axes @ transposed(self.contacts.moment_axes)
        return np.concatenate([shifts, turns[..., free[d:], :]], axis=-2), size

    def require_one(self, function: str) -> None:
        """Raise an error if there are several sets of contacts.

        Raises:
            InputError: If there are several sets of contacts.
        """
        if self.sets:
            raise InputError("points", self.points.shape, "one set of contacts (n, d)", f"call {function} for each set")

    def metric(self, *, torsion_length: float | None = None, weights: ArrayLike | None = None) -> FloatArray:
        """Compute the metric M for `split`, (m,): the finger's weight, times torsion_length^2 [m^2] for a moment.

        Args:
            torsion_length: Radius of a fingertip's contact patch [m], which makes 1 rad of torsion comparable with a
                displacement. Required if contacts carry moments.
            weights: Weight of each finger, for example m_i / mean(m) of the devices; 1 if None.
        """
        w = np.ones(self.fingers) if weights is None else finite("weights", weights)
        if w.shape != (self.fingers,) or not (w > 0.0).all():
            raise InputError("weights", w, f"{self.fingers} positive numbers, one per finger")
        M = w[self.finger_of_column]
        if self.torsion_columns.any():
            length = number("torsion_length", torsion_length, "a positive length [m]", CARRIED, zero=False)
            M[self.torsion_columns] *= length**2
        return M


def transposed(A: FloatArray) -> FloatArray:
    """Transpose each matrix (..., k, l)."""
    return np.swapaxes(A, -1, -2)


def _mask(free: ArrayLike, w: int) -> NDArray[np.bool_]:
    try:
        mask = np.asarray(free)
    except ValueError as error:
        raise InputError("free", free, f"{w} booleans, True where the object can move") from error
    if mask.shape != (w,) or not np.isin(mask, (0, 1)).all():
        raise InputError("free", mask.tolist(), f"{w} booleans, True where the object can move")
    return mask.astype(bool)


def centred_arms(points: FloatArray, *, principal: bool) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute u_k x (c_i - c) for each axis of rotation u_k, where c is the centroid.

    The arms are accurate even for contacts far from the origin or nearly on a line. If contacts of rms radius R are at
    a distance of about h R from a line, a unit rotation about the line moves them by h R, and other rotations move them
    by R. In ordinary arithmetic the arm about the line, a difference of products, has a relative error of eps / h, with
    eps the unit roundoff. Here the arm is computed in pairs of floats, value and rounding error (Dekker 1971, Knuth
    1969), and rounded once.

    Args:
        points: Contact points, (..., n, d) [m], d = 2 or 3.
        principal: Whether, in space, the axes u_k are the principal axes of the contacts instead of the world's axes.

    Returns:
        Axes: (1, 1) in the plane, (..., 3, 3) in space with one axis per row, or (3, 3) for the world's axes. Fields:
        (..., axes, n, d) [m]. Offset c - c_0 of the centroid from the first contact: (..., d) [m].
    """
    *sets, n, d = points.shape
    offset = two_sum(points, -points[..., :1, :])  # exact
    terms = np.swapaxes(np.concatenate(offset, axis=-2), -1, -2).reshape(-1, 2 * n).tolist()
    high = [math.fsum(row) for row in terms]
    low = [math.fsum([*row, -h]) for row, h in zip(terms, high, strict=True)]
    total, rest = (np.array(part).reshape(*sets, 1, d) for part in (high, low))
    arm = add(multiply(np.asarray(float(n)), offset), (-total, -rest))  # n (c_i - c)
    centroid = total[..., 0, :] / n
    if d == 2:
        field = np.stack([-arm[0][..., 1], arm[0][..., 0]], axis=-1) / n
        return np.ones((1, 1)), field[..., None, :, :], centroid
    axes = np.linalg.svd(arm[0], full_matrices=n < d)[2] if principal else np.eye(3)
    u = axes[..., :, None, :]
    high_arm, low_arm = arm[0][..., None, :, :], arm[1][..., None, :, :]
    plus = multiply(u[..., NEXT], (high_arm[..., LAST], low_arm[..., LAST]))
    minus = multiply(u[..., LAST], (high_arm[..., NEXT], low_arm[..., NEXT]))
    product = add(plus, (-minus[0], -minus[1]))
    return axes, (product[0] + product[1]) / n, centroid


def two_sum(a: FloatArray, b: FloatArray) -> Pair:
    """Compute a + b as a rounded sum and its exact remainder (Knuth)."""
    s = a + b
    v = s - a
    return s, (a - (s - v)) + (b - v)


def two_product(a: FloatArray, b: FloatArray) -> Pair:
    """Compute a b as a rounded product and its exact remainder (Dekker)."""
    p = a * b
    ca, cb = SPLITTER * a, SPLITTER * b
    ah, bh = ca - (ca - a), cb - (cb - b)
    al, bl = a - ah, b - bh
    return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl


def add(x: Pair, y: Pair) -> Pair:
    """Add two pairs, with an error of about 1e-32 times the larger pair."""
    s, e = two_sum(x[0], y[0])
    t, f = two_sum(x[1], y[1])
    s, e = two_sum(s, e + t)
    return two_sum(s, e + f)


def multiply(a: FloatArray, x: Pair) -> Pair:
    """Multiply a pair by an ordinary array, with NumPy's broadcasting."""
    p, e = two_product(a, x[0])
    return two_sum(p, e + a * x[1])
