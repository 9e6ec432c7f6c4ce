"""Disk cache of checked meshes, weighed and laid out, by the content of their files: trimesh is not loaded for them."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from hashlib import sha256
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx import installed
from graspfx.compile import cache
from graspfx.compile.own_sources import source_stamps

if TYPE_CHECKING:
    from graspfx.surfaces.triangles.mesh import MassProperties, Mesh

FORMAT = 1
LARGEST = 50_000_000  # [bytes] of an entry: a quarter of the cache
SEPARATOR = b"\n"  # after the entry's table, before its arrays
SHARES = ("centre", "inertia", "moments", "axes")  # of mass properties, beside the mass


def through_cache(content: bytes, settings: object, make: Callable[[], tuple[Mesh, MassProperties]]) -> Any:
    """Give the mesh and mass properties that `make` makes, from the cache where they are of this very content.

    Args:
        content: of the mesh's file, or its arrays' bytes.
        settings: all else that the mesh follows from, in a form of which the text tells everything.
        make: makes both, or raises; a mesh that is refused is not cached.
    """
    distributions = installed.distributions()
    if distributions is None:
        return make()
    parts = FORMAT, sys.version, sys.byteorder, source_stamps(), distributions, repr(settings)
    key = sha256(repr(parts).encode() + b"\0" + sha256(content).digest()).hexdigest()
    entry = cache.load(key)
    if entry is not None:
        return _read(entry)
    mesh, unit = make()
    text = _written(mesh, unit)
    if len(text) <= LARGEST:
        cache.store(key, text)
    return mesh, unit


def _written(mesh: Mesh, unit: MassProperties) -> bytes:
    arrays = [mesh.vertices, mesh.faces, mesh.data, *(getattr(unit, name) for name in SHARES)]
    plain = [np.ascontiguousarray(each) for each in arrays]
    table = {
        "arrays": [[each.dtype.str, each.shape] for each in plain],
        "shell": mesh.shell,
        "notes": mesh.notes,
        "mass": unit.mass.hex(),
    }
    return b"".join([json.dumps(table).encode(), SEPARATOR, *(each.tobytes() for each in plain)])


def _read(entry: bytes) -> tuple[Mesh, MassProperties]:
    from graspfx.surfaces.triangles.mesh import MassProperties, Mesh

    head, _, rest = entry.partition(SEPARATOR)
    table = json.loads(head)
    start, arrays = 0, list[NDArray[Any]]()
    for kind, shape in table["arrays"]:
        count = int(np.prod(shape, dtype=np.int64))
        flat = np.frombuffer(rest, dtype=kind, count=count, offset=start)
        arrays.append(flat.reshape(shape).copy())  # that may be written to, like one that has been computed
        start += flat.nbytes
    vertices, faces, data, *shares = arrays
    mesh = Mesh(vertices, faces, table["shell"], tuple(table["notes"]))
    vars(mesh)["data"] = data  # the value of its cached property
    return mesh, MassProperties(float.fromhex(table["mass"]), *shares)
