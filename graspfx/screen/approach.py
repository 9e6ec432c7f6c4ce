"""A point that goes to its goal by no more than a length at a time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def approach(point: FloatArray, goal: FloatArray, most: float) -> None:
    """Move a point (d,) to its goal (d,), or by `most` towards it [m]."""
    way = goal - point
    far = float(np.linalg.norm(way))
    if far <= most:
        point[...] = goal
    else:
        point += way * (most / far)
