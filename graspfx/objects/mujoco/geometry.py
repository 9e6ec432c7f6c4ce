"""Shapes as MuJoCo has them: its own kinds, convex hulls, and concave obstacles as one piece for each triangle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from graspfx.compile.records import numbers
from graspfx.errors import InputError
from graspfx.objects.body import FloatArray
from graspfx.objects.floor.hull import SHEET, hull_points
from graspfx.objects.mujoco.tetrahedra import parts
from graspfx.spatial import quaternion
from graspfx.surfaces.closed_form import proxy

UPRIGHT = (1.0, 0.0, 0.0, 0.0)
FLATTEST = 2e-4  # thickness over width that a flat mesh gets: MuJoCo takes none without volume, and has 24 bits
THICK = 1.0  # of shapes in a plane or on a line, across it, over their largest size


@dataclass(frozen=True)
class Geometry:
    """A convex shape in its body's frame.

    Attributes:
        kind: MuJoCo's name.
        size: as MuJoCo takes it; of no use to a mesh.
        points: (n, 3) corners of a mesh; None for every other shape.
        position: (3,) [m]; quaternion: w, x, y, z.
    """

    kind: str
    size: tuple[float, ...] = ()
    points: FloatArray | None = None
    position: tuple[float, ...] = (0.0, 0.0, 0.0)
    quaternion: tuple[float, ...] = UPRIGHT

    def at(self, position: FloatArray, rotation: FloatArray) -> Geometry:
        """Give the shape of a body at the world's origin, placed and turned."""
        x, y, z, w = numbers(quaternion(rotation.ravel().tolist()))
        return replace(self, position=tuple(position.tolist()), quaternion=(w, x, y, z))


def geometries(shape: Any, d: int, *, fixed: bool = False) -> Iterator[Geometry]:
    """List the shapes that stand for one; none for None.

    Args:
        shape: of the scene.
        d: dimensions of the scene; a shape of a plane or a line is made thick across it.
        fixed: whether a mesh keeps its hollows; else it is its convex hull.

    Raises:
        InputError: a plane or half-space that is not an obstacle.
    """
    if shape is None:
        return
    if hasattr(shape, "vertices"):
        if fixed:
            yield from (Geometry("MESH", points=p) for p in parts(shape.vertices, shape.faces, shell=shape.shell))
        else:
            yield Geometry("MESH", points=_with_volume(hull_points(shape.vertices)))
        return
    a, b, c = shape.parameters
    if shape.kind == proxy.BOX:
        across = THICK * max(a, b, c)
        yield Geometry("BOX", (a, b if d > 1 else across, c if d > 2 else across))
    elif shape.kind == proxy.SPHERE:
        yield Geometry("SPHERE", (a, 0.0, 0.0))
    elif shape.kind == proxy.CAPSULE:
        yield Geometry("CAPSULE", (a, b, 0.0))
    elif shape.kind == proxy.CYLINDER:
        yield Geometry("CYLINDER", (a, b, 0.0))
    elif shape.kind == proxy.ELLIPSOID:
        yield Geometry("ELLIPSOID", (a, b, c))
    else:
        raise InputError("shape", shape, "one that has an end", "make it an obstacle")


def _with_volume(points: FloatArray) -> FloatArray:
    """Give corners that lie in a plane twice, on both sides of it; any others as they are."""
    _, widths, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    if widths[2] > SHEET * widths[0]:
        return points
    offset = 0.5 * FLATTEST * float(np.ptp(points, axis=0).max()) * axes[2]
    return np.vstack([points - offset, points + offset])
