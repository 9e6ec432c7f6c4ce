"""Shapes in closed form: a box and a sphere, on the line, in the plane and in space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.errors import InputError
from graspfx.objects.proxy import BOX, SPHERE, closest

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Contacts:
    """Contact points of n fingers in the object's frame.

    Attributes:
        face: (n,) the faces to hand in again with the next sample; 0 on a sphere.
        point: (n, d) on the surface [m].
        normal: (n, d) unit normals into the object.
        gap: (n,) outside > 0, inside < 0 [m]; finger - point = -gap normal.
    """

    face: NDArray[np.intp]
    point: FloatArray
    normal: FloatArray
    gap: FloatArray


@dataclass(frozen=True)
class Box:
    """A box of full edge lengths `size` (d,) [m] about its centre: an interval, a rectangle, a cuboid.

    Raises:
        InputError: not one to three finite lengths above zero.
    """

    size: tuple[float, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", _lengths("size", self.size))

    @property
    def kind(self) -> int:
        return BOX

    @property
    def parameters(self) -> tuple[float, float, float]:
        """Half edges [m]; zero for what is not there."""
        half = [0.5 * edge for edge in self.size] + [0.0, 0.0]
        return half[0], half[1], half[2]

    def dimensions_ok(self, d: int) -> bool:
        """A box is of the dimensions that it has lengths for."""
        return d == len(self.size)

    def inertia(self, mass: float, d: int) -> FloatArray:
        """Principal moments of the solid about its centre, (3,) [kg m^2]; the plane has the third, a line none."""
        _check(self, d)
        a, b, c = (4.0 * h * h for h in self.parameters)
        return mass / 12.0 * np.array([b + c, c + a, a + b]) * _turns(d)

    def contact(self, points: ArrayLike, faces: ArrayLike | None = None, previous: ArrayLike | None = None) -> Contacts:
        """Contact points of fingers at `points` (n, d) in the object's frame; `faces` (n,) are theirs from before."""
        return _contact(self, points, faces, previous)


@dataclass(frozen=True)
class Sphere:
    """A sphere of `radius` [m] about its centre: an interval on the line, a disc in the plane.

    Raises:
        InputError: a radius that is not finite and above zero.
    """

    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", _lengths("radius", (self.radius,))[0])

    @property
    def kind(self) -> int:
        return SPHERE

    @property
    def parameters(self) -> tuple[float, float, float]:
        """The radius [m], and two zeros."""
        return self.radius, 0.0, 0.0

    def dimensions_ok(self, d: int) -> bool:
        """A sphere is of any dimensions."""
        return d in (1, 2, 3)

    def inertia(self, mass: float, d: int) -> FloatArray:
        """Principal moments of the solid about its centre, (3,) [kg m^2]; a disc has the third, a line none."""
        _check(self, d)
        share = 0.4 if d == 3 else 0.5
        return np.full(3, share * mass * self.radius**2) * _turns(d)

    def contact(self, points: ArrayLike, faces: ArrayLike | None = None, previous: ArrayLike | None = None) -> Contacts:
        """Contact points of fingers at `points` (n, d) in the object's frame; `previous` (n, d), theirs from before."""
        return _contact(self, points, faces, previous)


def _contact(shape: Box | Sphere, points: ArrayLike, faces: ArrayLike | None, previous: ArrayLike | None) -> Contacts:
    p = np.asarray(points, dtype=float)
    if p.ndim != 2 or not np.isfinite(p).all():
        raise InputError("points", points, "finite positions of shape (n, d)")
    n, d = p.shape
    _check(shape, d)
    face = np.full(n, -1) if faces is None else np.asarray(faces, dtype=np.intp)
    before = np.zeros((n, d)) if previous is None else np.asarray(previous, dtype=float)
    if face.shape != (n,) or (face < -1).any() or (face >= 2 * d).any():
        raise InputError("faces", faces, f"{n} numbers from -1 to {2 * d - 1}")
    if before.shape != (n, d) or not np.isfinite(before).all():
        raise InputError("previous", previous, f"finite positions of shape ({n}, {d})")
    a, b, c = shape.parameters
    found = np.zeros((n, 8))
    for i in range(n):
        x, y, z = (*p[i].tolist(), 0.0, 0.0)[:3]
        u, v, w = (*before[i].tolist(), 0.0, 0.0)[:3]
        found[i] = closest(shape.kind, d, a, b, c, x, y, z, int(face[i]), u, v, w)
    return Contacts(found[:, 0].astype(np.intp), found[:, 1 : 1 + d], found[:, 4 : 4 + d], found[:, 7])


def _lengths(name: str, given: Sequence[Any] | FloatArray) -> tuple[float, ...]:
    try:
        lengths = tuple(float(value) for value in given)
    except (TypeError, ValueError) as error:
        raise InputError(name, given, "lengths [m]") from error
    if not (1 <= len(lengths) <= 3 and all(0.0 < value < np.inf for value in lengths)):
        raise InputError(
            name, given, "one to three finite lengths above zero [m]" if name == "size" else "above zero [m]"
        )
    return lengths


def _check(shape: Box | Sphere, d: int) -> None:
    if not shape.dimensions_ok(d):
        raise InputError("dimensions", d, f"those of {shape}", "a box has one edge length per dimension")


def _turns(d: int) -> FloatArray:
    return np.array([d == 3, d == 3, d > 1], dtype=float)
