"""Random grasps at rest, each twice: as a scene that runs and as a linearisation put together from the same values."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.optimize import linprog

import graspfx as gx
from graspfx.analysis.grasp_stiffness import preloaded
from graspfx.analysis.stability import Linearisation, spectral_radius
from tests.support.optional import require

WIDTH = {1: 1, 2: 3, 3: 6}


@dataclass(frozen=True)
class Case:
    """A scene's table without its duration, the same as a linearisation, and the state of rest."""

    table: dict[str, Any]
    linear: Linearisation
    start: np.ndarray  # where the fingers rest (n, d) [m]
    force: np.ndarray  # of the fingers on the object at rest (n, d) [N]
    label: str


def random_case(seed: int, size: float = 1e-9) -> Case:
    """1-D, 2-D and 3-D; 1 to 5 fingers on a ball; free and locked; attached, or held by a squeeze and sticking.

    Args:
        seed: of everything.
        size: of the motion that is started [m]: far above rounding, far below a squeeze of 1 mm.
    """
    rng = np.random.default_rng(seed)

    def spread(low: float, high: float, size: int | None = None) -> Any:
        return np.exp(rng.uniform(np.log(low), np.log(high), size))

    d, n = int(rng.integers(1, 4)), int(rng.integers(1, 6))
    T, R = float(spread(1e-3, 1e-2)), rng.uniform(0.02, 0.05)
    free = rng.random(WIDTH[d]) < (1.0 if rng.random() < 0.5 else 0.7)
    integrator = str(rng.choice(["explicit", "semi-implicit", "exact", "implicit"]))
    mass = float(spread(0.03, 0.5))
    inertia = mass * R**2 * rng.uniform(0.3, 0.5, {1: 0, 2: 1, 3: 3}[d])
    viscosity = mass / T * float(spread(0.01, 0.5))  # times T/mass below 2, where plain integrators are stable
    turning = viscosity * R**2 * rng.uniform(0.1, 0.5)

    equal = rng.random() < 0.5
    masses = np.full(n, spread(0.03, 0.5)) if equal else spread(0.03, 0.5, n)
    friction = masses / T * (float(spread(0.01, 0.5)) if equal else spread(0.01, 0.5, n))
    metric = "mass" if rng.random() < 0.25 else "equal"
    hand = masses[:, None] / T**2 * spread(1e-4, 1e-2, n * d).reshape(n, d)  # up to a tenth of a radian per sample
    hand_damping = friction * rng.uniform(0.0, 1.0, n) * (rng.random() < 0.5)
    delay = rng.integers(0, 3, n) * (rng.random() < 0.3)
    squeezed = rng.random() < 0.5 and n > 1
    gains = _gains(rng, n, 2.0 * friction.mean() / T, friction.min())
    if d == 1 and not squeezed:
        hand *= rng.random((n, 1)) < 0.8  # some fingers that nobody holds

    u = _directions(rng, n, d, squeezed)
    contacts = R * u
    grasp = gx.Grasp(contacts, free=free)
    split = grasp.split(metric=masses / masses.mean() if metric == "mass" else None)
    law = gx.Coupling(gx.Impedance(*gains[0]), gx.Impedance(*gains[1]), form="symmetric")
    K, D = law.stiffness(split), law.damping(split)
    whole = all(each.all() or not each.any() for each in (free[:d], free[d:]))  # else the split turns with world axes
    depth = _depths(grasp.matrix @ K, u) if squeezed and whole else None
    if depth is None:
        depth = np.zeros(n)
        contact = "attached"
    else:
        depth *= rng.uniform(0.001, 0.003)
        delay = np.zeros(n, dtype=int)  # a squeeze that is felt late only would begin with a jump
        contact = str(rng.choice(["attached", "unilateral"]))
    e = -depth[:, None] * u
    force = (K @ e.ravel()).reshape(n, d)
    reaction = str(rng.choice(["fingertip", "contact"]))
    made = preloaded(contacts, e, force, free=free, reaction=reaction)
    if np.abs(made.G @ force.ravel()).max(initial=0.0) > 1e-12:
        reaction = "contact"  # forces with a shear are in balance where they touch, not at the tips
        made = preloaded(contacts, e, force, free=free, reaction=reaction)

    linear = Linearisation(
        period=T,
        mass=np.repeat(masses, d),
        friction=np.repeat(friction, d),
        G=made.G,
        G_displacement=made.G_displacement,
        preload=made.preload,
        inertia=np.concatenate([np.full(d, mass), inertia])[free],
        viscosity=np.concatenate([np.full(d, viscosity), np.full(len(inertia), turning)])[free],
        stiffness=K,
        damping=D,
        hand_stiffness=hand.ravel(),
        hand_damping=np.repeat(hand_damping, d),
        delay=np.repeat(delay, d),
        integrator=integrator,
    )
    pull = np.divide(force, hand, out=np.zeros_like(hand), where=hand > 0.0)
    rest = contacts + e + pull + size * rng.normal(size=(n, d))
    start = contacts + e + size * rng.normal(size=(n, 1)) * u  # along the normal: the contact stays where it is
    speed = np.where(free, rng.normal(size=WIDTH[d]) * 10.0 * size, 0.0)
    if len(inertia):
        speed[d:] /= R
    thing = {
        "mass": mass,
        "viscosity": viscosity,
        "integrator": integrator,
        "shape": {"kind": "sphere", "radius": R},
        "free": free.tolist(),
        "velocity": speed[:d].tolist(),
    }
    if len(inertia):
        thing |= {
            "inertia": inertia[0] if d == 2 else inertia.tolist(),
            "rotational_viscosity": turning,
            "angular_velocity": speed[d] if d == 2 else speed[d:].tolist(),
        }
    external, internal = ({"stiffness": k, "damping": b} for k, b in gains)
    table = {
        "dimensions": d,
        "period": T,
        "object": thing,
        "coupling": {
            "contact": contact,
            "friction": "stick",
            "absent": "follow",
            "form": "symmetric",
            "metric": metric,
            "reaction": reaction,
            "external": external,
            "internal": internal,
        },
        "finger": [
            {
                "device": {"name": "simulated", "mass": masses[i], "damping": friction[i], "delay": int(delay[i])},
                "hand": {"stiffness": hand[i].tolist(), "damping": hand_damping[i], "rest": rest[i].tolist()},
                "start": start[i].tolist(),
            }
            for i in range(n)
        ],
    }
    label = f"{d}-D, {n} fingers, {integrator}, {contact}{', squeezed' if depth.any() else ''}, free {free.astype(int)}"
    return Case(table, linear, contacts + e, force, label)


def scaled(case: Case, factor: float) -> Case:
    """Scale both stiffnesses of a grasp by a factor; the squeeze's forces grow with them."""
    table = {**case.table, "coupling": dict(case.table["coupling"])}
    for name in ("external", "internal"):
        pair = dict(table["coupling"][name])
        pair["stiffness"] = (factor * np.asarray(pair["stiffness"])).tolist()
        table["coupling"][name] = pair
    table["finger"] = []
    for i, finger in enumerate(case.table["finger"]):
        k = np.array(finger["hand"]["stiffness"])
        more = np.divide((factor - 1.0) * case.force[i], k, out=np.zeros_like(k), where=k > 0.0)
        hand = finger["hand"] | {"rest": (np.array(finger["hand"]["rest"]) + more).tolist()}
        table["finger"].append(finger | {"hand": hand})
    assert case.linear.preload is not None
    linear = case.linear.with_changes(stiffness=factor * case.linear.stiffness, preload=factor * case.linear.preload)
    return Case(table, linear, case.start, factor * case.force, case.label)


def _gains(rng: np.random.Generator, n: int, wall: float, friction: float) -> list[tuple[Any, Any]]:
    """(kep, ked) and (kip, kid): numbers, the same for both, or one per finger; `wall` is 2 b/T, a wall's limit."""
    k = wall * np.exp(rng.uniform(np.log(0.1), np.log(3.0), 2))
    b = friction * rng.uniform(0.0, 0.5, 2) * (rng.random() < 0.5)
    kind = rng.choice(["separate", "conventional", "per finger"], p=[0.7, 0.15, 0.15])
    if kind == "conventional":
        k[1], b[1] = k[0], b[0]
    if kind == "per finger":
        return [
            ((k[i] * rng.uniform(0.7, 1.4, n)).tolist(), (b[i] * rng.uniform(0.7, 1.4, n)).tolist()) for i in (0, 1)
        ]
    return [(float(k[i]), float(b[i])) for i in (0, 1)]


def _directions(rng: np.random.Generator, n: int, d: int, squeezed: bool) -> np.ndarray:
    """Unit vectors (n, d) from the centre; for a squeeze, two opposite ones or three in a plane through the centre."""
    u = rng.normal(size=(n, d))
    u /= np.linalg.norm(u, axis=1)[:, None]
    if squeezed and (n == 2 or d == 1):
        u[1] = -u[0]
    if squeezed and n == 3 and d == 3:
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        angles = rng.uniform(0.0, 2 * np.pi) + np.array([0.0, 2.1, 4.2]) + rng.uniform(-0.3, 0.3, 3)
        u = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ turn[:2]
    return u


def _depths(wrench: np.ndarray, u: np.ndarray) -> np.ndarray | None:
    """How deep each finger lies inside for no wrench on what moves, all above 0.2 of the deepest, 1; None if none can.

    Args:
        wrench: G K, (r, m).
        u: outward normals (n, d).
    """
    n, d = u.shape
    inward = np.zeros((n * d, n))
    for i in range(n):
        inward[d * i : d * (i + 1), i] = -u[i]
    A = wrench @ inward
    if not len(A):
        return np.ones(n)
    # dependent rows are left out: the rest of them would be zero only to rounding
    _, sizes, right = np.linalg.svd(A)
    kept = right[: int((sizes > 1e-9 * np.abs(wrench).max()).sum())]
    cost = np.r_[np.zeros(n), -1.0]
    above = np.hstack([-np.eye(n), np.ones((n, 1))])
    found = linprog(
        cost,
        A_ub=above,
        b_ub=np.zeros(n),
        A_eq=np.hstack([kept, np.zeros((len(kept), 1))]) if len(kept) else None,
        b_eq=np.zeros(len(kept)) if len(kept) else None,
        bounds=[(0.0, 1.0)] * n + [(0.0, 1.0)],
    )
    if not found.success or require(found.x)[-1] < 0.2:
        return None
    depth = require(found.x)[:n]
    if len(kept):  # to the last digit
        depth = depth - np.linalg.pinv(kept) @ (kept @ depth)
    return depth / depth.max()


FACTORS = np.geomspace(0.05, 20.0, 17)  # of both stiffnesses, where a boundary is looked for


def boundary(case: Case) -> float | None:
    """The first factor of both stiffnesses at which the spectral radius crosses 1, on a grid and then halved."""

    def sign(factor: float) -> bool:
        return spectral_radius(scaled(case, factor).linear) < 1.0

    before = sign(FACTORS[0])
    for low, high in pairwise(FACTORS):
        if sign(high) != before:
            for _ in range(24):
                middle = math.sqrt(low * high)
                low, high = (middle, high) if sign(middle) == before else (low, middle)
            return float(high)
    return None
