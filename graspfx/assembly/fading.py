"""Where free fingers leave the split: `coupling.fade = "auto"` begins where the squeeze of the hands asks for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.still_hands import most_forces
from graspfx.coupling.fade import FADE, gaps, release_compliance
from graspfx.loop.parts import GraspedPart

if TYPE_CHECKING:
    from graspfx.assembly.resolve import Parts

FloatArray = NDArray[np.float64]


def set_fade(parts: Parts, objects: Sequence[GraspedPart], inward: FloatArray, start: FloatArray) -> None:
    """Let an automatic fade begin where the squeeze of the hands asks for it: fingers have met their objects.

    h1 = 1/2 |1/kep - 1/kip| sum |f|, |f| the most with which a hand squeezes, and 2 mm at least; h2 = h1 + 8 mm.
    """
    rules = parts.scene.coupling
    if rules.fade != "auto" or rules.absent == "follow" or rules.contact == "attached":
        return
    compliance = [release_compliance(each.grasped.law, len(each.fingers), start.shape[1]) for each in objects]
    if not any(compliance):
        return
    for each, soft, push in zip(objects, compliance, squeezes(parts, objects, inward), strict=True):
        fade = gaps(soft * push)
        if fade != FADE:
            each.grasped.set_fade(*fade)
            each.grasped.meet(start[each.fingers])


def squeezes(parts: Parts, objects: Sequence[GraspedPart], inward: FloatArray) -> list[float]:
    """Add up the most that hands squeeze each object with, sum |f| [N]: fingers have met their objects."""
    contacts = parts.start.copy()
    for each in objects:
        contacts[each.fingers] = each.grasped.contact_position
    forces = most_forces(parts, inward, contacts)
    return [float(forces[each.fingers].sum()) for each in objects]
