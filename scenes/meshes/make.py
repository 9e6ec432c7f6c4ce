"""Write the meshes in this folder, in millimetres, as binary PLY files: `python scenes/meshes/make.py`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import trimesh

HERE = Path(__file__).parent

# A mug standing on z = 0, its axis along z, its handle towards +x [mm].
HEIGHT, OUTER, INNER, FLOOR = 80.0, 40.0, 36.0, 5.0
RING, TUBE = 24.0, 5.0  # radii of the handle, a torus about a point of the outer wall at half the height
AROUND, RING_AROUND, TUBE_AROUND = 96, 80, 24  # facets

PLATE = (80.0, 60.0, 1.0)  # full edges, about the centre [mm]

RADIUS, BUMPS = 40.0, 0.08  # of the potato: radius, and height of its bumps relative to it
SUBDIVISIONS = 5  # 20 * 4^5 = 20480 triangles


def mug() -> Any:
    """Build a mug: a cylinder and a torus as the handle, minus the cavity of the mug."""
    wall = trimesh.creation.cylinder(radius=OUTER, segment=[(0.0, 0.0, 0.0), (0.0, 0.0, HEIGHT)], sections=AROUND)
    room = trimesh.creation.cylinder(
        radius=INNER, segment=[(0.0, 0.0, FLOOR), (0.0, 0.0, 1.5 * HEIGHT)], sections=AROUND
    )
    handle = trimesh.creation.torus(RING, TUBE, major_sections=RING_AROUND, minor_sections=TUBE_AROUND)
    upright = trimesh.transformations.rotation_matrix(np.pi / 2.0, (1.0, 0.0, 0.0))
    upright[:3, 3] = OUTER, 0.0, 0.5 * HEIGHT
    handle.apply_transform(upright)
    return trimesh.boolean.difference(
        [trimesh.boolean.union([wall, handle], engine="manifold"), room], engine="manifold"
    )


def plate() -> Any:
    """Build a thin plate; for a finger in the plate, the nearest point is often on the side opposite to its contact."""
    return trimesh.creation.box(extents=PLATE)


def potato() -> Any:
    """Build a ball with smooth bumps, which has many small triangles.

    The distance of a vertex from the centre, in the direction of the unit vector (x, y, z), is

        R (1 + h (sin(2 x + 1) sin(3 y) + sin(3 z + 1) cos(2 x) / 2 + sin(5 y + 2) sin(4 z + 1) / 4))

    with the radius R and the relative height h of the bumps.
    """
    ball = trimesh.creation.icosphere(subdivisions=SUBDIVISIONS)
    x, y, z = np.asarray(ball.vertices).T
    bumps = np.sin(2 * x + 1) * np.sin(3 * y) + np.sin(3 * z + 1) * np.cos(2 * x) / 2
    bumps += np.sin(5 * y + 2) * np.sin(4 * z + 1) / 4
    ball.vertices = np.column_stack([x, y, z]) * (RADIUS * (1.0 + BUMPS * bumps))[:, None]
    return ball


MAKERS = {"mug": mug, "plate": plate, "potato": potato}


def write(folder: Path = HERE) -> None:
    """Write each mesh to the file NAME.ply in a folder."""
    for name, make in MAKERS.items():
        mesh = make()
        bare = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        (folder / f"{name}.ply").write_bytes(trimesh.exchange.ply.export_ply(bare, vertex_normal=False))


if __name__ == "__main__":
    write()
