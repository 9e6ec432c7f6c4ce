"""The scene paper-waving with rotation of the cube: eq. (27) for translation, and a rotational viscosity."""

from __future__ import annotations

import graspfx as gx

EDGE = 0.05  # [m]


def scene(rotational_viscosity: float | None = None) -> gx.Scene:
    """Make the scene, in which the cube can rotate.

    The rotation of the cube is the least stable mode of the grasp; it is unstable without rotational viscosity.

    Args:
        rotational_viscosity: Rotational viscosity [N m s/rad]; by default b_v a^2 / 6 with the cube's viscosity b_v and
            edge a. Rotation of the free cube then decays at the same rate as translation.
    """
    waving = gx.load("paper-waving")
    if rotational_viscosity is None:
        rotational_viscosity = waving.object[0].viscosity * EDGE**2 / 6
    return waving.replace({"object.free": [True, True, True], "object.rotational_viscosity": rotational_viscosity})
