"""Runs with values that change at ticks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import graspfx as gx

KEP, KED, KIP, KID = (f"coupling.{a}.{b}" for a in ("external", "internal") for b in ("stiffness", "damping"))
TICKS = 90


def steered(scene: gx.Scene, course: Mapping[int, Mapping[str, Any]], ticks: int = TICKS) -> gx.Recording:
    """A run with values changed at ticks."""
    live = {key for values in course.values() for key in values}
    with gx.open(scene, live=sorted(live)) as session:
        for tick in sorted(course):
            if tick > session.tick:
                session.step(tick - session.tick)
            session.set(course[tick])
        session.step(ticks - session.tick)
    return session.recording
