"""Position along a ray to a shape's centre at which an approaching fingertip has a given gap."""

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
    """Find the largest t at which t u has the distance `distance` from the shape, for the direction's unit vector u.

    From outside, a step as long as the distance to a shape cannot pass through the shape. These steps converge to the
    outermost point and never pass it (J. C. Hart, Sphere tracing, The Visual Computer 12, 1996). The last steps use
    Newton's method along the normal. The distance is the gap of the finger's contact.

    Args:
        shape: Shape about its centre.
        direction: Direction of any non-zero length in the shape's frame, (d,).
        distance: Distance from the surface, zero or more [m].

    Returns:
        t [m], or None if the ray never comes that close to the shape.
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
    """Take the last steps by Newton's method, with bisection if a step leaves the interval."""
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
    """Return the gap of a point on the ray, and the normal into the shape there."""
    contact = shape.contact((t * u)[None])
    return float(contact.gap[0]), contact.normal[0]


def _extent(shape: Shape | Mesh) -> float:
    """Return an upper bound on the distance of the shape's points from its centre [m]."""
    if shape.kind == MESH:
        return float(np.linalg.norm(shape.vertices, axis=1).max())  # type: ignore[union-attr]
    return float(sum(shape.parameters))
