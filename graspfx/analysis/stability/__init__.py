"""Exact limits of sampled coupling impedances: walls, objects, grasps of n fingers (`gx.stability`)."""

from __future__ import annotations

from graspfx.analysis.discrete import INTEGRATORS
from graspfx.analysis.linearisation import Linearisable, Linearisation
from graspfx.analysis.maps.maps import external_limit_blocks, external_limit_map, external_stable_map, wall_limit_map
from graspfx.analysis.preload import Preload, preloaded
from graspfx.analysis.pushing import pushing
from graspfx.analysis.series import in_series, springs_in_series
from graspfx.analysis.stability.design import (
    Gains,
    integrators_compared,
    largest_gains,
    least_friction,
    least_wall_friction,
)
from graspfx.analysis.stability.fullloop import OpenLoop, loop_matrix, open_loop
from graspfx.analysis.stability.limits import Limits, Loss
from graspfx.analysis.stability.loci import Loci, loci
from graspfx.analysis.stability.modal import Mode
from graspfx.analysis.stability.one_gain import (
    external_limit,
    external_limits,
    modes,
    spectral_radius,
    stable_intervals,
    wall_limit,
    wall_limits,
)

__all__ = [  # noqa: RUF022 (numbers, arrays of numbers, grasps, design)
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
