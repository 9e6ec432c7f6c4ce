"""What bodies meet: the members of a world, the obstacles in it, and the law of contact among them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.records import numbers
from graspfx.spatial import Quaternion, angle_matrix, quaternion_matrix

FloatArray = NDArray[np.float64]

STIFFNESS = 1e5  # of a native contact point [N/m]: 0.1 kg on four points sink by 2.5 um


@dataclass(frozen=True)
class Member:
    """A body's block (SIZE,) and its shape; without a shape it meets nothing."""

    state: FloatArray
    shape: Any


@dataclass(frozen=True)
class Obstacle:
    """A fixed shape, placed at `position` (3,) [m] and turned by `rotation` (3, 3)."""

    name: str
    shape: Any
    position: FloatArray
    rotation: FloatArray


@dataclass(frozen=True)
class Meeting:
    """The law of contact among bodies.

    Attributes:
        friction: Coulomb's coefficient of every pair.
        restitution: speed of parting over speed of meeting, 0 to 1.
        stiffness: of a contact point of a native body [N/m].
        collide: whether the members meet one another too.
    """

    friction: float = 0.5
    restitution: float = 0.0
    stiffness: float = STIFFNESS
    collide: bool = True


def placed(
    name: str, shape: Any, d: int, position: Any = None, orientation: float | tuple[float, ...] | None = None
) -> Obstacle:
    """An obstacle in d dimensions from a position (d,) and an angle [rad] or a quaternion x, y, z, w."""
    x = np.zeros(3)
    if position is not None:
        x[:d] = position
    if d == 3:
        q = np.array((0.0, 0.0, 0.0, 1.0) if orientation is None else orientation, dtype=float)
        R = quaternion_matrix(Quaternion(*(q / np.linalg.norm(q)).tolist()))
    else:
        R = angle_matrix(float(np.asarray(orientation)) if orientation is not None else 0.0)
    return Obstacle(name, shape, x, np.array(list(numbers(R))).reshape(3, 3))
