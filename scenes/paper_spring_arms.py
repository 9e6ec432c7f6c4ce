"""The scene paper-spring in the plane with the paper's two-link arms, whose encoders have finite resolution."""

from __future__ import annotations

import graspfx as gx


def scene() -> gx.Scene:
    """Make the scene.

    Springs of 33 N/m, which are stretched by 7 mm, press the fingertips 3 mm into the cube. The contacts do not slide.
    """
    spring = gx.load("paper-spring")
    fingers = [
        {
            "start": [side * 0.022, 0.0],
            "device": {"name": "two-link", "base": [side * 0.04, -0.18], "elbow": elbow},
            "hand": {"stiffness": 33.0, "rest": [side * 0.015, 0.0]},
        }
        for side, elbow in ((-1.0, "left"), (1.0, "right"))
    ]
    return gx.Scene(
        title=spring.title,
        dimensions=2,
        period=spring.period,
        duration=spring.duration,
        object={
            "mass": 0.1,
            "viscosity": 0.8,
            "integrator": "explicit",
            "shape": {"kind": "box", "size": [0.05, 0.05]},
            "free": [True, True, False],
            "velocity": [0.001, 0.0],
        },
        coupling={
            "external": {"stiffness": 50.0},
            "internal": {"stiffness": 80.0},
            "friction": "stick",
            "absent": "follow",
        },
        finger=fingers,
    )
