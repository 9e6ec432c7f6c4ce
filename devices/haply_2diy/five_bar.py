"""The five-bar linkage of a planar device: two motors side by side, two links each, one handle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspfx.protocols import DeviceError, InputError

FloatArray = NDArray[np.float64]
Pair = tuple[float, float]


@dataclass(frozen=True)
class FiveBar:
    """Five-bar kinematics: A and B are the tips of the links at the motors, p is the handle, |p - A| = |p - B| = L.

        A = (-d/2, 0) + l (cos q1, sin q1),   B = (d/2, 0) + l (cos q2, sin q2),
        J = [(p - A)'; (p - B)']^-1 diag((p - A)'dA/dq1, (p - B)'dB/dq2)

    The origin is midway between the motors; x points from motor 1 to motor 2, y from the motors to the handle.

    Args:
        links: Lengths l at the motors and L to the handle [m].
        distance: Distance d between the motors [m]; 0 if the motors share an axis.
        margin: Smallest distance from the stretched posture, as the height of the triangle A, p, B [m].
    """

    links: Pair
    distance: float
    margin: float

    def __post_init__(self) -> None:
        if not 0.0 < self.margin < min(self.links):
            raise InputError("margin", self.margin, f"a length between 0 and the shorter link, {min(self.links):g} m")

    @property
    def reach(self) -> tuple[FloatArray, FloatArray]:
        """Corners of a box around all positions that both sides reach [m]."""
        far = sum(self.links)
        across = far - self.distance / 2.0
        return np.array([-across, 0.0]), np.array([across, math.sqrt(far**2 - self.distance**2 / 4.0)])

    def handle(self, q1: float, q2: float) -> tuple[Pair, FloatArray]:
        """Return the handle's position (x, y) [m] and J = dp/dq (2, 2) [m] at the motors' angles [rad].

        Raises:
            DeviceError: If the links do not meet, or are closer than `margin` to the stretched or folded posture.
        """
        (inner, outer), half = self.links, self.distance / 2.0
        c1, s1, c2, s2 = math.cos(q1), math.sin(q1), math.cos(q2), math.sin(q2)
        ax, ay, bx, by = inner * c1 - half, inner * s1, inner * c2 + half, inner * s2
        dx, dy = bx - ax, by - ay
        apart = math.hypot(dx, dy)
        height = outer * outer - 0.25 * apart * apart
        if not (height >= self.margin * self.margin and apart >= self.margin):
            raise DeviceError(
                f"the links at {math.degrees(q1):.1f} and {math.degrees(q2):.1f} degrees have their tips {apart:.4f} m "
                f"apart: the handle is at the end of its reach ({self.margin:g} m short of the stretched and folded "
                "postures), or was not at home when the device was opened"
            )
        away = math.sqrt(height) / apart
        x, y = 0.5 * (ax + bx) - away * dy, 0.5 * (ay + by) + away * dx
        ux, uy, vx, vy = x - ax, y - ay, x - bx, y - by
        first, second = inner * (uy * c1 - ux * s1), inner * (vy * c2 - vx * s2)
        scale = 1.0 / (ux * vy - uy * vx)
        J = np.array([[vy * first, -uy * second], [-vx * first, ux * second]]) * scale
        return (x, y), J
