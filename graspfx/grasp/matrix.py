"""The grasp matrix of n contacts, f_v = G f (eq. 2), and what each of its rows and columns means."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.errors import InputError
from graspfx.grasp.arms import centred_arms
from graspfx.grasp.contact import MOMENTS, Model, contacts
from graspfx.numeric import finite, number

FloatArray = NDArray[np.float64]

CARRIED = "contacts here carry moments"


def grasp_matrix(
    points: ArrayLike,
    normals: ArrayLike | None = None,
    *,
    model: Model | Sequence[Model] = "hard",
    frames: ArrayLike | None = None,
    origin: ArrayLike | None = None,
    free: ArrayLike | None = None,
) -> FloatArray:
    """Compute G of f_v = G f (Kawai and Yoshikawa, eq. 2), (w, m); the arguments are those of `Grasp`."""
    return GraspMatrix(points, normals, model=model, frames=frames, origin=origin, free=free).matrix


class GraspMatrix:
    """The matrix of contacts on an object, and what its rows and columns mean; `Grasp` says what the arguments are."""

    def __init__(
        self,
        points: ArrayLike,
        normals: ArrayLike | None = None,
        *,
        model: Model | Sequence[Model] = "hard",
        frames: ArrayLike | None = None,
        origin: ArrayLike | None = None,
        free: ArrayLike | None = None,
    ) -> None:
        self.contacts = contacts(points, normals, model=model, frames=frames)
        self.fingers, self.dimensions = self.contacts.points.shape
        d = self.dimensions
        self.origin = np.zeros(d) if origin is None else finite("origin", origin)
        if self.origin.shape != (d,):
            raise InputError("origin", self.origin, f"a point of {d} coordinates")
        self.free = _mask(free, d + MOMENTS[d])
        self.finger_of_column = self.contacts.finger
        self.torsion_columns = self.contacts.moment
        self.moment_rows = np.r_[np.zeros(d, dtype=bool), np.ones(MOMENTS[d], dtype=bool)][self.free]

    @property
    def points(self) -> FloatArray:
        """Contact points (n, d) [m]."""
        return self.contacts.points

    @cached_property
    def matrix(self) -> FloatArray:
        """G, (w, m), with moments about the origin as given."""
        arms = (self.points - self.origin)[self.finger_of_column]  # (m, d)
        a = self.contacts.force_axes
        if self.dimensions == 3:
            moments = np.cross(arms, a) + self.contacts.moment_axes
        elif self.dimensions == 2:
            moments = (arms[:, 0] * a[:, 1] - arms[:, 1] * a[:, 0])[:, None] + self.contacts.moment_axes
        else:
            moments = self.contacts.moment_axes
        return np.hstack([a, moments]).T[self.free]

    def unit_free(self) -> tuple[FloatArray, float]:
        """Give a matrix (w, m) with the row space of G, its torsion columns multiplied by a length, and that length.

        The rows are the object's free motions as the contacts see them: translations, and rotations about the contacts'
        centroid divided by the rms contact radius R, the length. What a locked translation would have to do to bring a
        rotation's centre to the centroid stays in the rotation's row, so that a knob turns about its own axis.
        """
        d, free = self.dimensions, self.free
        a = self.contacts.force_axes
        if not free[d:].any():
            return a.T[free[:d]], 1.0
        axes, fields, centroid = centred_arms(self.points, principal=bool(free[d:].all()))
        radius = float(np.sqrt((fields**2).sum() / (self.fingers * max(d - 1, 1))))  # sum_k |u_k x r|^2 = (d - 1) |r|^2
        size = radius if radius > 0.0 else 1.0
        if not free[:d].all():
            offset = centroid + (self.points[0] - self.origin)
            carried = np.cross(axes, offset) if d == 3 else np.array([[-offset[1], offset[0]]])
            carried[:, free[:d]] = 0.0
            fields = fields + carried[:, None, :]
        rows = (fields[:, self.finger_of_column] * a).sum(axis=2)  # (turns, m) [m]
        turns = (rows / size + axes @ self.contacts.moment_axes.T)[free[d:]]
        return np.vstack([a.T[free[:d]], turns]), size

    def metric(self, *, torsion_length: float | None = None, weights: ArrayLike | None = None) -> FloatArray:
        """Compute M for `split`, (m,): weight of the finger, times torsion_length^2 for a moment [m^2].

        Args:
            torsion_length: radius of a fingertip's contact patch [m], which makes 1 rad of torsion comparable with a
                displacement; needed where contacts carry moments.
            weights: one per finger, for example m_i / mean(m) of the devices; 1 if None.
        """
        w = np.ones(self.fingers) if weights is None else finite("weights", weights)
        if w.shape != (self.fingers,) or not (w > 0.0).all():
            raise InputError("weights", w, f"{self.fingers} positive numbers, one per finger")
        M = w[self.finger_of_column]
        if self.torsion_columns.any():
            length = number("torsion_length", torsion_length, "a positive length [m]", CARRIED, zero=False)
            M[self.torsion_columns] *= length**2
        return M


def _mask(free: ArrayLike | None, w: int) -> NDArray[np.bool_]:
    if free is None:
        return np.ones(w, dtype=bool)
    try:
        mask = np.asarray(free)
    except ValueError as error:
        raise InputError("free", free, f"{w} booleans, True where the object can move") from error
    if mask.shape != (w,) or not np.isin(mask, (0, 1)).all():
        raise InputError("free", mask.tolist(), f"{w} booleans, True where the object can move")
    return mask.astype(bool)
