"""A prism with any number of sides, as a generated mesh; fingers at the centres of sides lift the prism."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import graspfx as gx

KIP, HAND = 800.0, 300.0  # coupling stiffness and stiffness of a finger's hand [N/m]


def prism(sides: int, radius: float, height: float) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Build the mesh of a regular prism with s sides about the z axis.

    The first side, between corners 0 and 1, is normal to x.

    Args:
        sides: Number of sides s.
        radius: Distance from the axis to a corner [m].
        height: Height [m].

    Returns:
        Vertices (2 s + 2, 3) [m]: the corners at the bottom and at the top, and the centres of both; and faces
        (4 s, 3).
    """
    corner = np.arange(sides)
    following = (corner + 1) % sides
    angle = np.pi * (2 * corner - 1) / sides
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    ends = [np.insert(ring, 2, z, axis=1) for z in (-height / 2, height / 2)]
    middles = np.array([[0.0, 0.0, -height / 2], [0.0, 0.0, height / 2]])
    bottom, top = np.full(sides, 2 * sides), np.full(sides, 2 * sides + 1)
    faces = np.stack(
        [
            [corner, following, following + sides],  # counter-clockwise, seen from outside
            [corner, following + sides, corner + sides],
            [bottom, following, corner],
            [top, corner + sides, following + sides],
        ]
    )
    return np.concatenate([*ends, middles]), faces.transpose(0, 2, 1).reshape(-1, 3)


def scene(
    sides: int = 6,
    radius: float = 0.03,
    height: float = 0.05,
    fingers: int = 3,
    pinch: float = 1.0,
    density: float = 600.0,
    friction: float = 0.6,
) -> gx.Scene:
    """Make the scene, in which fingers lift a prism by 30 mm.

    The fingers start in equilibrium at the penetration depth pinch/KIP, with the coupling stiffness KIP.

    Args:
        sides: Number of sides, at least three.
        radius: Distance from the axis to a corner [m].
        height: Height [m].
        fingers: Number of fingers, from two to the number of sides. The fingers are evenly spaced if the number of
            fingers divides the number of sides.
        pinch: Force of each finger [N]. The sum of these forces times `friction` must exceed the prism's weight.
        density: Density [kg/m^3]; by default that of wood.
        friction: Coefficient of friction.
    """
    if not (isinstance(sides, int) and sides >= 3):
        raise gx.errors.InputError("sides", sides, "an integer of at least 3")
    if not (isinstance(fingers, int) and 2 <= fingers <= sides):
        raise gx.errors.InputError("fingers", fingers, f"an integer from 2 to {sides}, at most one per side")
    vertices, faces = prism(sides, radius, height)
    angle = 2 * np.pi * (np.arange(fingers) * sides // fingers) / sides  # angle of each side's normal
    outward = np.stack([np.cos(angle), np.sin(angle), np.zeros(fingers)], axis=1)
    start = (radius * np.cos(np.pi / sides) - pinch / KIP) * outward
    rest = start - pinch / HAND * outward
    lift = {"kind": "reach", "displacement": [0.0, 0.0, 0.03], "begin": 0.5, "duration": 0.6}
    device = {"name": "simulated", "mass": 0.1, "damping": 0.5}
    hand = {"stiffness": HAND, "damping": 6.0, "motion": lift}
    return gx.Scene(
        title=f"A prism of {sides} sides in {fingers} fingers",
        dimensions=3,
        period=0.002,
        duration=2.0,
        gravity=[0.0, 0.0, -9.81],
        object={
            "name": "prism",
            "density": density,
            "viscosity": 0.2,
            "rotational_viscosity": 2e-4,
            "shape": {"vertices": vertices.tolist(), "faces": faces.tolist()},
        },
        coupling={
            "external": {"stiffness": 400.0, "damping": 1.0},
            "internal": {"stiffness": KIP, "damping": 1.0},
            "friction": friction,
        },
        finger=[
            {"start": start[i].tolist(), "device": device, "hand": hand | {"rest": rest[i].tolist()}}
            for i in range(fingers)
        ],
    )
