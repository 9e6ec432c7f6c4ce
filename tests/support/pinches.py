"""Fingers around an object that a test looks at with limits: a squeeze that waves, and a flick."""

from __future__ import annotations

from typing import Any

import numpy as np

import graspfx as gx

PERIOD = 0.002


def pinch(d: int = 2, *, safety: dict[str, Any] | None = None, **changes: Any) -> gx.Scene:
    """Three fingers around a ball, two between the walls of a line, that squeeze it with 0.4 N or so and wave."""
    n = 2 if d == 1 else 3
    angles = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    around = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(n)])[:, :d].round(15)
    motion = {"kind": "sine", "amplitude": 0.01, "frequency": 1.0, "axis": "x"}
    table = {
        "dimensions": d, "period": PERIOD, "duration": 0.6,
        "object": {
            "mass": 0.1, "viscosity": 0.5,
            "shape": {"kind": "sphere", "radius": 0.025} if d > 1 else {"kind": "box", "size": [0.05]},
        } | ({} if d == 1 else {"rotational_viscosity": 3e-4}),
        "coupling": {
            "external": {"stiffness": 60.0, "damping": 0.05}, "internal": {"stiffness": 150.0, "damping": 0.1},
        },
        "finger": [
            {
                "start": (0.0255 * each).tolist(), "device": {"name": "simulated", "mass": 0.1, "damping": 0.2},
                "hand": {"stiffness": 150.0, "damping": 1.0, "squeeze": 0.006, "closing": (-each).tolist(),
                         "motion": motion},
            }
            for each in around
        ],
    } | ({} if safety is None else {"safety": safety})  # fmt: skip
    return gx.Scene(**table).replace({key.replace("__", "."): value for key, value in changes.items()})


def flick(**changes: Any) -> gx.Scene:
    """A stiff hand that pushes a finger 20 mm into a free body of 0.1 kg and draws it back, 20 ms each."""
    motion = {"kind": "path", "times": [0.0, 0.02, 0.04], "positions": [[0.0], [0.02], [0.0]]}
    made = gx.Scene(
        dimensions=1, period=0.0001, duration=0.1,
        object={"mass": 0.1, "viscosity": 0.0, "integrator": "exact", "shape": {"kind": "box", "size": [0.05]}},
        coupling={"external": {"stiffness": 300.0}, "internal": {"stiffness": 300.0}},
        finger=[
            {
                "start": [-0.025], "device": {"name": "simulated", "mass": 0.02},
                "hand": {"stiffness": 4000.0, "damping": 18.0, "motion": motion},
            }
        ],
    )  # fmt: skip
    return made.replace({key.replace("__", "."): value for key, value in changes.items()})
