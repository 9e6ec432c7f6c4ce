"""Meshes of a scene in their bodies' frames, cached on disk by the content of the meshes' files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from graspfx import installed
from graspfx.compile.records import numbers
from graspfx.compile.value_cache import through_cache
from graspfx.environment import require_file, to_path
from graspfx.errors import InputError
from graspfx.spatial import Quaternion, Vector, quaternion, rotate

if TYPE_CHECKING:
    from graspfx.scene.tables.part_tables import Object, Obstacle
    from graspfx.surfaces.triangles.mesh import MassProperties, Mesh


Numbers = tuple[float, ...]
CACHED = 8  # number of meshes in memory, so that a check and a run read each file once


@dataclass(frozen=True)
class SceneMesh:
    """A mesh in its body's frame, and the body's pose in the file's frame.

    Attributes:
        mesh: Mesh in the body's frame.
        unit: Mass properties in the file's frame, for a density of 1 kg/m^3, or for a shell of mass 1 kg.
    """

    mesh: Mesh
    unit: MassProperties

    def volume(self) -> float:
        """Compute the volume [m^3].

        Raises:
            InputError: If the mesh is a shell.
        """
        if self.mesh.shell:
            raise InputError("density", "a density of a shell", "the object's mass", "a shell has no volume")
        return self.unit.mass

    def moments(self, mass: float) -> Numbers:
        """Compute the principal moments of inertia of the mesh with a mass [kg], (3,) [kg m^2]."""
        return tuple((self.unit.moments * (mass / self.unit.mass)).tolist())

    @property
    def turn(self) -> Quaternion:
        """Orientation of the body's frame in the file's frame, a unit quaternion."""
        return quaternion(self.unit.axes.ravel().tolist())

    def body_pose(self, position: Numbers | None, orientation: Numbers | None) -> tuple[Numbers, Numbers]:
        """Return the pose of the body's frame for a pose of the file's frame; None stands for zero or no rotation."""
        x, y, z = position or (0.0, 0.0, 0.0)
        q = Quaternion(*(orientation or (0.0, 0.0, 0.0, 1.0)))
        centre = rotate(q, Vector(*self.unit.centre.tolist()))
        return (x + centre.x, y + centre.y, z + centre.z), tuple(numbers(q @ self.turn))

    @property
    def frame(self) -> Mapping[str, list[float]]:
        """Pose of the file's frame in the body's frame, with which a viewer draws the mesh of the file."""
        turn = self.turn.conjugate
        centre = rotate(turn, Vector(*self.unit.centre.tolist()))
        return {"position": [-each for each in numbers(centre)], "orientation": list(numbers(turn))}


def scene_mesh(table: Object | Obstacle, folder: Path | None) -> SceneMesh | None:
    """Load the mesh of an object or obstacle; None if its shape is not a mesh. Paths are relative to `folder`.

    Raises:
        InputError: If a value of the shape's table is invalid; the message names the key.
        MissingPackageError: If the package that reads the file is not installed.
    """
    shape = table.shape
    if shape is None or shape.kind != "mesh":
        return None
    if shape.mesh is not None:
        path = to_path("mesh", shape.mesh, folder=folder)
        require_file("mesh", str(path), path, do="paths are relative to the scene's file")
        status = path.stat()
        limits = shape.most_bytes, shape.most_triangles
        return _read(str(path), (status.st_mtime_ns, status.st_size), shape.scale, shape.shell, limits)
    return _scene_mesh(shape.vertices, shape.faces, shape.scale, shape.shell)


def mesh_name(table: Object) -> str:
    """Return the name of the file of an object's mesh, or a text with the object's name if there is no file."""
    path = getattr(table.shape, "mesh", None)
    return Path(path).name if path else f"mesh of {table.name}"


@lru_cache(CACHED)
def _read(path: str, version: tuple[int, int], scale: float, shell: bool, limits: tuple[int, int]) -> SceneMesh:
    most_bytes, most_triangles = limits
    file = Path(path)

    def make() -> Mesh:
        from graspfx.surfaces.triangles.mesh import load_mesh

        return load_mesh(path, scale=scale, shell=shell, most_bytes=most_bytes, most_triangles=most_triangles)

    try:
        content = file.read_bytes() if version[1] <= most_bytes else None
    except OSError:  # `load_mesh` reports the error
        content = None
    return _weighed(content, (file.suffix.lower(), scale, shell, limits), make)


@lru_cache(CACHED)
def _scene_mesh(vertices: Any, faces: Any, scale: float, shell: bool) -> SceneMesh:
    arrays = np.array(vertices), np.array(faces)

    def make() -> Mesh:
        from graspfx.surfaces.triangles.mesh import make_mesh

        return make_mesh(*arrays, scale=scale, shell=shell, name="vertices")

    is_ragged = any(each.dtype == object for each in arrays)  # refused by `make_mesh`
    kinds = [(each.dtype.str, each.shape) for each in arrays]
    return _weighed(None if is_ragged else b"".join(each.tobytes() for each in arrays), (kinds, scale, shell), make)


def _weighed(content: bytes | None, settings: object, make: Callable[[], Mesh]) -> SceneMesh:
    """Return a mesh in its body's frame, with its mass properties, from the cache or by calling `make`.

    Args:
        content: Content of the mesh's file, or bytes of its arrays; None for a mesh that is not cached.
        settings: All other values on which the mesh depends; their `repr` must be complete, because it is hashed.
        make: Function that makes the mesh in the file's frame.
    """

    def weigh() -> SceneMesh:
        mesh = make()
        unit = mesh.mass_properties(mass=1.0) if mesh.shell else mesh.mass_properties(density=1.0)
        own = mesh.seen_from(unit.centre, unit.axes)
        _ = own.data  # computed here, so that it is cached too
        return SceneMesh(own, unit)

    distributions = installed.distributions()
    if content is None or distributions is None:
        return weigh()
    return through_cache((distributions, settings), content, weigh)
