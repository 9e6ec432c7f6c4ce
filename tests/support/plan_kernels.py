"""The kernel of each step of a plan: a program contains it only if the step runs."""

from __future__ import annotations

from collections.abc import Iterator

from graspfx.certificate.plan import PlanRow, plan
from graspfx.scene.model import Scene

KERNELS = {
    "contact points": "touch",
    "fade": "fade",
    "split": "refactor",
    "torsion": "twist",
    "pads": "press",
    "damping by depth": "damping_share",
    "energy": "watch",
    "limit": "limit",
    "safety": "restrain",
    "soft start": "soften",
}
NATIVE = {"predict": "predict", "turn": "orient", "meet": "step_on_planes"}  # steps of native objects only


def rows_with_kernels(scene: Scene) -> Iterator[tuple[PlanRow, str]]:
    """The rows of a scene's plan that have a kernel of their own, with its name."""
    for row in plan(scene):
        first, _, name = row.step.partition(" ")
        group = [thing for thing in scene.object if thing.name == name or len(scene.object) == 1]
        if first in NATIVE and all(thing.dynamics == "native" for thing in group):
            yield row, NATIVE[first]
        elif row.step in KERNELS:
            yield row, KERNELS[row.step]
