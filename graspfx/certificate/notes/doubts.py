"""All warnings about likely mistakes in a valid scene."""

from __future__ import annotations

from graspfx.build.resolve import Parts
from graspfx.certificate.notes.depth_damping import depth_notes
from graspfx.certificate.notes.former_names import former_notes
from graspfx.certificate.notes.settling import unsettled
from graspfx.certificate.notes.units import unit_notes


def doubts(parts: Parts) -> list[str]:
    """List warnings about likely mistakes, a sentence each."""
    return [*former_notes(parts.scene), *unit_notes(parts.scene), *depth_notes(parts.scene), *unsettled(parts)]
