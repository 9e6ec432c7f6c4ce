"""Short runs of scenes of the shelf, each run once: for tests of what draws recordings."""

from __future__ import annotations

from functools import cache

import graspfx as gx
from graspfx.recording.record import Recording

SECONDS = {  # by scene: in the plane, in space, with a mesh and a table, on a line, with two objects
    "paper-waving": 2.0, "sphere-three-fingers": 0.8, "mug": 0.5, "reference-1dof": 0.4, "two-objects": 0.5,
}  # fmt: skip


@cache
def played(name: str) -> Recording:
    """Run a scene for a short while."""
    return gx.run(gx.load(name).replace({"duration": SECONDS[name], "engine": "interpreted"}))
