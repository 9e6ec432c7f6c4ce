"""Faults of an object's body: shape, mass, viscosity, and contacts with other bodies."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from graspfx import plugins
from graspfx.assembly import bodies
from graspfx.assembly.bodies import Stock
from graspfx.assembly.checks.settings import reason
from graspfx.errors import GraspFXError, InputError, MissingPackageError, abbreviate
from graspfx.objects.body import VISCOUS_LIMIT
from graspfx.objects.dynamics_table import MEETING, dynamics_of
from graspfx.objects.integrators import SIZE
from graspfx.scene.keys import Finding, Key
from graspfx.scene.tables.fields import NotValid
from graspfx.scene.tables.part_tables import Object
from graspfx.scene.tables.reading import WIDTHS
from graspfx.scene.tables.scene_table import SceneTable
from graspfx.scene.tables.shapes import MeshShape

VECTORS = {"box": "size", "ellipsoid": "semi_axes", "half-space": "normal", "plane": "normal"}  # keys with d numbers
FLAT = ("half-space", "plane")  # unbounded shapes


def shape_faults(scene: SceneTable, at: Key, thing: Any, stock: Stock) -> Iterator[Finding]:
    """Find the faults of an object's shape, and store the shape in `stock` if it is valid."""
    shape, d = thing.shape, scene.dimensions
    if shape is None and scene.coupling.contact == "unilateral":
        yield (*at, "shape"), "required for unilateral contact (not required if coupling.contact = 'attached')"
    if shape is None:
        return
    if isinstance(shape, MeshShape):
        yield from _mesh(scene, at, thing, stock)
        return
    name = VECTORS.get(shape.kind)
    if name is not None and len(getattr(shape, name)) != d:
        numbers = "1 number" if d == 1 else f"{d} numbers"
        text = abbreviate(list(getattr(shape, name)))
        yield (*at, "shape", name), f"expected {numbers} (dimensions = {d}); given {text}"
        return
    try:
        solid = stock.solid(at, thing).primitive
    except InputError as error:
        yield (*at, "shape", error.name), f"given {abbreviate(error.given)}, expected {error.expected}"
        return
    if solid is not None and not solid.dimensions_ok(d):
        yield (*at, "shape", "kind"), f"there is no {shape.kind} in {d} dimension(s)"


def _mesh(scene: SceneTable, owner: Key, thing: Any, stock: Stock) -> Iterator[Finding]:
    shape, at = thing.shape, (*owner, "shape")
    inline = [key for key in ("vertices", "faces") if getattr(shape, key) is not None]
    source = (*at, "mesh" if shape.mesh is not None else "vertices")
    if shape.mesh is not None and inline:
        yield (*at, inline[0]), "expected either a file (mesh) or vertices and faces, not both"
    elif shape.mesh is None and len(inline) < 2:
        yield at, "expected a file (mesh = 'mug.stl'), or vertices and faces"
    elif scene.dimensions != 3:
        yield source, f"there is no mesh in {scene.dimensions} dimension(s)"
    else:
        try:
            stock.solid(owner, thing)
        except InputError as error:
            yield (*at, error.name) if error.name == "scale" or error.name in inline else source, reason(error)
        except MissingPackageError as error:
            yield source, str(error)


def mass_faults(scene: SceneTable, at: Key, thing: Any) -> Iterator[Finding]:
    """Find faults of an object's mass and density; a density is allowed in three dimensions only."""
    if thing.density is None:
        if thing.mass is None:
            yield (*at, "mass"), "required, but not given" + (" (or density)" if scene.dimensions == 3 else "")
        return
    if thing.mass is not None:
        yield (*at, "density"), "expected either a mass or a density, not both"
    elif scene.dimensions != 3:
        yield (*at, "density"), f"a density requires three dimensions; given {scene.dimensions}: set the mass instead"
    elif thing.shape is None:
        yield (*at, "density"), "a density requires a shape: set the mass instead"
    elif thing.shape.kind in FLAT:
        yield (*at, "density"), f"a {thing.shape.kind} has no finite volume: set the mass instead"
    elif thing.shape.kind == "mesh" and thing.shape.shell:
        yield (*at, "density"), "a shell has no volume: set the mass instead"


def may_turn(scene: SceneTable, thing: Any) -> bool:
    """Return whether an object has a free rotation; False if the length of `free` is invalid."""
    free = scene.free(thing)
    return len(free) == WIDTHS[scene.dimensions] and any(free[scene.dimensions :])


def viscosity_faults(scene: SceneTable, at: Key, thing: Any, stock: Stock) -> Iterator[Finding]:
    """Find viscosities for which an object's explicit or semi-implicit integration is unstable."""
    if thing.dynamics != "native" or thing.integrator not in ("explicit", "semi-implicit"):
        return
    with suppress(GraspFXError):  # an invalid mass or shape has its own fault
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
    scene: SceneTable, at: Key, thing: Any, key: str, viscosity: float, by: str, inertia: float
) -> Iterator[Finding]:
    ratio = viscosity * scene.period / inertia
    if ratio >= VISCOUS_LIMIT:
        yield (
            (*at, key),
            f"{key} * period / {by} is {ratio:.4g}, and {thing.integrator} integration is stable only below "
            f"{VISCOUS_LIMIT:g}; use integrator = 'exact', which is always stable",
        )


STIFFEST = 1e4  # largest k T^2/m of a native contact point; from 1e5 on, rounding errors make a resting box jump
DEEP = 1e-5  # largest initial depth in an obstacle [m]; a larger one is due neither to rounding nor to the weight


def meeting_faults(scene: SceneTable, stock: Stock, earlier: Sequence[Finding]) -> Iterator[Finding]:
    """Find contacts that the objects' dynamics do not support.

    Nothing is found if one of the `earlier` faults concerns objects, obstacles, the world or gravity.
    """
    if any(at[:1] in (("object",), ("obstacle",), ("world",), ("gravity",)) for at, _ in earlier):
        return
    yield from _together(scene, stock)
    if not scene.obstacle:
        return
    native = [thing.name for thing in scene.object if _meets(scene, thing, "native")]
    for i, table in enumerate(scene.obstacle):
        if native and table.shape.kind not in FLAT:
            yield (
                ("obstacle", i, "shape", "kind"),
                f"{', '.join(native)} with native dynamics can collide only with half-spaces and planes, not with a "
                f"{table.shape.kind}; dynamics = {MEETING} supports all shapes",
            )
    if native and scene.world.restitution > 0.0:
        yield (
            ("world", "restitution"),
            f"{', '.join(native)} with native dynamics does not bounce: expected 0; use dynamics = {MEETING}",
        )
    for i, thing in enumerate(scene.object):
        if thing.shape is not None and thing.shape.kind in FLAT and bodies.moves(scene, thing):
            yield (
                ("object", i, "shape", "kind"),
                f"a {thing.shape.kind} is unbounded and cannot move: lock all its degrees of freedom, or define it as "
                "an [[obstacle]]",
            )
        elif thing.shape is not None and bodies.moves(scene, thing):
            yield from _inside(scene, i, thing, stock)
            if thing.dynamics == "native":
                yield from _too_stiff(scene, i, thing, stock)


def light_faults(scene: SceneTable, at: Key, thing: Object, stock: Stock) -> Iterator[Finding]:
    """Find a mass or moment of inertia that is too small for the physics engine of the object."""
    engine = dynamics_of(thing.dynamics)
    if not engine.least:
        return
    from graspfx.objects.guest import SIZE as PART
    from graspfx.objects.guest import CarriedBody

    state = np.zeros(SIZE)
    try:
        bodies.fill(scene, thing, stock.solid(at, thing), state)
        one = CarriedBody(state, np.zeros(PART))
        mass = bodies.mass(thing, stock.solid(at, thing))
    except (GraspFXError, NotValid):
        return  # reported as a separate fault
    if one.fixed:
        return
    otherwise = "; dynamics = 'native' supports smaller values on half-spaces and planes"
    if not mass > engine.least:
        key = "mass" if thing.mass is not None else "density"
        yield (*at, key), f"the mass is {mass:.4g} kg: {engine.label} needs more than {engine.least:g} kg{otherwise}"
    if one.turns and not min(one.moments) > engine.least:
        key = "inertia" if thing.inertia is not None else "mass" if thing.mass is not None else "density"
        yield (
            (*at, key),
            f"the smallest moment of inertia is {min(one.moments):.4g} kg m^2: {engine.label} needs more than "
            f"{engine.least:g} kg m^2{otherwise}",
        )


def _together(scene: SceneTable, stock: Stock) -> Iterator[Finding]:
    if scene.world.collide and len(scene.object) > 1:
        for i, thing in enumerate(scene.object):
            if thing.dynamics == "native" and bodies.moves(scene, thing):
                yield (
                    ("object", i, "dynamics"),
                    f"native objects do not collide with one another; world.collide needs dynamics = {MEETING}",
                )
    collide = bool(scene.world.collide)
    for group in bodies.groups(scene):
        if not bodies.in_world(scene, group):
            continue
        name = scene.object[group[0]].dynamics
        if (scene.obstacle or collide) and not hasattr(plugins.load("dynamics", name, stock.folder), "create_world"):
            yield (
                ("object", group[0], "dynamics"),
                f"dynamics {name!r} does not support collisions, because it has no create_world; use {MEETING}",
            )
            continue
        for i in group:
            thing = scene.object[i]
            engine = dynamics_of(thing.dynamics)
            if thing.shape is not None and sum(map(bool, scene.free(thing)[3:])) not in engine.rotations:
                yield (
                    ("object", i, "free"),
                    f"{engine.label} has no joint for two of three rotations of a body with contacts: expected none, "
                    "one or three free rotations; dynamics = 'native' supports two on half-spaces and planes",
                )
            if engine.partial:
                continue
            if scene.dimensions != 3:
                yield (
                    ("object", i, "dynamics"),
                    f"a {engine.label} world has three dimensions, given {scene.dimensions}: set dimensions = 3, or "
                    "use dynamics = 'mujoco'"
                    + ("" if collide else ", or 'native' with obstacles that are half-spaces or planes"),
                )
            elif thing.shape is not None and bodies.moves(scene, thing) and not all(scene.free(thing)):
                yield (
                    ("object", i, "free"),
                    f"{engine.label} cannot lock single degrees of freedom of a body with contacts: expected all "
                    "free or none; use dynamics = 'mujoco', or 'native' on half-spaces and planes; or remove the "
                    "obstacles and set world.collide = false",
                )


def _meets(scene: SceneTable, thing: Object, dynamics: str) -> bool:
    return thing.dynamics == dynamics and thing.shape is not None and bodies.moves(scene, thing)


def _too_stiff(scene: SceneTable, i: int, thing: Object, stock: Stock) -> Iterator[Finding]:
    mass = bodies.mass(thing, stock.solid(("object", i), thing))
    k, T = scene.world.stiffness, scene.period
    if k * T * T > STIFFEST * mass:
        yield (
            ("world", "stiffness"),
            f"given {k:g} N/m, expected no more than {STIFFEST * mass / T**2:.3g} N/m ({STIFFEST:g} m/T^2 with the "
            f"mass {mass:g} kg of {thing.name!r} and the period {T:g} s): with a larger stiffness, rounding errors "
            "cause the object to jump off its support",
        )


def _inside(scene: SceneTable, i: int, thing: Object, stock: Stock) -> Iterator[Finding]:
    """Find the half-spaces and planes in which object i starts; obstacles of other shapes are not tested."""
    from graspfx.objects.floor.floor import clearance

    state = np.zeros(SIZE)
    try:
        solid = stock.solid(("object", i), thing)
        bodies.fill(scene, thing, solid, state)
        for table, obstacle in zip(scene.obstacle, bodies.obstacles(scene, stock), strict=True):
            if table.shape.kind in FLAT:
                height = clearance(solid.shape, scene.dimensions, state, obstacle)
                if height < -DEEP:
                    yield (
                        ("object", i, "position"),
                        f"the object starts {-1e3 * height:.4g} mm inside the obstacle {table.name!r}: expected the "
                        "object's lowest point on or above the obstacle",
                    )
    except (InputError, NotValid):
        return  # reported as a separate fault
