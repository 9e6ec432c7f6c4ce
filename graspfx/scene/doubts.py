"""Notes on a scene that is valid and yet may not be meant."""

from __future__ import annotations

from graspfx.scene.damping import depth_notes
from graspfx.scene.model import Scene
from graspfx.scene.settling import unsettled
from graspfx.scene.units import unit_notes


def doubts(scene: Scene) -> list[str]:
    """A sentence for each."""
    return [*unit_notes(scene), *depth_notes(scene), *unsettled(scene)]
