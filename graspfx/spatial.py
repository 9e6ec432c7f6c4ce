"""Vectors, matrices, quaternions and rotations for kernels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from graspfx import elementary
from graspfx.compile.kernel import inline, kernel, written
from graspfx.compile.records import Table

LARGEST = 1e300  # largest squared angle; a comparison with NaN is false, too
SWEEPS = 12  # largest number of sweeps of Jacobi rotations; three or four suffice
SMALL = 1e-8  # squared angle below which two terms of the series are accurate to rounding


@dataclass(frozen=True, slots=True)
class Vector:
    """Vector of three components; in two dimensions z is zero, in one dimension y and z are zero."""

    x: float
    y: float
    z: float

    def __add__(self, other: Vector) -> Vector:
        return Vector(self.x + other.x, self.y + other.y, self.z + other.z)

    def __sub__(self, other: Vector) -> Vector:
        return Vector(self.x - other.x, self.y - other.y, self.z - other.z)

    def __neg__(self) -> Vector:
        return Vector(-self.x, -self.y, -self.z)

    def __mul__(self, k: float) -> Vector:
        return Vector(self.x * k, self.y * k, self.z * k)

    def __rmul__(self, k: float) -> Vector:
        return Vector(k * self.x, k * self.y, k * self.z)

    def __truediv__(self, k: float) -> Vector:
        return Vector(self.x / k, self.y / k, self.z / k)

    def __getitem__(self, i: int) -> float:
        return (self.x, self.y, self.z)[i]

    def __setitem__(self, i: int, value: float) -> None:
        raise TypeError("a vector outside a record is constant: assign to an entry of a record's field")


@dataclass(frozen=True, slots=True)
class Vector4:
    """Contact coordinates of a finger: a vector, and the torsion t of a soft finger in units of its patch length."""

    x: float
    y: float
    z: float
    t: float

    @property
    def vector(self) -> Vector:
        return Vector(self.x, self.y, self.z)

    def __add__(self, other: Vector4) -> Vector4:
        return Vector4(self.x + other.x, self.y + other.y, self.z + other.z, self.t + other.t)

    def __sub__(self, other: Vector4) -> Vector4:
        return Vector4(self.x - other.x, self.y - other.y, self.z - other.z, self.t - other.t)

    def __rmul__(self, k: float) -> Vector4:
        return Vector4(k * self.x, k * self.y, k * self.z, k * self.t)

    def __getitem__(self, i: int) -> float:
        return (self.x, self.y, self.z, self.t)[i]

    def __setitem__(self, i: int, value: float) -> None:
        raise TypeError("a vector outside a record is constant: assign to an entry of a record's field")


@dataclass(frozen=True, slots=True)
class Matrix:
    """3 x 3 matrix, stored by rows."""

    xx: float
    xy: float
    xz: float
    yx: float
    yy: float
    yz: float
    zx: float
    zy: float
    zz: float

    def __matmul__(self, v: Vector) -> Vector:
        return Vector(
            self.xx * v.x + self.xy * v.y + self.xz * v.z,
            self.yx * v.x + self.yy * v.y + self.yz * v.z,
            self.zx * v.x + self.zy * v.y + self.zz * v.z,
        )

    @property
    def first(self) -> Vector:
        """First row."""
        return Vector(self.xx, self.xy, self.xz)

    @property
    def second(self) -> Vector:
        """Second row."""
        return Vector(self.yx, self.yy, self.yz)

    @property
    def third(self) -> Vector:
        """Third row."""
        return Vector(self.zx, self.zy, self.zz)

    def row(self, i: int) -> Vector:
        """Return row i, for an index that is not known when the kernel is compiled."""
        return Vector(self[3 * i], self[3 * i + 1], self[3 * i + 2])

    @property
    def transpose(self) -> Matrix:
        return Matrix(self.xx, self.yx, self.zx, self.xy, self.yy, self.zy, self.xz, self.yz, self.zz)

    def __getitem__(self, i: int) -> float:
        return (self.xx, self.xy, self.xz, self.yx, self.yy, self.yz, self.zx, self.zy, self.zz)[i]

    def __setitem__(self, i: int, value: float) -> None:
        raise TypeError("a matrix outside a record is constant: assign to an entry of a record's field")


@dataclass(frozen=True, slots=True)
class Quaternion:
    """Rotation as a quaternion x, y, z, w."""

    x: float
    y: float
    z: float
    w: float

    @property
    def conjugate(self) -> Quaternion:
        return Quaternion(-self.x, -self.y, -self.z, self.w)

    @property
    def vector(self) -> Vector:
        return Vector(self.x, self.y, self.z)

    def __matmul__(self, other: Quaternion) -> Quaternion:
        """Return the quaternion of the rotation by `other` followed by the rotation by `self`."""
        return Quaternion(
            self.w * other.x + self.x * other.w + self.y * other.z - self.z * other.y,
            self.w * other.y - self.x * other.z + self.y * other.w + self.z * other.x,
            self.w * other.z + self.x * other.y - self.y * other.x + self.z * other.w,
            self.w * other.w - self.x * other.x - self.y * other.y - self.z * other.z,
        )


ZERO = Vector(0.0, 0.0, 0.0)
NOTHING = Vector4(0.0, 0.0, 0.0, 0.0)
IDENTITY = Matrix(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


@inline
def dot(a: Vector, b: Vector) -> float:
    """Compute the dot product a . b."""
    return a.x * b.x + a.y * b.y + a.z * b.z


@inline
def inner(a: Vector, b: Vector) -> float:
    """Compute the dot product a . b as a sum that starts with 0.0, so that the result is never -0.0."""
    return 0.0 + a.x * b.x + a.y * b.y + a.z * b.z


@inline
def with_torsion(v: Vector, t: float) -> Vector4:
    """Return the contact coordinates with vector v and torsion t."""
    return Vector4(v.x, v.y, v.z, t)


@inline
def cross(a: Vector, b: Vector) -> Vector:
    """Compute the cross product a x b."""
    return Vector(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


@inline
def outer(a: Vector, b: Vector) -> Matrix:
    """Compute the outer product a b'."""
    return Matrix(a.x * b.x, a.x * b.y, a.x * b.z, a.y * b.x, a.y * b.y, a.y * b.z, a.z * b.x, a.z * b.y, a.z * b.z)


@inline
def length(v: Vector) -> float:
    """Compute the Euclidean norm |v|."""
    return math.sqrt(v.x * v.x + v.y * v.y + v.z * v.z)


@inline
def total(v: Vector) -> float:
    """Compute the sum of a vector's components, which is not finite if a component is not finite."""
    return v.x + v.y + v.z


@inline
def rotate(q: Quaternion, v: Vector) -> Vector:
    """Rotate v by a unit quaternion: v + w t + u x t, where t = 2 u x v, and q has vector part u and scalar part w."""
    tx, ty, tz = 2.0 * (q.y * v.z - q.z * v.y), 2.0 * (q.z * v.x - q.x * v.z), 2.0 * (q.x * v.y - q.y * v.x)
    return Vector(
        v.x + q.w * tx + q.y * tz - q.z * ty,
        v.y + q.w * ty + q.z * tx - q.x * tz,
        v.z + q.w * tz + q.x * ty - q.y * tx,
    )


@inline
def quaternion_matrix(q: Quaternion) -> Matrix:
    """Compute the rotation matrix of a unit quaternion."""
    x, y, z, w = q.x, q.y, q.z, q.w
    return Matrix(
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w),
        2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w),
        2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip


@inline
def angle_matrix(angle: float) -> Matrix:
    """Compute the matrix of a rotation about z by `angle` [rad]."""
    s, c = elementary.sin_cos(angle)
    return Matrix(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)


@kernel
def exponential(v: Vector) -> Quaternion:
    """Compute the quaternion of a rotation vector v [rad]: (v sin(|v|/2)/|v|, cos(|v|/2)), accurate to rounding."""
    square = v.x * v.x + v.y * v.y + v.z * v.z
    if square < SMALL:
        s = 0.5 - square / 48.0
        return Quaternion(v.x * s, v.y * s, v.z * s, 1.0 - 0.125 * square)
    if not square <= LARGEST:  # the body has diverged: its state becomes NaN, and no error is raised
        return Quaternion(math.nan, math.nan, math.nan, math.nan)
    angle = math.sqrt(square)
    sine, cosine = elementary.sin_cos(0.5 * angle)
    s = sine / angle
    return Quaternion(v.x * s, v.y * s, v.z * s, cosine)


@kernel
def normalise(q: Quaternion) -> Quaternion:
    """Compute q / |q|; a zero quaternion is returned unchanged."""
    square = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w
    if square <= 0.0:
        return q
    k = 1.0 / math.sqrt(square)
    return Quaternion(q.x * k, q.y * k, q.z * k, q.w * k)


def quaternion(R: Sequence[float]) -> Quaternion:
    """Compute the unit quaternion with w >= 0 of a rotation matrix R, whose 9 entries are given row by row.

    Shepperd's method (1978) avoids cancellation.
    """
    a, b, c, d, e, f, g, h, i = R
    squares = (1.0 + a - e - i, 1.0 - a + e - i, 1.0 - a - e + i, 1.0 + a + e + i)  # squares of 2 x, 2 y, 2 z, 2 w
    largest = max(squares)
    if largest == squares[3]:
        q = (h - f, c - g, d - b, largest)
    elif largest == squares[0]:
        q = (largest, b + d, c + g, h - f)
    elif largest == squares[1]:
        q = (b + d, largest, f + h, c - g)
    else:
        q = (c + g, f + h, largest, d - b)
    sign = -1.0 if q[3] < 0.0 else 1.0
    return written(normalise)(Quaternion(sign * q[0], sign * q[1], sign * q[2], sign * q[3]))


@kernel
def orthogonalise(rows: Table, first: int, count: int) -> None:
    """Orthogonalise rows `first` to `first + count - 1` in place by one-sided Jacobi rotations.

    The first entry of each row is ignored. Unlike an eigendecomposition of the rows' Gram matrix, this method is
    accurate for rows of small norm, relative to their norm.
    """
    for _ in range(SWEEPS):
        turned = False
        for p in range(first, first + count - 1):
            for q in range(p + 1, first + count):
                u = rows[p]
                v = rows[q]
                uu = vv = uv = 0.0
                for j in range(1, rows.columns):
                    uu += u[j] * u[j]
                    vv += v[j] * v[j]
                    uv += u[j] * v[j]
                if uv * uv <= 1e-31 * uu * vv:
                    continue
                turned = True
                zeta = (vv - uu) / (2.0 * uv)
                t = 1.0 / (abs(zeta) + math.sqrt(1.0 + zeta * zeta))
                if zeta < 0.0:
                    t = -t
                c = 1.0 / math.sqrt(1.0 + t * t)
                s = c * t
                for j in range(1, rows.columns):
                    a, b = u[j], v[j]
                    u[j] = c * a - s * b
                    v[j] = s * a + c * b
        if not turned:
            return
