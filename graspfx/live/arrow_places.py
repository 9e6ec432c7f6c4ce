"""Arrows of a frame's forces: where they begin and end, beside the object and beside one another."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.live.frame import Frame

FloatArray = NDArray[np.float64]

LONGEST = 0.42  # as a share of the extent, of an arrow
SHORTEST = 0.04  # as a share of the longest: below this a force is no arrow
BESIDE = 0.014  # from an arrow's line to where it is drawn, as a share of the extent
NICE = (1.0, 2.0, 5.0)
LEAST_FORCE, MOST_FORCE = 1e-6, 1e6  # that an arrow of full length stands for [N]


class Arrow(NamedTuple):
    """An arrow of a force.

    Attributes:
        finger: its number.
        is_internal: whether it squeezes, else it pushes.
        at: on the fingertip, where it ends, or begins if it pulls (3,) [m].
        along: unit vector of the force (3,).
        length: [m].
        pulls: whether it leads away from the object.
    """

    finger: int
    is_internal: bool
    at: FloatArray
    along: FloatArray
    length: float
    pulls: bool


def arrows(frame: Frame, scale: float, radii: FloatArray, extent: float, towards: FloatArray) -> list[Arrow]:
    """Place internal and external forces: outside of the object, ending where one pushes in, beginning where it pulls.

    Args:
        frame: the instant.
        scale: [m/N].
        radii: of the fingertips (n,) [m].
        extent: of the scene [m].
        towards: unit vector to the camera (3,), across which the two of a finger stand side by side.
    """
    result = list[Arrow]()
    for is_internal, forces in ((True, frame.internal), (False, frame.external)):
        if forces is None or frame.force is None:
            continue
        sizes = np.linalg.norm(forces, axis=1)
        seen = np.isfinite(sizes) & (sizes * scale > SHORTEST * LONGEST * extent)
        for i in np.flatnonzero(seen & np.isfinite(frame.fingertips).all(axis=1)):
            along = forces[i] / sizes[i]
            sideways = np.cross(towards, frame.force[i])
            width = float(np.linalg.norm(sideways))
            sideways = (
                (1.0 if is_internal else -1.0) * BESIDE * extent * sideways / width if width > 0.0 else np.zeros(3)
            )
            pulls = bool(forces[i] @ frame.force[i] < 0.0)
            at = frame.fingertips[i] + sideways + (1.0 if pulls else -1.0) * radii[i] * along
            length = min(float(sizes[i]) * scale, 3.0 * LONGEST * extent)
            result.append(Arrow(int(i), is_internal, at, along, length, pulls))
    return result


class Scale:
    """A scale of arrows that is 1, 2 or 5 times a power of ten, and changes only when forces leave its range.

    Args:
        extent: of the scene [m].

    Attributes:
        full: force of which an arrow has its full length [N].
        metres: of an arrow for a newton [m/N].
    """

    def __init__(self, extent: float) -> None:
        self._extent = extent
        self._greatest = 0.0
        self.full = 0.0

    @property
    def metres(self) -> float:
        return LONGEST * self._extent / (self.full or 1.0)

    def follow(self, frame: Frame, seconds: float) -> bool:
        """Take the forces of a frame into account, `seconds` after the last; tell whether the scale changes."""
        parts = [part for part in (frame.internal, frame.external) if part is not None]
        now = max((float(np.nanmax(np.linalg.norm(part, axis=1), initial=0.0)) for part in parts), default=0.0)
        now = min(now, MOST_FORCE) if np.isfinite(now) else 0.0
        self._greatest = max(now, self._greatest * 0.5 ** (seconds / 4.0))  # halves in 4 s
        if self._greatest < LEAST_FORCE or (self.full / 6.0 < self._greatest <= self.full):
            return False
        before, self.full = self.full, _nice_above(1.1 * self._greatest)
        return self.full != before

    @property
    def text(self) -> str:
        """How long an arrow of a force is, in words."""
        return f"1 N is {1e3 * self.metres:.3g} mm long" if self.full else "no force yet"


def _nice_above(value: float) -> float:
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(each * power for each in (*NICE, 10.0) if each * power >= value * (1.0 - 1e-9)))
