"""Closed-form shapes: parameters for the contact kernel, contact points, volumes, and moments of inertia."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.compile.records import numbers
from graspfx.errors import InputError
from graspfx.numeric import LARGEST, SMALLEST, finite, number
from graspfx.spatial import Vector
from graspfx.surfaces.closed_form import proxy
from graspfx.surfaces.nearest import Nearest

FloatArray = NDArray[np.float64]

FLATTEST = 1e-6  # smallest ratio of semi-axes of an ellipsoid; use a box or a cylinder for a flatter one


@dataclass(frozen=True)
class Contacts:
    """Contact points of n fingers in the object's frame.

    Attributes:
        face: Index of each finger's face, an input for the next sample (n,); see `Shape.faces`.
        point: Contact points on the surface (n, d) [m].
        normal: Unit normals into the object (n, d).
        gap: Gaps between fingertips and surface, positive outside and negative inside (n,) [m]. A finger at p with a
            contact point c and normal n satisfies p - c = -(gap + radius) n, where a point fingertip has radius zero.
    """

    face: NDArray[np.intp]
    point: FloatArray
    normal: FloatArray
    gap: FloatArray


def contacts(each: Sequence[Nearest], d: int) -> Contacts:
    """Collect the contact of each finger, in d dimensions, in arrays."""
    rows = np.array([list(numbers(contact)) for contact in each]).reshape(-1, 8)
    return Contacts(rows[:, 0].astype(np.intp), rows[:, 1 : 1 + d], rows[:, 4 : 4 + d], rows[:, 7])


class Shape(ABC):
    """Base class of shapes; the centre of a shape is the origin of its frame.

    The attributes `kind` and `parameters` are the arguments `kind` and `size` of `proxy.closest`.
    """

    kind: ClassVar[int]
    endless: ClassVar[bool] = False  # an endless shape has no mass properties
    data: ClassVar[None] = None  # further data of the kernel; only a mesh has it

    @property
    @abstractmethod
    def parameters(self) -> tuple[float, float, float]:
        """Lengths [m] or unit normal of the shape; unused entries are zero."""

    @abstractmethod
    def dimensions_ok(self, d: int) -> bool:
        """Return whether the shape exists in d dimensions."""

    @abstractmethod
    def faces(self, d: int) -> int:
        """Return the number of faces in d dimensions; a finger inside the shape keeps its face."""

    @abstractmethod
    def _moments(self, d: int) -> tuple[float, float, float]:
        """Return the principal moments of inertia divided by the mass [m^2]."""

    @abstractmethod
    def _volume(self) -> float:
        """Compute the volume of the solid in three dimensions [m^3]."""

    def volume(self) -> float:
        """Compute the volume of the solid in three dimensions [m^3].

        Raises:
            InputError: If the shape is unbounded or does not exist in three dimensions.
        """
        self._check(3)
        return self._volume()

    def inertia(self, mass: float, d: int) -> FloatArray:
        """Compute the principal moments of inertia of the solid about its centre, (3,) [kg m^2].

        In two dimensions, only the third moment is non-zero; in one dimension, all are zero.

        Args:
            mass: Mass [kg].
            d: Number of dimensions.

        Raises:
            InputError: If the shape is unbounded or does not exist in d dimensions, or the mass is not positive.
        """
        self._check(d)
        turns = (d == 3, d == 3, d > 1)
        return number("mass", mass, "a mass above zero [kg]", zero=False) * np.where(turns, self._moments(d), 0.0)

    def contact(
        self,
        points: ArrayLike,
        faces: ArrayLike | None = None,
        previous: ArrayLike | None = None,
        *,
        radius: float = 0.0,
    ) -> Contacts:
        """Find the contact points of n fingers.

        Args:
            points: Positions of the fingers in the object's frame (n, d) [m].
            faces: Index of each finger's face in the last sample (n,); -1 for a new finger. By default all are new.
            previous: Contact points in the last sample (n, d) [m]; by default zeros.
            radius: Radius of the fingertips [m]; zero for point fingertips.

        Raises:
            InputError: If an array has non-finite numbers or a wrong shape, a face does not exist, or the shape does
                not exist in d dimensions.
        """
        p = finite("points", points, "finite positions of shape (n, d)", largest=math.inf)
        if p.ndim != 2:
            raise InputError("points", points, "finite positions of shape (n, d)")
        n, d = p.shape
        self._check(d)
        last = self.faces(d) - 1
        face = np.full(n, -1.0) if faces is None else finite("faces", faces, f"{n} numbers from -1 to {last}")
        before = np.zeros((n, d)) if previous is None else finite("previous", previous, largest=math.inf)
        if face.shape != (n,) or (face < -1).any() or (face > last).any() or (face % 1.0).any():
            raise InputError("faces", faces, f"{n} numbers from -1 to {last}")
        if before.shape != (n, d):
            raise InputError("previous", previous, f"finite positions of shape ({n}, {d})")
        radius = number("radius", radius, "a finite length, zero or more [m]")
        size, rest = Vector(*self.parameters), [0.0] * (3 - d)
        rows = zip(p.tolist(), face.tolist(), before.tolist(), strict=True)
        each = [
            proxy.closest_to_ball(self.kind, d, size, radius, Vector(*x, *rest), int(f), Vector(*c, *rest))
            for x, f, c in rows
        ]
        return contacts(each, d)

    def _check(self, d: int) -> None:
        if not self.dimensions_ok(int(number("dimensions", d, "1, 2 or 3"))):
            raise InputError("dimensions", d, f"the dimensions of {self}", "give vectors one entry per dimension")


@dataclass(frozen=True)
class Box(Shape):
    """A box: an interval in one dimension, a rectangle in two, a cuboid in three.

    Args:
        size: Full edge lengths (d,) [m].

    Raises:
        InputError: If `size` is not a sequence of one to three finite positive lengths.
    """

    size: tuple[float, ...]
    kind = proxy.BOX

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", _lengths("size", self.size))

    @property
    def parameters(self) -> tuple[float, float, float]:
        half = [0.5 * edge for edge in self.size] + [0.0, 0.0]
        return half[0], half[1], half[2]

    def dimensions_ok(self, d: int) -> bool:
        return d == len(self.size)

    def faces(self, d: int) -> int:
        return 2 * d

    def _volume(self) -> float:
        return math.prod(self.size)

    def _moments(self, d: int) -> tuple[float, float, float]:
        a, b, c = (h * h / 3.0 for h in self.parameters)
        return b + c, c + a, a + b


@dataclass(frozen=True)
class Sphere(Shape):
    """A sphere: an interval in one dimension, a disc in two, a ball in three.

    Args:
        radius: Radius [m].

    Raises:
        InputError: If the radius is not a finite positive length.
    """

    radius: float
    kind = proxy.SPHERE

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", _length("radius", self.radius))

    @property
    def parameters(self) -> tuple[float, float, float]:
        return self.radius, 0.0, 0.0

    def dimensions_ok(self, d: int) -> bool:
        return d in (1, 2, 3)

    def faces(self, d: int) -> int:
        return 2 if d == 1 else 1

    def _volume(self) -> float:
        return 4.0 / 3.0 * math.pi * self.radius**3

    def _moments(self, d: int) -> tuple[float, float, float]:
        moment = (0.4 if d == 3 else 0.5) * self.radius**2
        return moment, moment, moment


@dataclass(frozen=True)
class HalfSpace(Shape):
    """The region on one side of a plane through the origin.

    Args:
        normal: Vector that points out of the region, of any non-zero length (d,).

    Raises:
        InputError: If `normal` is not a sequence of one to three finite numbers, or is zero.
    """

    normal: tuple[float, ...]
    kind = proxy.HALF_SPACE
    endless = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "normal", _direction("normal", self.normal))

    @property
    def parameters(self) -> tuple[float, float, float]:
        normal = (*self.normal, 0.0, 0.0)
        return normal[0], normal[1], normal[2]

    def dimensions_ok(self, d: int) -> bool:
        return d == len(self.normal)

    def faces(self, d: int) -> int:
        return 1

    def _volume(self) -> float:
        raise InputError("shape", self, "a bounded shape", "give the object's mass")

    def _moments(self, d: int) -> tuple[float, float, float]:
        raise InputError("shape", self, "a bounded shape", "give the object's moments of inertia")


@dataclass(frozen=True)
class Plane(HalfSpace):
    """An unbounded sheet without thickness through the origin; in one dimension a point.

    Fingers can touch both sides of the sheet. A finger stays on the side on which it started.

    Args:
        normal: Vector perpendicular to the sheet, of any non-zero length (d,).

    Raises:
        InputError: If `normal` is not a sequence of one to three finite numbers, or is zero.
    """

    kind = proxy.PLANE

    def faces(self, d: int) -> int:
        return 2


@dataclass(frozen=True)
class Round(Shape):
    """Base class of shapes with a radius [m] and a length along an axis [m]."""

    radius: float
    length: float

    def __post_init__(self) -> None:
        for name in ("radius", "length"):
            object.__setattr__(self, name, _length(name, getattr(self, name)))

    @property
    def parameters(self) -> tuple[float, float, float]:
        return self.radius, 0.5 * self.length, 0.0


@dataclass(frozen=True)
class Capsule(Round):
    """A capsule: all points within a distance of a segment. Its total length is length + 2 radius.

    Args:
        radius: Largest distance from the segment [m].
        length: Length of the segment, which is along z in space and along x in the plane [m].

    Raises:
        InputError: If the radius or the length is not a finite positive length.
    """

    kind = proxy.CAPSULE

    def dimensions_ok(self, d: int) -> bool:
        return d in (2, 3)

    def faces(self, d: int) -> int:
        return 2 if d == 2 else 1

    def _volume(self) -> float:
        return math.pi * self.radius**2 * (self.length + 4.0 / 3.0 * self.radius)

    def _moments(self, d: int) -> tuple[float, float, float]:
        r, L = self.radius, self.length
        if d == 2:  # two half discs, whose centroids lie 4 r/(3 pi) beyond the ends of the rectangle
            ends = math.pi * r / (math.pi * r + 2.0 * L)
            moment = (1.0 - ends) * (L * L + 4.0 * r * r) / 12.0
            return 0.0, 0.0, moment + ends * (0.5 * r * r + 0.25 * L * L + 4.0 * r * L / (3.0 * math.pi))
        ends = 4.0 * r / (4.0 * r + 3.0 * L)  # half balls, whose centroids lie 3 r/8 beyond
        across = (1.0 - ends) * (0.25 * r * r + L * L / 12.0) + ends * (0.4 * r * r + 0.25 * L * L + 0.375 * r * L)
        return across, across, (1.0 - ends) * 0.5 * r * r + ends * 0.4 * r * r


@dataclass(frozen=True)
class Cylinder(Round):
    """A solid cylinder along z, in three dimensions only (in two dimensions, use a box).

    Args:
        radius: Radius [m].
        length: Length [m].

    Raises:
        InputError: If the radius or the length is not a finite positive length.
    """

    kind = proxy.CYLINDER

    def dimensions_ok(self, d: int) -> bool:
        return d == 3

    def faces(self, d: int) -> int:
        return 3

    def _volume(self) -> float:
        return math.pi * self.radius**2 * self.length

    def _moments(self, d: int) -> tuple[float, float, float]:
        square = self.radius**2
        across = square / 4.0 + self.length**2 / 12.0
        return across, across, 0.5 * square


@dataclass(frozen=True)
class Ellipsoid(Shape):
    """An ellipsoid; in two dimensions an ellipse.

    Args:
        semi_axes: Semi-axes along x, y and z (d,) [m].

    Raises:
        InputError: If `semi_axes` is not a sequence of two or three finite positive lengths, or the ratio of the
            longest to the shortest exceeds 1e6.
    """

    semi_axes: tuple[float, ...]
    kind = proxy.ELLIPSOID

    def __post_init__(self) -> None:
        axes = _lengths("semi_axes", self.semi_axes)
        if len(axes) == 1:
            raise InputError("semi_axes", self.semi_axes, "two or three lengths", "use a box on the line")
        if min(axes) < FLATTEST * max(axes):
            raise InputError(
                "semi_axes", self.semi_axes, f"lengths with ratios up to {1.0 / FLATTEST:g}",
                "use a box or a cylinder for a flatter shape",
            )  # fmt: skip
        object.__setattr__(self, "semi_axes", axes)

    @property
    def parameters(self) -> tuple[float, float, float]:
        axes = (*self.semi_axes, 0.0)
        return axes[0], axes[1], axes[2]

    def dimensions_ok(self, d: int) -> bool:
        return d == len(self.semi_axes)

    def faces(self, d: int) -> int:
        return 2

    def _volume(self) -> float:
        return 4.0 / 3.0 * math.pi * math.prod(self.semi_axes)

    def _moments(self, d: int) -> tuple[float, float, float]:
        share = 0.2 if d == 3 else 0.25
        a, b, c = (share * axis * axis for axis in self.parameters)
        return b + c, c + a, a + b


def _numbers(name: str, argument: Any, expected: str, largest: float = LARGEST) -> tuple[float, ...]:
    value = finite(name, argument, expected, largest=largest)
    if value.ndim != 1:
        raise InputError(name, argument, expected)
    return tuple(value.tolist())


def _lengths(name: str, argument: Sequence[Any] | FloatArray) -> tuple[float, ...]:
    expected = "one to three finite lengths above zero [m]"
    lengths = _numbers(name, argument, expected)
    if not (1 <= len(lengths) <= 3 and all(value >= SMALLEST for value in lengths)):
        raise InputError(name, argument, expected)
    return lengths


def _length(name: str, argument: Any) -> float:
    return number(name, argument, "a finite length above zero [m]", zero=False)


def _direction(name: str, argument: Sequence[Any] | FloatArray) -> tuple[float, ...]:
    expected = "one to three finite numbers, not all zero"
    vector = _numbers(name, argument, expected, math.inf)
    largest = max(map(abs, vector), default=0.0)
    if not (1 <= len(vector) <= 3 and largest > 0.0):
        raise InputError(name, argument, expected)
    length = math.hypot(*(value / largest for value in vector))
    return tuple(value / largest / length for value in vector)
