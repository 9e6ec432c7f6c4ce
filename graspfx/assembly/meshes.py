"""Meshes of a scene: read, checked and prepared once, then cached on disk by the content of their files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from graspfx import installed
from graspfx.compile.array_cache import content_key, load_arrays, store_arrays
from graspfx.compile.records import numbers
from graspfx.environment import require_file, to_path
from graspfx.errors import InputError
from graspfx.spatial import Quaternion, Vector, quaternion, rotate

if TYPE_CHECKING:
    from graspfx.scene.tables.part_tables import Object, Obstacle
    from graspfx.surfaces.triangles.mesh import MassProperties, Mesh


SHARES = ("centre", "inertia", "moments", "axes")  # mass properties except the mass


def through_cache(
    content: bytes, settings: object, make: Callable[[], tuple[Mesh, MassProperties]]
) -> tuple[Mesh, MassProperties]:
    """Return the mesh and mass properties from the cache if it has an entry for the content, else from `make`.

    Args:
        content: Content of the mesh's file, or bytes of its arrays.
        settings: Everything else on which the mesh depends, as a value with a complete text form.
        make: Function that makes the mesh and its mass properties, or raises; an invalid mesh is not cached.
    """
    distributions = installed.distributions()
    if distributions is None:
        return make()
    key = content_key((distributions, settings), content)
    entry = load_arrays(key)
    if entry is None:
        mesh, unit = make()
        head = {"shell": mesh.shell, "notes": mesh.notes, "mass": unit.mass.hex()}
        arrays = mesh.vertices, mesh.faces, mesh.data, *(getattr(unit, name) for name in SHARES)
        store_arrays(key, head, arrays)
        return mesh, unit
    from graspfx.surfaces.triangles.mesh import MassProperties, Mesh

    table, (vertices, faces, data, *shares) = entry
    mesh = Mesh(vertices, faces, table["shell"], tuple(table["notes"]))
    vars(mesh)["data"] = data  # value of its cached property
    return mesh, MassProperties(float.fromhex(table["mass"]), *shares)


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
            raise InputError("density", "a shell", "the object's mass", "a surface has no volume")
        return self.unit.mass

    def moments(self, mass: float) -> Numbers:
        """Compute the principal moments of inertia for a mass, (3,) [kg m^2]."""
        return tuple((self.unit.moments * (mass / self.unit.mass)).tolist())

    @property
    def turn(self) -> Quaternion:
        """Unit quaternion of the body's axes in the file's frame."""
        return quaternion(self.unit.axes.ravel().tolist())

    def body_pose(self, position: Numbers | None, orientation: Numbers | None) -> tuple[Numbers, Numbers]:
        """Compute the pose of the centre of mass and principal axes from the pose of the file's frame."""
        x, y, z = position or (0.0, 0.0, 0.0)
        q = Quaternion(*(orientation or (0.0, 0.0, 0.0, 1.0)))
        centre = rotate(q, Vector(*self.unit.centre.tolist()))
        return (x + centre.x, y + centre.y, z + centre.z), tuple(numbers(q @ self.turn))

    @property
    def frame(self) -> Mapping[str, list[float]]:
        """Pose of the file's frame in the body's frame, for viewers that draw the file."""
        turn = self.turn.conjugate
        centre = rotate(turn, Vector(*self.unit.centre.tolist()))
        return {"position": [-each for each in numbers(centre)], "orientation": list(numbers(turn))}


def scene_mesh(table: Object | Obstacle, folder: Path | None) -> SceneMesh | None:
    """Load the mesh of an object or obstacle; None if its shape is not a mesh.

    Raises:
        InputError: If a value of the shape's table is invalid; the error names its key.
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
    """Return the name of a mesh: that of its file or, without a file, one with the object's name."""
    path = getattr(table.shape, "mesh", None)
    return Path(path).name if path else f"mesh of {table.name}"


@lru_cache(CACHED)
def _read(path: str, version: tuple[int, int], scale: float, shell: bool, limits: tuple[int, int]) -> SceneMesh:
    most_bytes, most_triangles = limits

    def make() -> tuple[Mesh, MassProperties]:
        from graspfx.surfaces.triangles.mesh import load_mesh

        return _weighed(load_mesh(path, scale=scale, shell=shell, most_bytes=most_bytes, most_triangles=most_triangles))

    file = Path(path)
    if version[1] > most_bytes:
        return SceneMesh(*make())
    try:
        content = file.read_bytes()
    except OSError:  # `load_mesh` reports the error
        return SceneMesh(*make())
    return SceneMesh(*through_cache(content, (file.suffix.lower(), scale, shell, limits), make))


@lru_cache(CACHED)
def _scene_mesh(vertices: Any, faces: Any, scale: float, shell: bool) -> SceneMesh:
    arrays = np.array(vertices), np.array(faces)

    def make() -> tuple[Mesh, MassProperties]:
        from graspfx.surfaces.triangles.mesh import make_mesh

        return _weighed(make_mesh(*arrays, scale=scale, shell=shell, name="vertices"))

    if any(each.dtype == object for each in arrays):  # ragged: refused
        return SceneMesh(*make())
    content = b"".join(each.tobytes() for each in arrays)
    kinds = [(each.dtype.str, each.shape) for each in arrays]
    return SceneMesh(*through_cache(content, (kinds, scale, shell), make))


def _weighed(mesh: Mesh) -> tuple[Mesh, MassProperties]:
    """Transform a mesh to its body's frame; return it, with its mass properties in the file's frame."""
    unit = mesh.mass_properties(mass=1.0) if mesh.shell else mesh.mass_properties(density=1.0)
    return mesh.seen_from(unit.centre, unit.axes), unit
