"""How far a gain reaches, and where that is looked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LEAST, MOST = 0.01, 100.0  # of a gain: where it is looked for
GRID = 64  # factors between them, 16 % apart: a gap in what is stable narrower than that can be missed
ROUNDS = 8  # in which another root is looked for that crosses earlier
BEYOND = 1e-9  # of the limit: where the root that has crossed is looked at
FACTORS_ABOVE = tuple(np.geomspace(1.0, MOST, GRID // 2).tolist())
FACTORS_BELOW = tuple(np.geomspace(LEAST, 1.0, GRID // 2).tolist())


@dataclass(frozen=True)
class Reach:
    """The largest factor of a gain and the frequency of the oscillation that begins there [Hz]; inf, nan for none."""

    factor: float
    frequency: float
