"""Passivity limits: largest stiffness of a display that never supplies energy to the operator."""

from __future__ import annotations

from graspfx.analysis.passivity.display import WorstMotion, worst_motion
from graspfx.analysis.passivity.grasp_leak import (
    CouplingLimits,
    coupling_limits,
    external_limit,
    grasp_display,
    leak_margin,
    leak_matrix,
)
from graspfx.analysis.passivity.requirement import damping_margin, required_damping
from graspfx.analysis.passivity.walls import (
    QuantisedWall,
    ZWidth,
    guaranteed_wall_limit,
    quantised_wall,
    quantised_wall_limit,
    wall_limit,
    z_width,
)

__all__ = [
    "CouplingLimits",
    "QuantisedWall",
    "WorstMotion",
    "ZWidth",
    "coupling_limits",
    "damping_margin",
    "external_limit",
    "grasp_display",
    "guaranteed_wall_limit",
    "leak_margin",
    "leak_matrix",
    "quantised_wall",
    "quantised_wall_limit",
    "required_damping",
    "wall_limit",
    "worst_motion",
    "z_width",
]


def __dir__() -> list[str]:
    return sorted(__all__)
