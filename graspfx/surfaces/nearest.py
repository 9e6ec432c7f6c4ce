"""Where a finger touches a surface, as kernels of all surfaces give it."""

from __future__ import annotations

from dataclasses import dataclass

from graspfx.spatial import Vector


@dataclass(frozen=True, slots=True)
class Nearest:
    """A contact in the object's frame: p - c = -gap n of a finger at p."""

    face: int  # on which the contact is, to be given again with the next sample
    point: Vector  # c, on the surface [m]
    normal: Vector  # n, unit, into the object
    gap: float  # above zero outside [m]
