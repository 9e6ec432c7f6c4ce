"""Intended motions of a hand: translations, and rotations about an axis."""

from __future__ import annotations

from graspfx.loop.motion.motion import Levels, Motion, Path, Reach, Rest, Sine, Sum
from graspfx.loop.motion.turn import Turn

__all__ = ["Levels", "Motion", "Path", "Reach", "Rest", "Sine", "Sum", "Turn"]
