"""State of a finger on a triangle mesh, in a block."""

from __future__ import annotations

from graspfx.compile.records import Many, Record, many
from graspfx.spatial import Vector

NEW, FREE, TOUCHING = 0, 1, 2  # modes


class Plane(Record):
    """Plane in front of which a ball's proxy stays: n . x >= distance."""

    normal: Vector  # n_j
    distance: float  # n_j . c_j + radius
    triangle: int  # index of the plane's triangle
    feature: int  # feature of the triangle


class MeshFinger(Record):
    """Finger on a mesh. A new finger is all zeros, except `reach`."""

    mode: int  # NEW, FREE or TOUCHING
    face: int  # face of the contact point
    feature: int  # feature of the face: 0 inside, 1 2 3 on ab bc ca, 4 5 6 at a b c
    point: Vector  # contact point, object's frame [m]
    inward: Vector  # unit normal into the object
    last: Vector  # last position of the finger, or of a ball's proxy [m]
    safe: float  # radius around `last` that is free of the surface [m]
    reach: float  # largest gap at which the contact point is the nearest one [m]; infinite: always
    planes: Many[Plane] = many("4")  # for a ball: up to three active planes, and a candidate
