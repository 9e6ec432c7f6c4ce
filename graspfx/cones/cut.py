"""A limit on a finger's force: its cone cut off by a ball, so that the projection stays the gradient of a convex sum.

The cone is one about the origin and so is the ball, so that the nearest force in both is the nearest one in the cone,
shortened to the limit. A soft finger's torsion counts with its force, in units of the patch length, where friction
bounds both; where it bounds nothing only the force is shortened.
"""

from __future__ import annotations

import math
from typing import Any

NO_CONE = -1.0  # as a coefficient: a bilateral contact
HALF_SPACE = -2.0  # as a coefficient: a contact that holds sideways whatever it takes, and only pushes
LIFT = 3  # status of a contact of the half-space whose normal force is zero


def force_size(S: Any, y: int, width: int) -> float:
    """Give |y_i| over `width` entries from y on."""
    total = 0.0
    for a in range(width):
        total += S[y + a] * S[y + a]
    return math.sqrt(total)


def limit_width(S: Any, mu: int, d: int) -> int:
    """Count the coordinates that a finger's limit is about: all in a friction cone, else (mu < 0) the force alone."""
    return d if S[mu] >= 0.0 else min(d, 3)


def shorten(S: Any, y: int, width: int, limit: float) -> float:
    """Shorten the force at y to the limit; returns the factor, 1 where it was short enough."""
    size = force_size(S, y, width)
    if not size > limit:
        return 1.0
    for a in range(width):
        S[y + a] *= limit / size
    return limit / size


def cone_slope(
    status: int, mu: float, theta: float, c1: float, c2: float, c3: float, bend: float,
    x0: float, x1: float, x2: float, x3: float,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Give R'x of the return map without a limit, from what `turn_back` gives: x where the finger sticks (status 1)."""
    if status == LIFT:
        return 0.0, x1, x2, x3
    if status == 1:
        return x0, x1, x2, x3
    if status == 0:
        return 0.0, 0.0, 0.0, 0.0
    along = c1 * x1 + c2 * x2 + c3 * x3
    normal = (x0 + theta * mu * along) / (1.0 + theta * mu * mu)
    return (
        normal,
        mu * c1 * normal + bend * (x1 - c1 * along),
        mu * c2 * normal + bend * (x2 - c2 * along),
        mu * c3 * normal + bend * (x3 - c3 * along),
    )


def ball_slope(
    S: Any, y: int, width: int, limit: float, x0: float, x1: float, x2: float, x3: float
) -> tuple[float, float, float, float]:
    """Give the slope of `shorten` at the force y times x: limit/|y| (x - y y'x/|y|^2), or x where y is short enough."""
    size = force_size(S, y, width)
    if not size > limit:
        return x0, x1, x2, x3
    share = limit / size
    y0, y1, y2, y3 = S[y] / size, 0.0, 0.0, 0.0
    if width > 1:
        y1 = S[y + 1] / size
    if width > 2:
        y2 = S[y + 2] / size
    if width > 3:
        y3 = S[y + 3] / size
    along = y0 * x0 + y1 * x1 + y2 * x2 + y3 * x3
    last = share * (x3 - along * y3) if width > 3 else x3
    return share * (x0 - along * y0), share * (x1 - along * y1), share * (x2 - along * y2), last
