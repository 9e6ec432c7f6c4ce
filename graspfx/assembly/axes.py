"""Gains that are matrices: whether the axes in which they stand let springs create energy on a turning object."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from graspfx.assembly.grasps import grasps
from graspfx.assembly.resolve import Parts
from graspfx.coupling import block as at
from graspfx.coupling.closed_motion import CREATES, TURN, worst_turn

if TYPE_CHECKING:
    from graspfx.scene.model import Scene


def axes_notes(parts: Parts) -> list[str]:
    """Say how much energy the gains of each object create on a closed turn, where they stand in axes that allow it.

    Those are the world's axes, and any axes where the reaction acts at the contact. The figure is the line integral of
    `worst_turn` about the grasp at the start, without cones.
    """
    return list(_notes(parts)) if _has_axes(parts.scene) else []


def _has_axes(scene: Scene) -> bool:
    """Tell whether a gain is a matrix, and stands where springs may create energy."""
    rules = scene.coupling
    sound = rules.axes != "world" and rules.reaction == "fingertip"
    if hasattr(rules.external, "object_stiffness"):
        return scene.dimensions > 1 and not sound
    gains = [gain for part in (rules.external, rules.internal) for gain in (part.stiffness, part.damping)]
    return scene.dimensions > 1 and not sound and any(np.ndim(gain) > 1 for gain in gains)


def _notes(parts: Parts) -> Iterator[str]:
    rules = parts.scene.coupling
    for part in grasps(parts):
        if not part.grasped.block[at.TURNS]:
            continue
        energy = worst_turn(part.grasped, part.grasped.finger_position.copy())
        if abs(energy.share) <= CREATES:
            continue
        where = f"in {rules.axes} axes" + (" with reaction = 'contact'" if rules.reaction == "contact" else "")
        yield (
            f"gains that are matrices {where} create energy on {part.name} as it turns: up to "
            f"{100.0 * abs(energy.share):.2g} % of the largest stored on a closed turn of +-{TURN:g} rad; "
            "axes = 'object' with reaction = 'fingertip' and form = 'symmetric' creates none"
        )
