"""Twenty evenly spread fingers hold a bumpy mesh of 20480 triangles against gravity, and rotate the mesh."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import graspfx as gx

POTATO = Path(__file__).parent / "meshes" / "potato.ply"  # [mm]
GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))  # [rad]


def corners(file: Path) -> NDArray[np.float64]:
    """Read the vertices (V, 3) of a binary PLY file, which are four-byte floats before the triangles."""
    head, _, body = file.read_bytes().partition(b"end_header\n")
    count = int(head.partition(b"element vertex ")[2].split()[0])
    return np.frombuffer(body, "<f4", 3 * count).reshape(-1, 3).astype(np.float64)


def scene(fingers: int = 20, squeeze: float = 0.006, radius: float = 0.0, friction: float = 0.6) -> gx.Scene:
    """Make the scene, in which fingers start at the surface and close along its normals.

    The initial position of finger i is the vertex nearest to the direction i of a Fibonacci spiral, which has the
    height z_i = 1 - (2 i + 1)/n and the angle about z of i times the golden angle.

    Args:
        fingers: Number of fingers n.
        squeeze: Displacement of the closing motion of each finger [m].
        radius: Radius of the fingertips [m]; zero for point fingertips.
        friction: Coefficient of friction mu.
    """
    vertices = 0.001 * corners(POTATO)  # (V, 3) [m], 1 mm apart
    i = np.arange(fingers)
    z = 1.0 - (2.0 * i + 1.0) / fingers
    around = np.sqrt(1.0 - z * z)
    directions = np.stack([around * np.cos(GOLDEN_ANGLE * i), around * np.sin(GOLDEN_ANGLE * i), z], axis=1)
    cosines = directions @ (vertices / np.linalg.norm(vertices, axis=1, keepdims=True)).T
    starts = vertices[cosines.argmax(axis=1)] + radius * directions
    device = {"name": "simulated", "mass": 0.1, "damping": 0.5}  # [kg], [N s/m]
    return gx.Scene(
        title=f"{fingers} fingers on a bumpy mesh of 20480 triangles",
        dimensions=3,
        period=0.005,
        duration=1.5,
        gravity=[0.0, 0.0, -9.81],
        object={
            "density": 1000.0,  # 0.27 kg
            "viscosity": 0.5,
            "rotational_viscosity": 5e-4,
            "shape": {"mesh": str(POTATO), "scale": 0.001},
        },
        coupling={
            "external": {"stiffness": 200.0, "damping": 1.0},
            "internal": {"stiffness": 400.0, "damping": 1.0},
            "friction": friction,
            "damping_depth": 0.001,  # no step of the damping's force where the falling mesh is caught [m]
            "absent": "follow",  # all fingers stay near, with and without contact
        },
        hand=[
            {
                "name": "all",
                "arm": {"stiffness": 200.0, "damping": 4.0},
                "grip": {"stiffness": 200.0, "damping": 4.0},
                "squeeze": [{"to": squeeze, "begin": 0.0, "duration": 0.2}],
                "closing": "normal",
                "turn": {"kind": "reach", "angle": 0.5, "axis": "x", "begin": 0.3, "duration": 0.6},
            }
        ],
        finger=[{"device": device, "hand": "all", "start": start.tolist(), "radius": radius} for start in starts],
    )
