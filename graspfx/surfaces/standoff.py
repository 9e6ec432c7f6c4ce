"""Where a fingertip that comes in along a ray towards a shape's centre first has a given gap."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx.surfaces.closed_form.proxy import MESH

if TYPE_CHECKING:
    from graspfx.surfaces.closed_form.shape import Shape
    from graspfx.surfaces.triangles.mesh import Mesh

FloatArray = NDArray[np.float64]

MOST = 20_000  # steps on the way in: a ray that takes more goes along the surface
NEAR = 1e-6  # of the shape's extent: from there on the surface is followed by its normal
POLISH = 40  # steps of that
EXACT = 1e-16  # of the extent: what is left of the distance, below which no step helps
LEAST = 1e-9  # of the extent: what may be left of it where a ray only brushes the surface


def standoff(shape: Shape | Mesh, direction: FloatArray, distance: float) -> float | None:
    """Find the largest t at which t u is `distance` away from the shape, u the unit vector along the direction [m].

    From outside the distance to a shape is also how far one may go without meeting it, so that stepping by it comes to
    the outermost such point and never past it (J. C. Hart, Sphere tracing, The Visual Computer 12, 1996); Newton's
    method along the normal does the rest. The distance is the gap that a finger's contact has.

    Args:
        shape: about its centre.
        direction: of any length above zero, in the shape's frame (d,).
        distance: from the surface, zero or more [m].

    Returns:
        t; None where the ray never is that near.
    """
    u = direction / np.linalg.norm(direction)
    if getattr(shape, "endless", False):
        climb = -float(_gap(shape, u, 1.0)[1] @ u)  # from a plane's either side
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
    """Take the last steps: Newton's, and halves of the interval where one of them leaves it."""
    best, low, high = (np.inf, t), -np.inf, np.inf
    for _ in range(POLISH):
        gap, inward = _gap(shape, u, t)
        left = gap - distance
        best = min(best, (abs(left), t))
        if abs(left) <= EXACT * extent:
            break
        low, high = (t, high) if left < 0.0 else (low, t)
        slope = -float(inward @ u)
        newton = t - left / slope if slope > 0.0 else -np.inf
        t = newton if low < newton < high else 0.5 * (low + high)
        if not np.isfinite(t) or t in (low, high):
            break
    return best[1] if best[0] <= LEAST * extent else None


def _gap(shape: Shape | Mesh, u: FloatArray, t: float) -> tuple[float, FloatArray]:
    """Give the gap of a point on the ray, and the normal into the shape there."""
    contact = shape.contact((t * u)[None])
    return float(contact.gap[0]), contact.normal[0]


def _extent(shape: Shape | Mesh) -> float:
    """Give a length within which all of the shape is about its centre [m]."""
    if shape.kind == MESH:
        return float(np.linalg.norm(shape.vertices, axis=1).max())  # type: ignore[union-attr]
    return float(sum(shape.parameters))
