"""Result of all contact kernels: the contact of a finger with a surface."""

from __future__ import annotations

from dataclasses import dataclass

from graspfx.spatial import Vector


@dataclass(frozen=True, slots=True)
class Nearest:
    """Contact in the object's frame: for a point finger at p, contact point c and normal n satisfy p - c = -gap n."""

    face: int  # face of the contact, an input of the next sample
    point: Vector  # c, on the surface [m]
    normal: Vector  # n, unit normal into the object
    gap: float  # > 0 outside [m]
