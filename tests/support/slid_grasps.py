"""Random frictional grasps whose contacts slide while the hands close, and two fingers with hands askew."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import graspfx as gx

DURATION = 4.0  # [s]: the hands are closed at 0.4, and motions have died out


def askew(
    friction: float | str, skew: float, external: float, internal: float, squeeze: float, ramp: float = 0.0
) -> gx.Scene:
    """Two fingers on a box that cannot turn; their hands close along lines `skew` [m] apart, at once or in `ramp` [s].

    What the hands take long to close leaves contacts on their cones' edges.
    """
    fingers: list[dict[str, Any]] = []
    for side in (1, -1):
        hand: dict[str, Any] = {"stiffness": 100.0, "damping": 1.0}
        if ramp:
            aside = [side * squeeze, side * skew / 2]
            hand |= {"squeeze": math.hypot(*aside), "squeeze_ramp": ramp, "closing": aside, "damping": 4.0}
        else:
            hand |= {"rest": [side * (squeeze - 0.025), side * skew / 2]}
        device = {"name": "simulated", "mass": 0.15, "damping": 0.2}
        fingers.append({"start": [-0.025 * side, 0.0], "device": device, "hand": hand})
    return gx.Scene(
        dimensions=2,
        period=0.005,
        duration=3.0,
        object={
            "mass": 0.1,
            "viscosity": 0.8,
            "integrator": "explicit",
            "shape": {"kind": "box", "size": [0.05, 0.05]},
            "free": [True, True, False],
        },
        coupling={"friction": friction, "external": {"stiffness": external}, "internal": {"stiffness": internal}},
        finger=fingers,
    )


def slid_grasp(seed: int) -> gx.Scene:
    """2 to 5 fingers on a box or a ball, in the plane or in space, whose hands close along lines beside the contacts.

    Hands are damped, so that what closing excites dies out; nothing but the fingers holds the object.
    """
    rng = np.random.default_rng(seed)
    d, n = int(rng.integers(2, 4)), int(rng.integers(2, 6))
    n = max(n, d)  # two fingers in space let the object swing about their line
    ball = bool(rng.random() < 0.5)
    half = rng.uniform(0.02, 0.03, d)
    directions = _around(rng, n, d)
    starts, inward = [], []
    for u in directions:
        reach = half[0] if ball else float(np.min(half / np.maximum(np.abs(u), 1e-9)))
        p = reach * u
        axis = int(np.argmax(np.abs(p) / half))
        normal = -u if ball else -np.sign(p[axis]) * np.eye(d)[axis]
        starts.append(p - 1e-4 * normal)
        inward.append(normal)
    squeeze = rng.uniform(0.004, 0.008)
    mu = float(rng.uniform(0.25, 0.7))
    mass, T = float(rng.uniform(0.1, 0.3)), 0.004
    fingers: list[dict[str, Any]] = []
    for p, normal in zip(starts, inward, strict=True):
        beside = rng.normal(size=d)
        beside -= (beside @ normal) * normal
        beside *= rng.uniform(0.3, 0.9) * squeeze / np.linalg.norm(beside)
        fingers.append(
            {
                "start": p.tolist(),
                "device": {"name": "simulated", "mass": float(rng.uniform(0.1, 0.2)), "damping": 0.4},
                "hand": {
                    "stiffness": float(rng.uniform(80.0, 150.0)),
                    "damping": float(rng.uniform(1.5, 2.5)),
                    "rest": (p + beside).tolist(),
                    "squeeze": squeeze,
                    "squeeze_ramp": 0.4,
                    "closing": normal.tolist(),
                },
            }
        )
    shape = {"kind": "sphere", "radius": float(half[0])} if ball else {"kind": "box", "size": (2.0 * half).tolist()}
    return gx.Scene(
        dimensions=d,
        period=T,
        duration=DURATION,
        object={
            "mass": mass,
            "viscosity": float(rng.uniform(0.5, 1.5)),
            "rotational_viscosity": float(mass * half[0] ** 2 * rng.uniform(3.0, 8.0)),
            "integrator": str(rng.choice(["explicit", "semi-implicit", "exact"])),
            "shape": shape,
        },
        coupling={
            "friction": mu,
            "external": {"stiffness": float(rng.uniform(20.0, 40.0))},
            "internal": {"stiffness": float(rng.uniform(60.0, 150.0))},
            "absent": "follow",
        },
        finger=fingers,
    )


def _around(rng: np.random.Generator, n: int, d: int) -> np.ndarray:
    """Directions from the centre that hold an object between them (n, d), not evenly."""
    if d == 2:
        angles = 2 * np.pi * np.arange(n) / n + rng.uniform(-0.25, 0.25, n) + rng.uniform(0.0, 2 * np.pi)
        return np.stack([np.cos(angles), np.sin(angles)], axis=1)
    if n == 3:
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        angles = 2 * np.pi * np.arange(3) / 3 + rng.uniform(-0.2, 0.2, 3)
        return np.stack([np.cos(angles), np.sin(angles)], axis=1) @ turn[:2]
    around: np.ndarray = rng.normal(size=(n, 3))
    for _ in range(200):  # they repel one another until they are spread
        apart = around[:, None] - around[None]
        apart /= (np.linalg.norm(apart, axis=2) ** 3 + np.eye(n))[:, :, None]
        around = around + 0.05 * apart.sum(axis=1)
        around /= np.linalg.norm(around, axis=1)[:, None]
    return around


def standing(integrator: str) -> gx.Scene:
    """Two fingers on a box in the plane that stands on a floor, which bears its weight."""
    fingers = [
        {
            "start": [0.025 * side, 0.03],
            "device": {"name": "simulated", "mass": 0.15, "damping": 0.4},
            "hand": {
                "stiffness": 100.0,
                "damping": 1.5,
                "squeeze": 0.006,
                "squeeze_ramp": 0.3,
                "closing": [-side, 0.0],
            },
        }
        for side in (-1, 1)
    ]
    return gx.Scene(
        dimensions=2,
        period=0.004,
        duration=3.0,
        gravity=[0.0, -9.81],
        world={"friction": 0.6},
        obstacle=[{"name": "floor", "shape": {"kind": "half-space", "normal": [0.0, 1.0]}}],
        object={
            "mass": 0.2,
            "viscosity": 0.8,
            "rotational_viscosity": 4e-4,
            "integrator": integrator,
            "shape": {"kind": "box", "size": [0.05, 0.06]},
            "position": [0.0, 0.03],
        },
        coupling={
            "friction": 0.5,
            "absent": "follow",
            "external": {"stiffness": 40.0},
            "internal": {"stiffness": 90.0},
        },
        finger=fingers,
    )
