"""The grasps of a scene at the start, as its couplings see them: nothing is opened, nothing moves."""

from __future__ import annotations

import numpy as np

from graspfx.assembly.fading import set_fade
from graspfx.assembly.resolve import Parts
from graspfx.loop.parts import GraspedPart
from graspfx.objects.body import NativeBody


def grasps(parts: Parts) -> list[GraspedPart]:
    """Make the objects that fingers are assigned to, with their contacts where the fingers meet them."""
    start = parts.start
    inward = np.zeros_like(start)
    objects = []
    for part in parts.objects:
        if not len(part.fingers):
            continue
        grasped, fingers = part.grasped(), part.fingers
        if grasped.implicit:
            NativeBody(grasped.body_state).free_motion(parts.scene.period)  # its samples are about the next pose
        grasped.meet(start[fingers])
        inward[fingers] = grasped.inward()
        grasped.finger_position[:] = start[fingers]
        objects.append(GraspedPart(part.name, grasped, fingers))
    set_fade(parts, objects, inward, parts.start)
    return objects
