"""Disk cache of checked meshes, weighed and laid out, by the content of their files: trimesh is not loaded for them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from graspfx import installed
from graspfx.compile.array_cache import content_key, load_arrays, store_arrays

if TYPE_CHECKING:
    from graspfx.surfaces.triangles.mesh import MassProperties, Mesh

SHARES = ("centre", "inertia", "moments", "axes")  # of mass properties, beside the mass


def through_cache(
    content: bytes, settings: object, make: Callable[[], tuple[Mesh, MassProperties]]
) -> tuple[Mesh, MassProperties]:
    """Give the mesh and mass properties that `make` makes, from the cache where they are of this very content.

    Args:
        content: of the mesh's file, or its arrays' bytes.
        settings: all else that the mesh follows from, in a form of which the text tells everything.
        make: makes both, or raises; a mesh that is refused is not cached.
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
    vars(mesh)["data"] = data  # the value of its cached property
    return mesh, MassProperties(float.fromhex(table["mass"]), *shares)
