"""Shapes in MuJoCo: its primitives, convex hulls, and one convex piece per triangle of a concave obstacle."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from graspfx.compile.records import numbers
from graspfx.errors import InputError
from graspfx.objects.body import FloatArray
from graspfx.objects.floor.floor import FLAT_KINDS
from graspfx.objects.floor.hull import SHEET, hull_points
from graspfx.objects.mujoco.tetrahedra import parts
from graspfx.spatial import Quaternion, quaternion
from graspfx.surfaces.closed_form import proxy

UPRIGHT = (1.0, 0.0, 0.0, 0.0)
ALONG_X = (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0)  # a capsule's axis in the plane; MuJoCo's is z
FLATTEST = 2e-4  # ratio of thickness to width of a flat mesh, since MuJoCo needs a volume and has 24 bits
THICK = 1.0  # relative to the largest size: thickness of shapes in a plane or on a line


@dataclass(frozen=True)
class Geometry:
    """A convex shape in its body's frame.

    Attributes:
        kind: MuJoCo's name of the kind.
        size: Size in MuJoCo's convention; unused for a mesh.
        points: Vertices of a mesh, (n, 3); None for other shapes.
        position: Position, (3,) [m].
        quaternion: Orientation w, x, y, z.
    """

    kind: str
    size: tuple[float, ...] = ()
    points: FloatArray | None = None
    position: tuple[float, ...] = (0.0, 0.0, 0.0)
    quaternion: tuple[float, ...] = UPRIGHT

    def at(self, position: FloatArray, rotation: FloatArray) -> Geometry:
        """Return the shape, which is centred at the origin, placed and rotated in the frame of its body."""
        r, i, j, k = self.quaternion
        x, y, z, w = numbers(quaternion(rotation.ravel().tolist()) @ Quaternion(i, j, k, r))
        return replace(self, position=tuple(position.tolist()), quaternion=(w, x, y, z))


def geometries(shape: Any, d: int, *, fixed: bool = False) -> Iterator[Geometry]:
    """List MuJoCo's shapes for a shape of the scene; an empty list for None.

    Args:
        shape: Shape of the scene.
        d: Number of dimensions of the scene; shapes in a plane or on a line are extruded.
        fixed: True if a concave mesh stays concave; otherwise its convex hull is used.

    Raises:
        InputError: If a plane or half-space is not an obstacle, or MuJoCo has no such shape.
    """
    if shape is None:
        return
    if hasattr(shape, "vertices"):
        if fixed:
            yield from (Geometry("MESH", points=p) for p in parts(shape.vertices, shape.faces, shell=shape.shell))
        else:
            yield Geometry("MESH", points=_with_volume(hull_points(shape.vertices)))
        return
    if shape.kind in FLAT_KINDS:
        raise InputError("shape", shape, "a bounded shape", "make it an obstacle")
    a, b, c = shape.parameters
    if shape.kind == proxy.BOX:
        across = THICK * max(a, b, c)
        yield Geometry("BOX", (a, b if d > 1 else across, c if d > 2 else across))
    elif shape.kind == proxy.SPHERE:
        yield Geometry("SPHERE", (a, 0.0, 0.0))
    elif shape.kind == proxy.CAPSULE:
        yield Geometry("CAPSULE", (a, b, 0.0), quaternion=UPRIGHT if d > 2 else ALONG_X)
    elif shape.kind == proxy.CYLINDER:
        yield Geometry("CYLINDER", (a, b, 0.0))
    elif shape.kind == proxy.ELLIPSOID:
        yield Geometry("ELLIPSOID", (a, b, c if d > 2 else THICK * max(a, b)))
    else:
        raise InputError(
            "shape", shape, "a shape that MuJoCo supports", "add it to `geometries`, or use other dynamics"
        )


def _with_volume(points: FloatArray) -> FloatArray:
    """Duplicate coplanar vertices on both sides of their plane; return other vertices unchanged."""
    _, widths, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    if widths[2] > SHEET * widths[0]:
        return points
    offset = 0.5 * FLATTEST * float(np.ptp(points, axis=0).max()) * axes[2]
    return np.vstack([points - offset, points + offset])
