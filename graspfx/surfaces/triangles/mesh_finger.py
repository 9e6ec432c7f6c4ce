"""A finger on a triangle mesh, as it stands in a block."""

from __future__ import annotations

from graspfx.compile.records import Many, Record, many
from graspfx.spatial import Vector

NEW, FREE, TOUCHING = 0, 1, 2  # modes


class Plane(Record):
    """A plane that a ball's proxy stays in front of: n . x >= distance."""

    normal: Vector  # n_j
    distance: float  # n_j . c_j + radius
    triangle: int  # that it comes from
    feature: int  # of the triangle


class MeshFinger(Record):
    """A finger on a mesh. Zeros, but for `reach`, are a finger that has not been there yet."""

    mode: int  # NEW, FREE or TOUCHING
    face: int  # of the contact point
    feature: int  # of the face: 0 inside, 1 2 3 on ab bc ca, 4 5 6 at a b c
    point: Vector  # contact point, object's frame [m]
    inward: Vector  # unit normal into the object
    last: Vector  # where the finger was; of a ball, its proxy [m]
    safe: float  # it is free up to here from there, at least [m]
    reach: float  # up to this gap the contact point is the nearest one; infinite: always [m]
    planes: Many[Plane] = many("4")  # of a ball: those that hold its proxy, at most three, and one that may
