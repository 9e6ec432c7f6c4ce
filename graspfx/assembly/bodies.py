"""An object's table as a shape and as the parameters and first state of its body."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.meshes import SceneMesh, scene_mesh
from graspfx.assembly.numbers import Number, Numbers, arguments
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


@dataclass(frozen=True, eq=False)
class Solid:
    """The shape of an object or obstacle.

    Attributes:
        primitive: the shape in closed form, in the body's frame; None for a mesh, and for an object without a shape.
        mesh: the mesh with its mass properties; None for every other shape.
    """

    primitive: Shape | None = None
    mesh: SceneMesh | None = None

    @property
    def shape(self) -> Shape | Mesh | None:
        """The shape in the body's frame."""
        return self.primitive if self.mesh is None else self.mesh.mesh


def make_solid(table: Object | Obstacle, folder: Path | None) -> Solid:
    """Make the shape that a table describes; `folder` is where the path of a mesh starts.

    Raises:
        InputError: naming the key of the shape's table that cannot be.
        MissingPackageError: the package that reads a mesh's file is not installed.
    """
    mesh = scene_mesh(table, folder)
    return Solid(None if mesh is not None else _primitive(table), mesh)


def _primitive(table: Object | Obstacle) -> Shape | None:
    """Make a shape in closed form: its table's keys are its parameters."""
    if table.shape is None or table.shape.kind not in SHAPES:
        return None
    from graspfx.surfaces.closed_form import shape

    make: Callable[..., Shape] = getattr(shape, SHAPES[table.shape.kind])
    return make(**{name: getattr(table.shape, name) for name in signature(make).parameters})


def mass(table: Object, solid: Solid) -> float:
    """Give the mass of the table, or its density times the volume of its shape [kg].

    Raises:
        InputError: neither a mass nor a density with a volume.
    """
    if table.mass is not None:
        return table.mass
    body = solid.mesh or solid.primitive
    if table.density is None or body is None:
        raise InputError("mass", None, "the object's mass [kg]")
    return table.density * body.volume()


def inertia(scene: SceneTable, table: Object, solid: Solid) -> Inertia | None:
    """Give the table's moments about the centre, else those of the solid shape [kg m^2]; None for neither."""
    if table.inertia is not None or scene.dimensions == 1:
        return table.inertia
    return solid_inertia(solid, mass(table, solid), scene.dimensions)


def solid_inertia(solid: Solid, mass: float, dimensions: int) -> tuple[float, ...] | None:
    """Give the moments of a solid shape of that mass about its centre [kg m^2]; None if it has none."""
    if solid.mesh is not None:
        return solid.mesh.moments(mass)
    shape = solid.primitive
    if shape is None or shape.endless:
        return None
    moments: list[float] = shape.inertia(mass, dimensions).tolist()
    return tuple(moments)


def place(table: Object | Obstacle, solid: Solid) -> tuple[tuple[float, ...] | None, float | tuple[float, ...] | None]:
    """Give the frame of a shape at first: position [m] and orientation."""
    position, orientation = table.position, table.orientation
    if solid.mesh is not None and not isinstance(orientation, float):
        return solid.mesh.body_pose(position, orientation)
    return position, orientation


def _integrator(scene: SceneTable, table: Object, solid: Solid) -> str:
    """Name the body's integrator: others than native ones have their own, and are not asked for their free motion."""
    return table.integrator if table.dynamics == "native" else "semi-implicit"


SOLID = ("object.*.mass", "object.*.density", "object.*.shape")
POSE = ("object.*.position", "object.*.orientation", "object.*.shape")  # the body of a mesh stands at its centre

BODY: Numbers = {  # the arguments of `fill_body`
    "dimensions": Number(("dimensions",), ("dimensions",), lambda scene, table, solid: scene.dimensions),
    "mass": Number(SOLID, ("mass",), lambda scene, table, solid: mass(table, solid)),
    "inertia": Number((*SOLID, "object.*.inertia"), ("inertia",), inertia),
    "viscosity": Number(("object.*.viscosity",), ("viscosity",), lambda scene, table, solid: table.viscosity),
    "rotational_viscosity": Number(
        ("object.*.rotational_viscosity",),
        ("rotational_viscosity",),
        lambda scene, table, solid: table.rotational_viscosity or 0.0,
    ),
    "integrator": Number(("object.*.integrator", "object.*.dynamics"), ("integrator",), _integrator),
    "free": Number(
        ("object.*.free",), ("free_translation", "free_rotation"), lambda scene, table, solid: scene.free(table)
    ),
    "gravity": Number(("gravity",), ("gravity",), lambda scene, table, solid: scene.gravity),
    "position": Number(POSE, ("motion.position",), lambda scene, table, solid: place(table, solid)[0]),
    "orientation": Number(
        POSE,
        ("motion.angle", "motion.quaternion", "motion.rotation"),
        lambda scene, table, solid: place(table, solid)[1],
    ),
    "velocity": Number(("object.*.velocity",), ("motion.velocity",), lambda scene, table, solid: table.velocity),
    "angular_velocity": Number(
        ("object.*.angular_velocity",),
        ("motion.angular_velocity",),
        lambda scene, table, solid: table.angular_velocity,
    ),
}


def fill(scene: SceneTable, table: Object, solid: Solid, state: FloatArray, *, predicts: bool = True) -> None:
    """Write parameters and first state into a body's block: the arguments that `BODY` declares.

    A table's pose is that of the frame in which its shape is described; the body of a mesh is at its centre of mass,
    with its principal axes.

    Args:
        predicts: whether the implicit integrator is one; else it stands in the block as the semi-implicit one, whose
            forces are functions of the pose.

    Raises:
        InputError: naming the key that cannot be.
    """
    numbers = arguments(BODY, scene, table, solid)
    if numbers["integrator"] == "implicit" and not predicts:
        numbers["integrator"] = "semi-implicit"
    fill_body(state, **numbers)
