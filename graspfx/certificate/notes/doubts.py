"""Notes on a scene that is valid and yet may not be meant."""

from __future__ import annotations

from graspfx.certificate.notes.depth_damping import depth_notes
from graspfx.certificate.notes.former_names import former_notes
from graspfx.certificate.notes.settling import unsettled
from graspfx.certificate.notes.units import unit_notes
from graspfx.scene.model import Scene


def doubts(scene: Scene) -> list[str]:
    """A sentence for each."""
    return [*former_notes(scene), *unit_notes(scene), *depth_notes(scene), *unsettled(scene)]
