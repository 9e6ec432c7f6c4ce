"""Position on a ray from a shape's centre at which a fingertip has a given distance from the shape."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx.surfaces.closed_form.proxy import MESH

if TYPE_CHECKING:
    from graspfx.surfaces.closed_form.shape import Shape
    from graspfx.surfaces.triangles.mesh import Mesh

FloatArray = NDArray[np.float64]

MOST = 20_000  # steps; a ray that needs more runs along the surface
NEAR = 1e-6  # relative to the shape's extent: closer than this, steps follow the surface normal
POLISH = 40  # largest number of those steps
EXACT = 1e-16  # relative to the extent: remaining distance at which no step improves the result
LEAST = 1e-9  # relative to the extent: remaining distance that is accepted if a ray only grazes the surface


def standoff(shape: Shape | Mesh, direction: FloatArray, distance: float) -> float | None:
    """Find the outermost point of a ray from a shape's centre that has a given distance from the shape.

    The search starts outside the shape and uses sphere tracing: each step towards the centre is as long as the distance
    to the shape, so that no step passes the point (J. C. Hart, Sphere tracing, The Visual Computer 12, 1996). The last
    steps use Newton's method. The distance to the shape is the gap of a point finger's contact.

    Args:
        shape: Shape with its centre at the origin.
        direction: Direction of the ray in the shape's frame, of any non-zero length (d,).
        distance: Distance of the point from the surface, not negative [m].

    Returns:
        Distance of the point from the centre [m], or None if no point of the ray has the given distance.
    """
    u = direction / np.sqrt((direction * direction).sum())
    if getattr(shape, "endless", False):
        climb = -float((_gap(shape, u, 1.0)[1] * u).sum())  # valid on either side of a plane
        return distance / climb if climb > 0.0 else None
    extent = _extent(shape)
    t = extent + distance
    for _ in range(MOST):
        left = _gap(shape, u, t)[0] - distance
        if left <= NEAR * extent:
            return _polished(shape, u, t, distance, extent)
        t -= left
        if t <= 0.0:
            return None
    return None


def _polished(shape: Shape | Mesh, u: FloatArray, t: float, distance: float, extent: float) -> float | None:
    """Refine t by Newton's method, with bisection if a step leaves the bracket; return None without convergence."""
    best, low, high = (np.inf, t), -np.inf, np.inf
    for _ in range(POLISH):
        gap, inward = _gap(shape, u, t)
        left = gap - distance
        best = min(best, (abs(left), t))
        if abs(left) <= EXACT * extent:
            break
        low, high = (t, high) if left < 0.0 else (low, t)
        slope = -float((inward * u).sum())
        newton = t - left / slope if slope > 0.0 else -np.inf
        t = newton if low < newton < high else 0.5 * (low + high)
        if not np.isfinite(t) or t in (low, high):
            break
    return best[1] if best[0] <= LEAST * extent else None


def _gap(shape: Shape | Mesh, u: FloatArray, t: float) -> tuple[float, FloatArray]:
    """Return the gap [m] and the inward normal (d,) of the contact of a point finger at t u."""
    contact = shape.contact((t * u)[None])
    return float(contact.gap[0]), contact.normal[0]


def _extent(shape: Shape | Mesh) -> float:
    """Return an upper bound on the distance of the shape's points from its centre [m]."""
    if shape.kind == MESH:
        return float(np.linalg.norm(shape.vertices, axis=1).max())  # type: ignore[union-attr]
    return float(sum(shape.parameters))
