"""Exact stability limits of sampled walls, of objects moved by fingers, and of grasps (`gx.stability`)."""

from __future__ import annotations

from graspfx.analysis.critical import Limits, Loss
from graspfx.analysis.discrete import INTEGRATORS
from graspfx.analysis.grasp_stiffness import Preload, in_series, preloaded, pushing, springs_in_series
from graspfx.analysis.linearisation import Linearisable, Linearisation
from graspfx.analysis.stability.loci import Loci, loci
from graspfx.analysis.stability.loop import OpenLoop, loop_matrix, open_loop, spectral_radius
from graspfx.analysis.stability.modes import Mode, modes
from graspfx.analysis.stability.one_gain import (
    Gains,
    external_limit,
    external_limit_blocks,
    external_limit_map,
    external_limits,
    external_stable_map,
    integrators_compared,
    largest_gains,
    least_friction,
    least_wall_friction,
    stable_intervals,
    wall_limit,
    wall_limit_map,
    wall_limits,
)

__all__ = [  # noqa: RUF022 (order: numbers, arrays of numbers, grasps, design)
    "wall_limit",
    "external_limit",
    "stable_intervals",
    "wall_limits",
    "external_limits",
    "Limits",
    "Loss",
    "INTEGRATORS",
    "wall_limit_map",
    "external_limit_map",
    "external_limit_blocks",
    "external_stable_map",
    "Linearisation",
    "Linearisable",
    "spectral_radius",
    "modes",
    "Mode",
    "loop_matrix",
    "open_loop",
    "OpenLoop",
    "loci",
    "Loci",
    "preloaded",
    "Preload",
    "pushing",
    "in_series",
    "springs_in_series",
    "largest_gains",
    "Gains",
    "least_wall_friction",
    "least_friction",
    "integrators_compared",
]


def __dir__() -> list[str]:
    return sorted(__all__)
