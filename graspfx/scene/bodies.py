"""An object's table as a shape and as the parameters and first state of its body."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from graspfx.objects import shape as shapes
from graspfx.objects.body import fill_body
from graspfx.scene.parts import Object, Obstacle, SceneTable

FloatArray = NDArray[np.float64]
Inertia = float | tuple[float, ...]


SHAPES: dict[str, Callable[..., shapes.Shape]] = {
    "box": shapes.Box,
    "sphere": shapes.Sphere,
    "half-space": shapes.HalfSpace,
    "plane": shapes.Plane,
    "capsule": shapes.Capsule,
    "cylinder": shapes.Cylinder,
    "ellipsoid": shapes.Ellipsoid,
}


def make_shape(table: Object | Obstacle) -> shapes.Shape | None:
    """The shape that a table describes: its keys are what the shape takes."""
    if table.shape is None:
        return None
    names = [name for name in type(table.shape).model_fields if name != "kind"]
    return SHAPES[table.shape.kind](**{name: getattr(table.shape, name) for name in names})


def inertia(scene: SceneTable, table: Object) -> Inertia | None:
    """Moments about the centre as the table gives them, else those of the solid shape [kg m^2]; None for neither."""
    shape = make_shape(table)
    if table.inertia is not None or shape is None or shape.endless or scene.dimensions == 1:
        return table.inertia
    moments: list[float] = shape.inertia(table.mass, scene.dimensions).tolist()
    return tuple(moments)


def fill(scene: SceneTable, table: Object, state: FloatArray) -> None:
    """Writes parameters and first state into a body's block.

    Raises:
        InputError: naming the key that cannot be.
    """
    fill_body(
        state,
        dimensions=scene.dimensions,
        mass=table.mass,
        inertia=inertia(scene, table),
        viscosity=table.viscosity,
        rotational_viscosity=table.rotational_viscosity or 0.0,
        # others have an integrator of their own; only the native implicit one is asked for its free motion
        integrator=table.integrator if table.dynamics == "native" else "semi-implicit",
        free=scene.free(table),
        gravity=scene.gravity,
        position=table.position,
        orientation=table.orientation,
        velocity=table.velocity,
        angular_velocity=table.angular_velocity,
    )
