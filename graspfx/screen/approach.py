"""Motion of a point towards a goal by bounded steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def approach(point: FloatArray, goal: FloatArray, most: float) -> None:
    """Move a point (d,) towards a goal (d,) by at most `most` [m], in place."""
    way = goal - point
    far = float(np.linalg.norm(way))
    if far <= most:
        point[...] = goal
    else:
        point += way * (most / far)
