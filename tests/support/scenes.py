"""Random scenes of the size of a hand, and any scene in other units of length, mass and time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from tests.support.scatter import rotation

UNITS: dict[str, tuple[int, int, int]] = {  # powers of length, mass and time, by the last words of a key
    "period": (0, 0, 1), "duration": (0, 0, 1), "begin": (0, 0, 1), "ramp": (0, 0, 1), "frequency": (0, 0, -1),
    "gravity": (1, 0, -2), "object.mass": (0, 1, 0), "device.mass": (0, 1, 0), "viscosity": (0, 1, -1),
    "rotational_viscosity": (2, 1, -1), "inertia": (2, 1, 0), "size": (1, 0, 0), "shape.radius": (1, 0, 0),
    "length": (1, 0, 0), "semi_axes": (1, 0, 0), "position": (1, 0, 0), "velocity": (1, 0, -1),
    "angular_velocity": (0, 0, -1), "stiffness": (0, 1, -2), "damping": (0, 1, -1), "fade": (1, 0, 0),
    "blend": (1, 0, 0), "start": (1, 0, 0), "finger.radius": (1, 0, 0), "patch": (1, 0, 0),
    "device.damping": (0, 1, -1), "resolution": (1, 0, 0), "force_limit": (1, 1, -2), "rest": (1, 0, 0),
    "amplitude": (1, 0, 0), "displacement": (1, 0, 0), "vertices": (1, 0, 0),
}  # fmt: skip
COLUMNS: dict[str, tuple[int, int, int]] = {
    "finger_position": (1, 0, 0), "finger_velocity": (1, 0, -1), "contact_position": (1, 0, 0),
    "finger_force": (1, 1, -2), "finger_moment": (2, 1, -2), "touching": (0, 0, 0), "status": (0, 0, 0),
    "gap": (1, 0, 0), "true_position": (1, 0, 0), "device_energy": (2, 1, -2), "position": (1, 0, 0),
    "velocity": (1, 0, -1), "orientation": (0, 0, 0), "angular_velocity": (0, 0, -1), "law": (0, 0, 0),
    "residual": (1, 1, -2), "contact_normal": (0, 0, 0),
}  # fmt: skip


def factor(powers: tuple[int, int, int], units: tuple[float, float, float]) -> float:
    """Give the factor of a quantity."""
    return float(np.prod([unit**power for unit, power in zip(units, powers, strict=True)]))


def in_units(table: Any, units: tuple[float, float, float], path: tuple[str, ...] = ()) -> Any:
    """A scene's table with every length, mass and time in units that much smaller."""
    if isinstance(table, Mapping):
        return {key: in_units(value, units, (*path, key)) for key, value in table.items()}
    if isinstance(table, list) and table and isinstance(table[0], Mapping):
        return [in_units(value, units, path) for value in table]
    powers = UNITS.get(".".join(path[-2:])) or UNITS.get(path[-1])
    if powers is None or isinstance(table, bool | str):
        return table
    return (np.asarray(table, dtype=float) * factor(powers, units)).tolist()


def random_shape(rng: np.random.Generator, d: int) -> tuple[dict[str, Any], Callable[[Any], float]]:
    """A shape of some centimetres and how far its surface is from the centre, at most."""
    size = float(rng.uniform(0.02, 0.04))
    kinds = {1: ["box", "sphere"], 2: ["box", "sphere", "capsule", "ellipsoid"]}
    kind = str(rng.choice(kinds.get(d, ["box", "sphere", "capsule", "cylinder", "ellipsoid"])))
    if kind == "box":
        return {"kind": kind, "size": (2.0 * size * rng.uniform(0.6, 1.0, d)).tolist()}, lambda u: size
    if kind == "sphere":
        return {"kind": kind, "radius": size}, lambda u: size
    if kind == "ellipsoid":
        return {"kind": kind, "semi_axes": (size * rng.uniform(0.5, 1.0, d)).tolist()}, lambda u: size
    return {"kind": kind, "radius": 0.5 * size, "length": size}, lambda u: size


def random_table(rng: np.random.Generator, most: int = 6) -> dict[str, Any]:
    """1 to `most` fingers that hands press on an object from all around, touching or about to; 60 ms at 1 ms."""
    d, n = int(rng.integers(1, 4)), int(rng.integers(1, most + 1))
    shape, reach = random_shape(rng, d)
    mass = float(rng.uniform(0.05, 0.3))
    thing: dict[str, Any] = {
        "mass": mass,
        "viscosity": float(rng.uniform(0.0, 2.0)),
        "integrator": str(rng.choice(["explicit", "semi-implicit", "exact", "implicit"])),
        "shape": shape,
        "velocity": (0.05 * rng.normal(size=d)).tolist(),
    }
    if d > 1:
        thing["rotational_viscosity"] = float(rng.uniform(1e-4, 1e-3))
        thing["angular_velocity"] = float(rng.normal()) if d == 2 else rng.normal(size=3).tolist()
    friction: Any = [0.0, "stick", float(rng.uniform(0.1, 0.8))][int(rng.integers(3))]
    contact = str(rng.choice(["attached", "unilateral", "unilateral"]))
    coupling: dict[str, Any] = {
        "contact": contact,
        "friction": friction,
        "reaction": str(rng.choice(["fingertip", "contact"])),
        "absent": str(rng.choice(["fade", "follow"])),
        "fade": [0.002, 0.01],
        "blend": [0.00025, 0.001],
        "external": {"stiffness": float(rng.uniform(30.0, 300.0)), "damping": float(rng.uniform(0.0, 0.3))},
        "internal": {"stiffness": float(rng.uniform(30.0, 300.0)), "damping": float(rng.uniform(0.0, 0.3))},
    }
    u = rng.normal(size=(n, d)) if d < 3 else rng.normal(size=(n, d)) @ rotation(rng)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    if n > 1 and rng.random() < 0.3:
        u[1] = u[0]  # two fingers in one place
    fingers = []
    for i in range(n):
        start = reach(u[i]) * float(rng.uniform(0.9, 1.4)) * u[i]
        finger: dict[str, Any] = {
            "device": {"name": "simulated", "mass": float(rng.uniform(0.05, 0.2)), "damping": 0.3},
            "hand": {
                "stiffness": float(rng.uniform(50.0, 200.0)),
                "damping": float(rng.uniform(0.0, 1.0)),
                "rest": (0.3 * start).tolist(),
            },
            "start": start.tolist(),
        }
        if rng.random() < 0.3 and contact == "unilateral":
            finger["radius"] = float(rng.uniform(0.004, 0.01))
        fingers.append(finger)
    table = {"dimensions": d, "period": 0.001, "duration": 0.06, "object": thing, "coupling": coupling}
    return {**table, "finger": fingers}
