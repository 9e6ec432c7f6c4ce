"""Limits over arrays of parameters, all points at once or block by block."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspfx.analysis.arguments import numbers
from graspfx.analysis.critical import edges, first_loss, is_stable
from graspfx.analysis.discrete import INTEGRATORS
from graspfx.analysis.sampled_plant import ObjectOptions, Plant, plant_on_wall, plant_with_object

FloatArray = NDArray[np.float64]

BLOCK = 8192  # points whose intermediate arrays stay in the processor's cache


def wall_limit_map(
    mass: ArrayLike,
    damping: ArrayLike,
    period: ArrayLike,
    *,
    spring: ArrayLike = 0.0,
    wall_damping: ArrayLike = 0.0,
    delay: int = 0,
    spring_damping: ArrayLike = 0.0,
    latency: float = 0.0,
    engine: str = "auto",
) -> FloatArray:
    """Compute `wall_limit` for arrays of parameters that broadcast against one another, in their common shape.

    Args:
        engine: as in `external_limit_map`.
    """
    plant = plant_on_wall(numbers, mass, damping, period, spring, wall_damping, delay, spring_damping, latency)
    return _limit_map(plant, engine)


def external_limit_map(
    mass: ArrayLike,
    damping: ArrayLike,
    period: ArrayLike,
    object_mass: ArrayLike,
    object_damping: ArrayLike,
    *,
    engine: str = "auto",
    **options: Unpack[ObjectOptions],
) -> FloatArray:
    """Compute `external_limit` for arrays of parameters that broadcast against one another, in their common shape.

    Args:
        engine: "numpy", or "compiled", which is compiled once on a machine and takes a fraction of the time from then
            on, for maps without delay and damping of the coupling; "auto" compiles only for maps of millions of points.
    """
    plant = plant_with_object(numbers, mass, damping, period, object_mass, object_damping, **options)
    return _limit_map(plant, engine)


def external_limit_blocks(
    mass: ArrayLike,
    damping: ArrayLike,
    period: ArrayLike,
    object_mass: ArrayLike,
    object_damping: ArrayLike,
    **options: Unpack[ObjectOptions],
) -> Iterator[tuple[int, FloatArray]]:
    """Compute `external_limit_map` a block at a time, as (first index, values) in the order of the flat array.

    Whatever the number of points, only one block is held: parameters that broadcast are not spread out.
    """
    plant = plant_with_object(numbers, mass, damping, period, object_mass, object_damping, **options)
    for start, block in plant.blocks(BLOCK):
        yield start, _first_losses(block)


def external_stable_map(
    gain: ArrayLike,
    mass: ArrayLike,
    damping: ArrayLike,
    period: ArrayLike,
    object_mass: ArrayLike,
    object_damping: ArrayLike,
    **options: Unpack[ObjectOptions],
) -> NDArray[np.bool_]:
    """Tell whether given k_ep [N/m] are stable: Jury's conditions, by Routh's array in w = (z - 1)/(z + 1)."""
    plant = plant_with_object(numbers, mass, damping, period, object_mass, object_damping, **options)
    plant = replace(plant, gain=numbers("gain", gain, "N/m"))
    shape = plant.shape
    stable = np.empty(shape, dtype=bool).reshape(-1)
    for start, block in plant.blocks(BLOCK):
        stable[start : start + BLOCK] = is_stable(*block.polynomials(), block.gain).ravel()
    return stable.reshape(shape)


def _limit_map(plant: Plant, engine: str) -> FloatArray:
    shape = plant.shape
    limit = np.empty(shape).reshape(-1)
    from graspfx.analysis.maps import map_compiled  # brings the compiler, which no other limit needs

    if map_compiled.is_compiled(engine, limit.size, covered=plant.plain):
        size, find = map_compiled.BLOCK, _compiled_losses
    else:
        size, find = BLOCK, _first_losses
    for start, block in plant.blocks(size):
        limit[start : start + size] = find(block)
    return limit.reshape(shape)


def _first_losses(block: Plant) -> FloatArray:
    return np.asarray(first_loss(*edges(*block.polynomials(), block.unit))[0].ravel())


def _compiled_losses(block: Plant) -> FloatArray:
    from graspfx.analysis.maps import map_compiled

    device = block.mass, block.friction, block.period, block.spring
    if block.object_mass is None:
        return map_compiled.wall_limits(*device)
    return map_compiled.external_limits(*device, *block.share, integrator=INTEGRATORS.index(block.integrator))
