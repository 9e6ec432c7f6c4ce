"""Whether an object's integrator is stable with its viscosity."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np

from graspfx.assembly import bodies
from graspfx.assembly.stock import Stock
from graspfx.errors import GraspFXError
from graspfx.objects.body import VISCOUS_LIMIT
from graspfx.scene.tables.reading import WIDTHS
from graspfx.scene.tables.scene_table import SceneTable

Location = tuple[str | int, ...]
Finding = tuple[Location, str]


def may_turn(scene: SceneTable, thing: Any) -> bool:
    """Tell whether a rotation of an object is free, as far as `free` has the right length to tell."""
    free = scene.free(thing)
    return len(free) == WIDTHS[scene.dimensions] and any(free[scene.dimensions :])


def viscosity_faults(scene: SceneTable, at: Location, thing: Any, stock: Stock) -> Iterator[Finding]:
    """Find viscosities that explicit and semi-implicit integration does not stand."""
    if thing.dynamics != "native" or thing.integrator not in ("explicit", "semi-implicit"):
        return
    with suppress(GraspFXError):  # a mass or a shape that cannot be has its own fault
        if any(scene.free(thing)[: scene.dimensions]):
            mass = bodies.mass(thing, stock.solid(at, thing))
            yield from _slowed(scene, at, thing, "viscosity", thing.viscosity, "mass", mass)
        if thing.rotational_viscosity is not None and may_turn(scene, thing):
            moments = np.atleast_1d(
                np.asarray(bodies.inertia(scene, thing, stock.solid(at, thing)) or 0.0, dtype=float)
            )
            least = float(moments[-1] if scene.dimensions == 2 else moments.min())
            if least > 0.0:
                viscosity = thing.rotational_viscosity
                yield from _slowed(scene, at, thing, "rotational_viscosity", viscosity, "inertia", least)


def _slowed(
    scene: SceneTable, at: Location, thing: Any, key: str, viscosity: float, by: str, inertia: float
) -> Iterator[Finding]:
    ratio = viscosity * scene.period / inertia
    if ratio >= VISCOUS_LIMIT:
        yield (
            (*at, key),
            f"{key} * period / {by} is {ratio:.4g}, and {thing.integrator} integration is stable only below "
            f"{VISCOUS_LIMIT:g}; integrator = 'exact' always is",
        )
