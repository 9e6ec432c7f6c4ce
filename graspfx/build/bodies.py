"""An object's table as a shape and as the parameters and first state of its body."""

from __future__ import annotations

from collections.abc import Callable
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx.build.meshes import scene_mesh
from graspfx.errors import InputError
from graspfx.objects.body import fill_body

if TYPE_CHECKING:
    from graspfx.scene.tables.part_tables import Object, Obstacle
    from graspfx.scene.tables.scene_table import SceneTable
    from graspfx.surfaces.closed_form.shape import Shape
    from graspfx.surfaces.triangles.mesh import Mesh

FloatArray = NDArray[np.float64]
Inertia = float | tuple[float, ...]


SHAPES = {  # by kind, the classes of graspfx.surfaces.closed_form.shape, which is loaded where a scene has a shape
    "box": "Box",
    "sphere": "Sphere",
    "half-space": "HalfSpace",
    "plane": "Plane",
    "capsule": "Capsule",
    "cylinder": "Cylinder",
    "ellipsoid": "Ellipsoid",
}


def make_shape(table: Object | Obstacle, folder: Path | None) -> Shape | Mesh | None:
    """The shape that a table describes, in the body's frame; `folder` is where the path of a mesh starts.

    Raises:
        InputError: naming the key of the shape's table that cannot be.
        MissingPackageError: what reads a mesh's file is not installed.
    """
    found = scene_mesh(table, folder)
    return found.mesh if found is not None else _primitive(table)


def _primitive(table: Object | Obstacle) -> Shape | None:
    """A shape in closed form: its table's keys are what it takes."""
    if table.shape is None or table.shape.kind not in SHAPES:
        return None
    from graspfx.surfaces.closed_form import shape

    make: Callable[..., Shape] = getattr(shape, SHAPES[table.shape.kind])
    return make(**{name: getattr(table.shape, name) for name in signature(make).parameters})


def mass(table: Object, folder: Path | None) -> float:
    """As the table gives it, or its density times the volume of its shape [kg].

    Raises:
        InputError: neither a mass nor a density with a volume.
    """
    if table.mass is not None:
        return table.mass
    solid = scene_mesh(table, folder) or _primitive(table)
    if table.density is None or solid is None:
        raise InputError("mass", None, "the object's mass [kg]")
    return table.density * solid.volume()


def inertia(scene: SceneTable, table: Object, folder: Path | None) -> Inertia | None:
    """Moments about the centre as the table gives them, else those of the solid shape [kg m^2]; None for neither."""
    if table.inertia is not None or scene.dimensions == 1:
        return table.inertia
    found = scene_mesh(table, folder)
    if found is not None:
        return found.moments(mass(table, folder))
    shape = _primitive(table)
    if shape is None or shape.endless:
        return None
    moments: list[float] = shape.inertia(mass(table, folder), scene.dimensions).tolist()
    return tuple(moments)


def place(
    table: Object | Obstacle, folder: Path | None
) -> tuple[tuple[float, ...] | None, float | tuple[float, ...] | None]:
    """Where the frame of the shape that `make_shape` gives is at first: position [m] and orientation."""
    position, orientation = table.position, table.orientation
    found = scene_mesh(table, folder)
    if found is not None and not isinstance(orientation, float):
        return found.body_pose(position, orientation)
    return position, orientation


def fill(scene: SceneTable, table: Object, state: FloatArray, folder: Path | None) -> None:
    """Writes parameters and first state into a body's block.

    A table's pose is that of the frame in which its shape is described; the body of a mesh is at its centre of mass,
    with its principal axes.

    Raises:
        InputError: naming the key that cannot be.
    """
    position, orientation = place(table, folder)
    fill_body(
        state,
        dimensions=scene.dimensions,
        mass=mass(table, folder),
        inertia=inertia(scene, table, folder),
        viscosity=table.viscosity,
        rotational_viscosity=table.rotational_viscosity or 0.0,
        # others have an integrator of their own; only the native implicit one is asked for its free motion
        integrator=table.integrator if table.dynamics == "native" else "semi-implicit",
        free=scene.free(table),
        gravity=scene.gravity,
        position=position,
        orientation=orientation,
        velocity=table.velocity,
        angular_velocity=table.angular_velocity,
    )
