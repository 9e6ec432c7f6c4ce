"""Bodies of a scene: shapes, masses, initial states and collisions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from inspect import signature
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.meshes import SceneMesh, scene_mesh
from graspfx.compile.memory import Memory
from graspfx.errors import InputError
from graspfx.loop.device import Device
from graspfx.loop.motion import motion
from graspfx.objects.body import fill_body
from graspfx.objects.dynamics_table import MEETING, dynamics_of
from graspfx.objects.surroundings import Obstacle as PlacedObstacle
from graspfx.objects.surroundings import place_obstacle
from graspfx.scene.keys import Key

if TYPE_CHECKING:
    from graspfx.scene.tables.part_tables import Object, Obstacle
    from graspfx.scene.tables.scene_table import SceneTable
    from graspfx.surfaces.closed_form.shape import Shape
    from graspfx.surfaces.triangles.mesh import Mesh


FloatArray = NDArray[np.float64]
Inertia = float | tuple[float, ...]
SHAPES = {  # classes of graspfx.surfaces.closed_form.shape by kind; the module is loaded for scenes with shapes
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
    """Shape of an object or obstacle; both attributes are None for an object without a shape.

    Attributes:
        primitive: Shape in closed form, in the body's frame; None for a mesh.
        mesh: Mesh with its mass properties; None for a shape in closed form.
    """

    primitive: Shape | None = None
    mesh: SceneMesh | None = None

    @property
    def shape(self) -> Shape | Mesh | None:
        """Shape in the body's frame; None for an object without a shape."""
        return self.primitive if self.mesh is None else self.mesh.mesh


def make_solid(table: Object | Obstacle, folder: Path | None) -> Solid:
    """Make the shape that a table describes; relative paths of mesh files are relative to `folder`.

    Raises:
        InputError: If a value of the shape's table is invalid; the message names the key.
        MissingPackageError: If the package that reads a mesh's file is not installed.
    """
    mesh = scene_mesh(table, folder)
    return Solid(None if mesh is not None else _primitive(table), mesh)


def _primitive(table: Object | Obstacle) -> Shape | None:
    """Make a shape in closed form, whose parameters are the keys of its table; None for other shapes."""
    if table.shape is None or table.shape.kind not in SHAPES:
        return None
    from graspfx.surfaces.closed_form import shape

    make: Callable[..., Shape] = getattr(shape, SHAPES[table.shape.kind])
    return make(**{name: getattr(table.shape, name) for name in signature(make).parameters})


def mass(table: Object, solid: Solid) -> float:
    """Return an object's mass: the mass in its table, or the density in the table times the volume of the shape [kg].

    Raises:
        InputError: If the table has neither a mass nor a density with a volume.
    """
    if table.mass is not None:
        return table.mass
    body = solid.mesh or solid.primitive
    if table.density is None or body is None:
        raise InputError("mass", None, "the object's mass [kg]")
    return table.density * body.volume()


def inertia(scene: SceneTable, table: Object, solid: Solid) -> Inertia | None:
    """Return an object's moments of inertia about its centre [kg m^2].

    They are those in the table; if the table has none, those of a homogeneous solid of the object's mass and shape;
    None if the shape is not bounded, or the scene has one dimension.
    """
    if table.inertia is not None or scene.dimensions == 1:
        return table.inertia
    return solid_inertia(solid, mass(table, solid), scene.dimensions)


def solid_inertia(solid: Solid, mass: float, dimensions: int) -> tuple[float, ...] | None:
    """Compute the moments of inertia of a homogeneous solid about its centre [kg m^2]; None if it is not bounded."""
    if solid.mesh is not None:
        return solid.mesh.moments(mass)
    shape = solid.primitive
    if shape is None or shape.endless:
        return None
    moments: list[float] = shape.inertia(mass, dimensions).tolist()
    return tuple(moments)


def place(table: Object | Obstacle, solid: Solid) -> tuple[tuple[float, ...] | None, float | tuple[float, ...] | None]:
    """Return the initial pose of a body's frame: position [m], and angle [rad] or unit quaternion x, y, z, w."""
    position, orientation = table.position, table.orientation
    if solid.mesh is not None and not isinstance(orientation, float):
        return solid.mesh.body_pose(position, orientation)
    return position, orientation


def _integrator(table: Object) -> str:
    """Return the integrator of an object; for dynamics other than "native" it is "semi-implicit"."""
    return table.integrator if table.dynamics == "native" else "semi-implicit"


def fill(scene: SceneTable, table: Object, solid: Solid, state: FloatArray, *, predicts: bool = True) -> None:
    """Write the parameters and the initial state of an object into its block.

    The pose in the table is that of the shape's frame. The body's frame of a mesh has its origin at the centre of mass
    and its axes along the principal axes.

    Args:
        predicts: Whether an object may have the integrator "implicit"; if False, "semi-implicit" replaces it, so that
            forces are functions of the pose.

    Raises:
        InputError: If a value is invalid; the message names the key.
    """
    integrator = _integrator(table)
    position, orientation = place(table, solid)
    fill_body(
        state,
        dimensions=scene.dimensions,
        mass=mass(table, solid),
        inertia=inertia(scene, table, solid),
        viscosity=table.viscosity,
        rotational_viscosity=table.rotational_viscosity or 0.0,
        integrator="semi-implicit" if integrator == "implicit" and not predicts else integrator,
        free=scene.free(table),
        gravity=scene.gravity,
        position=position,
        orientation=orientation,
        velocity=table.velocity,
        angular_velocity=table.angular_velocity,
    )


class Stock:
    """Devices, shapes and recorded motions of one scene, which its checks connect, create and read.

    Devices and shapes are found by the locations of their tables, and recorded motions by their files. A copy of a
    scene has an empty stock, because neither pickling nor `copy.deepcopy` copies devices.

    Args:
        folder: Folder to which the scene's relative paths refer; None for the current folder.
    """

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder
        self.devices: dict[Key, Device] = {}
        self.starts: dict[int, tuple[float, ...] | None] = {}  # starts of fingers placed along a direction
        self.memory = Memory()  # memory for the blocks of these devices
        self.parts: Any = None  # parts by `graspfx.assembly.resolve`, made on demand
        self.built: Any = None  # arguments of a build, servo that has run, and its initial state (`build_again`)
        self._solids: dict[Key, Solid] = {}
        self._paths: dict[str, motion.Path] = {}
        self._lock = Lock()
        self._unused = True

    def solid(self, at: Key, table: Object | Obstacle) -> Solid:
        """Return the shape of the object or obstacle whose table is at the location `at`.

        Raises:
            InputError: If a value of the shape's table is invalid; the message names the key.
            MissingPackageError: If the package that reads a mesh's file is not installed.
        """
        if at not in self._solids:
            self._solids[at] = make_solid(table, self.folder)
        return self._solids[at]

    def path(self, file: str) -> motion.Path:
        """Return the motion recorded in a file.

        Raises:
            InputError: If the file is missing or a line is invalid; the message names the line.
        """
        if file not in self._paths:
            self._paths[file] = motion.Path.read(file, self.folder)
        return self._paths[file]

    def claim(self) -> bool:
        """Return whether this is the first call; only the first caller may use the connected devices."""
        with self._lock:
            first, self._unused = self._unused, False
        return first

    def take_built(self) -> Any:
        """Return `built`, and set it to None."""
        with self._lock:
            built, self.built = self.built, None
        return built

    def __deepcopy__(self, memo: Any) -> None:
        return None

    def __reduce__(self) -> tuple[type[None], tuple[()]]:
        return type(None), ()


def moves(scene: SceneTable, thing: Object) -> bool:
    """Return whether at least one of an object's degrees of freedom is free."""
    return any(scene.free(thing))


def collide(scene: SceneTable) -> bool:
    """Return whether the objects of a physics engine's world collide with one another."""
    return scene.world.collide if scene.world.collide is not None else scene.dimensions == 3


def groups(scene: SceneTable) -> list[list[int]]:
    """List the groups of objects, by index, that are simulated together: one object, or all in an engine's world."""
    groups_: list[list[int]] = []
    for i, thing in enumerate(scene.object):
        mates = [group for group in groups_ if scene.object[group[0]].dynamics == thing.dynamics != "native"]
        if mates and (scene.obstacle or collide(scene)):
            mates[0].append(i)
        else:
            groups_.append([i])
    return groups_


def in_world(scene: SceneTable, group: Sequence[int]) -> bool:
    """Return whether the objects of a group can collide, with an obstacle or with one another."""
    things = [scene.object[i] for i in group]
    if scene.obstacle:
        return any(thing.shape is not None and moves(scene, thing) for thing in things)
    return len(group) > 1


def obstacles(scene: SceneTable, stock: Stock) -> list[PlacedObstacle]:
    """Return the obstacles of a scene at their poses."""
    solids = [stock.solid(("obstacle", i), table) for i, table in enumerate(scene.obstacle)]
    return [
        place_obstacle(table.name, solid.shape, scene.dimensions, *place(table, solid))
        for table, solid in zip(scene.obstacle, solids, strict=True)
    ]


def meeting(scene: SceneTable, thing: Object) -> tuple[bool, str]:
    """Return whether an object can collide with other bodies, and a text that describes its collisions."""
    if thing.shape is None:
        return False, "it has no shape, and therefore no contacts"
    if not moves(scene, thing) and thing.dynamics == "native":
        return False, "every degree of freedom is locked: it does not move, and native objects pass through it"
    names = ", ".join(table.name for table in scene.obstacle)
    law = f"friction {scene.world.friction:g}"
    if thing.dynamics == "native":
        passes = len(scene.object) > 1
        others = f"; it passes through other objects (it collides with them if dynamics = {MEETING})" if passes else ""
        if not scene.obstacle:
            return False, f"there are no obstacles{others}"
        law += f", {scene.world.stiffness:g} N/m per point"
        return True, f"{names}, {law}; {_points(thing)}{others}"
    group = next(group for group in groups(scene) if thing in [scene.object[i] for i in group])
    if not in_world(scene, group):
        why = "every degree of freedom is locked" if scene.obstacle else "there are no obstacles"
        return False, why if len(scene.object) == 1 else f"{why}; it passes through other objects"
    mates = [scene.object[i].name for i in group if scene.object[i] is not thing] if collide(scene) else []
    met = ", ".join([*([names] if names else []), *mates])
    engine = dynamics_of(thing.dynamics)
    shape = "; as its convex hull" if thing.shape.kind in engine.hulls else ""
    return True, f"{met}, {law}, restitution {scene.world.restitution:g}, in one {engine.label} world{shape}"


def _points(thing: Any) -> str:
    texts = {
        "box": "with its corners",
        "sphere": "with its lowest point",
        "ellipsoid": "with its lowest point",
        "capsule": "with the lowest points of its ends",
        "cylinder": "with eight fixed points and the lowest point of each rim",
        "mesh": "with the corners of its convex hull, at most nine on each plane",
    }
    return texts.get(thing.shape.kind, "with its lowest points")
