"""All warnings about likely mistakes in a valid scene."""

from __future__ import annotations

from graspfx.build.checks.units import unit_notes
from graspfx.build.resolve import Parts
from graspfx.certificate.notes.depth_damping import depth_notes
from graspfx.certificate.notes.former_names import former_notes
from graspfx.certificate.notes.settling import unsettled


def doubts(parts: Parts) -> list[str]:
    """List warnings about likely mistakes, a sentence each: units first."""
    return [*unit_notes(parts.scene, parts.stock), *other_doubts(parts)]


def other_doubts(parts: Parts) -> list[str]:
    """List those that are not about units: of meshes, former names, depths, gains that do not settle."""
    return [*parts.mesh_notes, *former_notes(parts.scene), *depth_notes(parts.scene), *unsettled(parts)]
