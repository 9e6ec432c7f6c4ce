"""Report of a run's couplings, for its outcome."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from graspfx.loop.parts import GraspedPart


def coupling_report(objects: Sequence[GraspedPart]) -> dict[str, Any]:
    """Report the couplings of objects on the run so far, as entries of an `Outcome`."""
    grasps = [part.grasped for part in objects]
    return {
        "fade_shortfall": max(each.shortfall for each in grasps),
        "fade_needed": max(each.fade_needed for each in grasps),
        "blended": max(each.blended for each in grasps),
    }
