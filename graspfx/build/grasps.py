"""The grasps of a scene at the start, as its couplings see them: nothing is opened, nothing moves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from graspfx.build.build import grasped_object, set_fade
from graspfx.build.mechanics import device_masses
from graspfx.loop.parts import Held
from graspfx.objects.body import NativeBody

if TYPE_CHECKING:
    from graspfx.scene.model import Scene


def grasps(scene: Scene) -> list[Held]:
    """Make the objects that fingers are assigned to, with their contacts where the fingers meet them."""
    masses = device_masses(scene) if scene.coupling.metric == "mass" else None
    start = np.array([finger.start for finger in scene.finger], dtype=float)
    inward = np.zeros_like(start)
    found = []
    for index in sorted(set(scene.finger_objects)):
        grasped, fingers = grasped_object(scene, index, masses)
        if grasped.implicit:
            NativeBody(grasped.body_state).free_motion(scene.period)  # its samples are about the next pose
        grasped.meet(start[fingers])
        inward[fingers] = grasped.inward()
        grasped.finger_position[:] = start[fingers]
        found.append(Held(scene.object[index].name, grasped, fingers))
    set_fade(scene, found, start, inward)
    return found
