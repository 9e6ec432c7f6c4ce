"""Grasps in one block: their law, their sample, and fingers that slip, stick or rub."""

from __future__ import annotations

from typing import Any

import numpy as np

import graspfx as gx
from graspfx.coupling.grasped import GraspedObject
from graspfx.coupling.rules import Rules
from graspfx.objects.body import fill_body
from graspfx.surfaces.closed_form.shape import Box

RIGID = Rules(attached=True)
INERTIA = {1: None, 2: 4e-5, 3: (1e-5, 2e-5, 3e-5)}
SHARP = (1e-9, 2e-9)  # a blend that is over before any contact is so near a line
MU = 0.6
ON_A_LINE: dict[str, Any] = {"inertia": None, "rotational_viscosity": 0.0}


def polygon(n: int, R: float) -> np.ndarray:
    """Corners of a regular polygon (n, 2), the first on the x axis."""
    angle = 2 * np.pi * np.arange(n) / n
    return R * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def law(kep: Any, kip: Any, ked: Any = 0.0, kid: Any = 0.0, form: Any = "literal") -> gx.Coupling:
    return gx.Coupling(external=gx.Impedance(kep, ked), internal=gx.Impedance(kip, kid), form=form)


def grasped(
    n: int, d: int, gains: gx.Coupling, rules: Rules, *, period: float = 0.005, contacts: Any = None,
    shape: Any = None, limit: Any = None, radius: Any = 0.0, **settings: Any,
) -> GraspedObject:  # fmt: skip
    """n fingers on an object of 0.1 kg, attached at contacts where they are given."""

    def fill(state: np.ndarray) -> None:
        fill_body(state, **{"dimensions": d, "mass": 0.1, "inertia": 4e-5, "rotational_viscosity": 1e-4, **settings})

    g = GraspedObject(n, d, period, gains, rules, fill, shape=shape, limit=limit, radius=radius)
    if contacts is not None:
        g.attach(contacts)
    return g


def respond(g: GraspedObject, position: Any, velocity: Any = 0.0) -> np.ndarray:
    g.finger_position[:] = position
    g.finger_velocity[:] = velocity
    assert g.sample() == 0
    return g.force.copy()


def free_mask(d: int, kind: str) -> list[bool]:
    turns = {1: 0, 2: 1, 3: 3}[d]
    return {
        "all": [True] * (d + turns),
        "no turning": [True] * d + [False] * turns,
        "knob": [False] * d + [False] * max(turns - 1, 0) + [True] * min(turns, 1),
        "rail": [True] + [False] * (d - 1) + [True] * turns,
    }[kind]


def finger_grasp(
    n: int, d: int, gains: gx.Coupling, kind: str, depth: float, *, shape: Any = None, **more: Any
) -> GraspedObject:
    """An object of n fingers that slip freely, stick, or have a coefficient."""
    rules = Rules(
        fade=None,
        stick=kind == "stick",
        friction=MU if kind == "rough" else 0.0,
        blend=SHARP,
        damping_depth=depth,
        share=more.pop("share", None),
        patch=more.pop("patch", 0.0),
    )
    turning = {"inertia": INERTIA[d], **({"rotational_viscosity": 0.0} if d == 1 else {})}
    return grasped(n, d, gains, rules, shape=shape or Box((0.05,) * d), **{**turning, **more})
