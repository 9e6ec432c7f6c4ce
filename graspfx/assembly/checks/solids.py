"""Checks of an object's shape and mass: in the scene's dimensions, readable, and weighed one way."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from graspfx.assembly.checks.settings import reason
from graspfx.assembly.stock import Stock
from graspfx.errors import InputError, MissingPackageError, abbreviate
from graspfx.scene.tables.scene_table import SceneTable
from graspfx.scene.tables.shapes import MeshShape

Location = tuple[str | int, ...]
Finding = tuple[Location, str]

VECTORS = {"box": "size", "ellipsoid": "semi_axes", "half-space": "normal", "plane": "normal"}  # of d numbers
ENDLESS = ("half-space", "plane")


def shape_faults(scene: SceneTable, at: Location, thing: Any, stock: Stock) -> Iterator[Finding]:
    """Find the faults of an object's shape; a sound one goes to the stock."""
    shape, d = thing.shape, scene.dimensions
    if shape is None and scene.coupling.contact == "unilateral":
        yield (*at, "shape"), "required for unilateral contact (coupling.contact = 'attached' needs none)"
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


def _mesh(scene: SceneTable, owner: Location, thing: Any, stock: Stock) -> Iterator[Finding]:
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


def mass_faults(scene: SceneTable, at: Location, thing: Any) -> Iterator[Finding]:
    """Find faults of how an object is weighed: by its mass, or in space by its density."""
    if thing.density is None:
        if thing.mass is None:
            yield (*at, "mass"), "required, but not given" + (" (or density)" if scene.dimensions == 3 else "")
        return
    if thing.mass is not None:
        yield (*at, "density"), "expected either a mass or a density, not both"
    elif scene.dimensions != 3:
        yield (*at, "density"), "only what is in space has a volume (dimensions = 3): give the mass"
    elif thing.shape is None:
        yield (*at, "density"), "there is no shape to take it times: give the mass"
    elif thing.shape.kind in ENDLESS:
        yield (*at, "density"), f"a {thing.shape.kind} has no end: give the mass"
    elif thing.shape.kind == "mesh" and thing.shape.shell:
        yield (*at, "density"), "a shell has no volume: give the mass"
