"""Contact of a finger with a surface, as every surface kernel returns it."""

from __future__ import annotations

from dataclasses import dataclass

from graspfx.spatial import Vector


@dataclass(frozen=True, slots=True)
class Nearest:
    """Contact in the object's frame, with p - c = -gap n for a finger at p."""

    face: int  # face of the contact, an input of the next sample
    point: Vector  # c, on the surface [m]
    normal: Vector  # n, unit normal into the object
    gap: float  # > 0 outside [m]
