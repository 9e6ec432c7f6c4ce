"""paper-waving with the cube free to turn: eq. (27) for translation, and a rotational viscosity for the rotation."""

from __future__ import annotations

import graspfx as gx

EDGE = 0.05  # [m]


def scene(rotational_viscosity: float | None = None) -> gx.Scene:
    """Let the cube turn: its rotation is the weakest mode of the grasp, unstable without rotational viscosity.

    Args:
        rotational_viscosity: Viscosity [N m s/rad]; by default b_v a^2 / 6 for the edge a, with which rotation decays
            as fast as translation.
    """
    waving = gx.load("paper-waving")
    if rotational_viscosity is None:
        rotational_viscosity = waving.object[0].viscosity * EDGE**2 / 6
    return waving.replace({"object.free": [True, True, True], "object.rotational_viscosity": rotational_viscosity})
