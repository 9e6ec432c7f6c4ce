"""Shapes in closed form: what the contact kernel needs of each, and the moments of inertia of the solid."""

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

FLATTEST = 1e-6  # shortest over longest semi-axis of an ellipsoid; what is flatter is a box or a cylinder


@dataclass(frozen=True)
class Contacts:
    """Contact points of n fingers in the object's frame.

    Attributes:
        face: (n,) the faces to hand in again with the next sample; 0 on a sphere.
        point: (n, d) on the surface [m].
        normal: (n, d) unit normals into the object.
        gap: (n,) outside > 0, inside < 0 [m]; finger - point = -gap normal, and radius more of a ball's.
    """

    face: NDArray[np.intp]
    point: FloatArray
    normal: FloatArray
    gap: FloatArray


def contacts(each: Sequence[Nearest], d: int) -> Contacts:
    """Collect the contacts of fingers, of which d coordinates count."""
    rows = np.array([list(numbers(contact)) for contact in each]).reshape(-1, 8)
    return Contacts(rows[:, 0].astype(np.intp), rows[:, 1 : 1 + d], rows[:, 4 : 4 + d], rows[:, 7])


class Shape(ABC):
    """A shape about its centre, in its own frame: `kind` and `parameters` as `proxy.closest` takes them."""

    kind: ClassVar[int]
    endless: ClassVar[bool] = False  # then it has no mass properties
    data: ClassVar[None] = None  # what the kernel reads beside the parameters; only a mesh has it

    @property
    @abstractmethod
    def parameters(self) -> tuple[float, float, float]:
        """Lengths [m] or a unit normal; zero for what is not there."""

    @abstractmethod
    def dimensions_ok(self, d: int) -> bool:
        """Tell whether the shape exists on the line, in the plane, in space."""

    @abstractmethod
    def faces(self, d: int) -> int:
        """Count the faces that hold a finger."""

    @abstractmethod
    def _moments(self, d: int) -> tuple[float, float, float]:
        """Give principal moments over the mass [m^2]."""

    @abstractmethod
    def _volume(self) -> float:
        """Compute the volume in space [m^3]."""

    def volume(self) -> float:
        """Compute the volume of the solid in space [m^3].

        Raises:
            InputError: a shape that is not in space, or without end.
        """
        self._check(3)
        return self._volume()

    def inertia(self, mass: float, d: int) -> FloatArray:
        """Give principal moments of the solid about its centre, (3,) [kg m^2]; the plane has the third, a line none.

        Raises:
            InputError: other dimensions than the shape's, or a shape without end.
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
        """Find contact points of fingers at `points` (n, d) in the object's frame.

        Args:
            faces: (n,) theirs from before.
            previous: (n, d) contact points from before.
            radius: of the balls that the fingertips are [m], zero for points.
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
            raise InputError("dimensions", d, f"those of {self}", "vectors have one entry per dimension")


@dataclass(frozen=True)
class Box(Shape):
    """A box of full edge lengths `size` (d,) [m]: an interval, a rectangle, a cuboid.

    Raises:
        InputError: not one to three finite lengths above zero.
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
    """A sphere of `radius` [m]: an interval on the line, a disc in the plane.

    Raises:
        InputError: a radius that is not finite and above zero.
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
    """All that lies below a plane through the centre: `normal` (d,) points out of it, of any length.

    Raises:
        InputError: a normal that is not one to three finite numbers, or zero.
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
        raise InputError("shape", self, "one that has an end", "give the object's mass itself")

    def _moments(self, d: int) -> tuple[float, float, float]:
        raise InputError("shape", self, "one that has an end", "give the object's moments of inertia themselves")


@dataclass(frozen=True)
class Plane(HalfSpace):
    """A sheet through the centre, without thickness or end, across `normal` (d,): a point on the line.

    It is touched from both sides, and a finger stays on the one where it was at first.

    Raises:
        InputError: a normal that is not one to three finite numbers, or zero.
    """

    kind = proxy.PLANE

    def faces(self, d: int) -> int:
        return 2


@dataclass(frozen=True)
class Round(Shape):
    """A shape that is round about an axis, with a radius and a length along it [m]."""

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
    """All within `radius` [m] of a straight segment of `length` [m]: along z in space, along x in the plane.

    From end to end it measures length + 2 radius.

    Raises:
        InputError: a length that is not finite and above zero.
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
        if d == 2:  # two halves of a disc, each with its centroid 4 r/(3 pi) beyond the rectangle's end
            ends = math.pi * r / (math.pi * r + 2.0 * L)
            moment = (1.0 - ends) * (L * L + 4.0 * r * r) / 12.0
            return 0.0, 0.0, moment + ends * (0.5 * r * r + 0.25 * L * L + 4.0 * r * L / (3.0 * math.pi))
        ends = 4.0 * r / (4.0 * r + 3.0 * L)  # halves of a ball, centroids 3 r/8 beyond
        across = (1.0 - ends) * (0.25 * r * r + L * L / 12.0) + ends * (0.4 * r * r + 0.25 * L * L + 0.375 * r * L)
        return across, across, (1.0 - ends) * 0.5 * r * r + ends * 0.4 * r * r


@dataclass(frozen=True)
class Cylinder(Round):
    """A solid cylinder of `radius` and `length` [m] about z; in space only, in the plane it is a box.

    Raises:
        InputError: a length that is not finite and above zero.
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
    """An ellipsoid of `semi_axes` (d,) [m] along x, y and z; in the plane an ellipse.

    Raises:
        InputError: not two or three finite lengths above zero, or one 1e6 times another.
    """

    semi_axes: tuple[float, ...]
    kind = proxy.ELLIPSOID

    def __post_init__(self) -> None:
        axes = _lengths("semi_axes", self.semi_axes)
        if len(axes) == 1:
            raise InputError("semi_axes", self.semi_axes, "two or three lengths", "on the line it is a box")
        if min(axes) < FLATTEST * max(axes):
            raise InputError(
                "semi_axes", self.semi_axes, f"lengths within {1.0 / FLATTEST:g} times one another",
                "what is flatter is a box or a cylinder",
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
