"""Bodies and obstacles of a world, and the contact law between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.records import numbers
from graspfx.spatial import Quaternion, angle_matrix, quaternion_matrix

FloatArray = NDArray[np.float64]

STIFFNESS = 1e5  # stiffness of a native contact point [N/m]: 0.1 kg on four points sinks by 2.5 um


@dataclass(frozen=True)
class Member:
    """Block (SIZE,) and shape of a body in a world; the shape is None for a body without contacts."""

    state: FloatArray
    shape: Any


@dataclass(frozen=True)
class Obstacle:
    """A fixed shape at `position` (3,) [m], rotated by `rotation` (3, 3)."""

    name: str
    shape: Any
    position: FloatArray
    rotation: FloatArray


@dataclass(frozen=True)
class Meeting:
    """Parameters of the contacts in a world.

    Attributes:
        friction: Coefficient of friction of all contacts.
        restitution: Ratio of the separation speed to the approach speed, 0 to 1.
        stiffness: Stiffness of a contact point of a native body [N/m].
        collide: Whether the bodies collide with one another, in addition to obstacles.
    """

    friction: float = 0.5
    restitution: float = 0.0
    stiffness: float = STIFFNESS
    collide: bool = True


def place_obstacle(
    name: str, shape: Any, d: int, position: Any = None, orientation: float | tuple[float, ...] | None = None
) -> Obstacle:
    """Return an obstacle in d dimensions at a position (d,) [m], with an angle [rad] or a quaternion (x, y, z, w)."""
    x = np.zeros(3)
    if position is not None:
        x[:d] = position
    if d == 3:
        q = np.array((0.0, 0.0, 0.0, 1.0) if orientation is None else orientation, dtype=float)
        R = quaternion_matrix(Quaternion(*(q / np.linalg.norm(q)).tolist()))
    else:
        R = angle_matrix(float(np.asarray(orientation)) if orientation is not None else 0.0)
    return Obstacle(name, shape, x, np.array(list(numbers(R))).reshape(3, 3))
