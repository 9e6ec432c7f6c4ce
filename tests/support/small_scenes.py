"""Small scenes that several tests run: two fingers on a line, and fingers attached to a box."""

from __future__ import annotations

from typing import Any

import numpy as np

import graspfx as gx

M, B, SPRING, M_V, B_V = 0.12, 0.3, 40.0, 0.2, 0.9
KEP, KIP = 25.0, 60.0

POINT = {"name": "simulated", "mass": 0.15, "damping": 0.2}
LINE: dict[str, Any] = {
    "dimensions": 1,
    "period": 0.005,
    "duration": 0.3,
    "object": {  # the integrator that the native body has for others, too
        "mass": 0.1, "viscosity": 0.8, "integrator": "semi-implicit", "shape": {"kind": "box", "size": [0.05]},
    },
    "coupling": {"external": {"stiffness": 30.0}, "internal": {"stiffness": 70.0, "damping": 0.1}},
    "finger": [
        {"start": [x], "device": POINT, "hand": {"stiffness": 60.0, "damping": 0.5, "squeeze": 0.005}}
        for x in (-0.0251, 0.0252)
    ],
}  # fmt: skip


def line(**changes: Any) -> gx.Scene:
    """Two fingers on a box; changes by dotted key, __ for dots."""
    return gx.Scene(**LINE).replace({key.replace("__", "."): value for key, value in changes.items()})


def attached(d: int, integrator: str = "exact", squeeze: float = 0.0, **device: object) -> gx.Scene:
    """2, 3 and 4 fingers held on the middle of sides of a box, and `squeeze` [m] into it."""
    size = [0.04, 0.05, 0.06][:d]
    directions = {1: [[-1], [1]], 2: [[-1, 0], [1, 0], [0, 1]], 3: [[-1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, -1]]}[d]
    start = [(0.5 * np.array(size) * np.array(u)).tolist() for u in directions]
    rest = [(np.array(p) * (1.0 - squeeze / np.linalg.norm(p))).tolist() for p in start]
    table = {"name": "simulated", "mass": M, "damping": B} | device
    return gx.Scene(
        dimensions=d,
        period=0.004,
        duration=1.0,
        object={
            "mass": M_V,
            "viscosity": B_V,
            "integrator": integrator,
            "shape": {"kind": "box", "size": size},
        }
        | ({} if d == 1 else {"rotational_viscosity": 4e-4}),
        coupling={"contact": "attached", "external": {"stiffness": KEP}, "internal": {"stiffness": KIP}},
        finger=[
            {"start": p, "device": table, "hand": {"stiffness": SPRING, "damping": 0.1, "rest": r}}
            for p, r in zip(start, rest, strict=True)
        ],
    )


def closing(**changes: Any) -> gx.Scene:
    """Three fingers that close on a disc, touch it one after another at up to 0.1 m/s, and hold it."""
    angles = 2 * np.pi * np.arange(3) / 3 + 0.1
    out = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    hand = {"stiffness": 300.0, "damping": 3.0, "squeeze": 0.01, "squeeze_ramp": 0.1}
    device = {"name": "simulated", "mass": 0.1, "damping": 0.5}
    disc = {"kind": "sphere", "radius": 0.03}
    scene = gx.Scene(
        dimensions=2,
        period=0.002,
        duration=0.12,
        object={"mass": 0.1, "viscosity": 0.5, "rotational_viscosity": 2e-4, "shape": disc},
        coupling={"external": {"stiffness": 200.0}, "internal": {"stiffness": 400.0}, "friction": 0.6},
        finger=[{"start": ((0.033 + 0.0007 * i) * out[i]).tolist(), "device": device, "hand": hand} for i in range(3)],
    )
    return scene.replace({key.replace("__", "."): value for key, value in changes.items()})
