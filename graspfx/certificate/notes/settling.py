"""Whether a sampled grasp settles: the stiffness of eq. (4), a period late, against devices, hands and objects."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf, isfinite, log

import numpy as np

from graspfx.analysis.stability import external_limits, wall_limits
from graspfx.build.bodies import mass
from graspfx.build.holdings import holdings
from graspfx.build.resolve import Parts
from graspfx.objects.dynamics_table import DYNAMICS
from graspfx.scene.model import Scene
from graspfx.scene.tables.hands import OwnHand, SharedHand

SLOWEST = 1.0  # [1/s]: what grows more slowly is not noticed in a run
Spring = tuple[float, float]  # K [N/m], B [N s/m]


def unsettled(parts: Parts) -> list[str]:
    """Write a sentence for each motion that grows from sample to sample, with the finger where it grows fastest.

    Each finger is taken as one of n alike. Squeezing, it swings against an object that stays: kip, and the grip.
    Moving, all n swing along with the object: kep, and the arm. Velocities count as known and forces as undelayed, and
    rotations are left out, so that silence is no proof. Nothing is said where a device does not tell its mass, of
    hands and dynamics of a plug-in's own, and of gains that are not one number.
    """
    scene = parts.scene
    external, internal = scene.coupling.external, scene.coupling.internal
    if not all(isinstance(g, float) for each in (external, internal) for g in (each.stiffness, each.damping)):
        return []
    kep, ked, kip, kid = (float(g) for each in (external, internal) for g in (each.stiffness, each.damping))  # type: ignore[arg-type]
    devices = _devices(parts)
    arms, grips = _springs(scene)
    notes: list[str] = []
    for number, thing in enumerate(scene.object):
        own = [i for i, k in enumerate(scene.finger_objects) if k == number and i in devices and i in grips]
        if not own:
            continue
        mean = np.mean([devices[i][0] for i in own])
        share = {i: devices[i][0] / float(mean) if scene.coupling.metric == "mass" else 1.0 for i in own}
        squeezing = {i: _growth(scene.period, devices[i], grips[i], (share[i] * kip, share[i] * kid)) for i in own}
        notes += _sentences(scene, squeezing, f"kip = {kip:g} N/m")
        if any(scene.free(thing)[: scene.dimensions]) and thing.dynamics in DYNAMICS:
            kind = DYNAMICS[thing.dynamics].integrator or thing.integrator
            body = len(own), mass(thing, parts.objects[number].solid), thing.viscosity, kind
            moving = {
                i: _growth(scene.period, devices[i], arms[i], (share[i] * kep, share[i] * ked), body) for i in own
            }
            notes += _sentences(scene, moving, f"kep = {kep:g} N/m with the {1e3 * body[1]:.3g} g of {thing.name}")
    return notes


def _sentences(scene: Scene, growth: dict[int, float], gain: str) -> Iterator[str]:
    finger = max(growth, key=lambda i: growth[i])
    if growth[finger] > SLOWEST:
        name = scene.finger_names[finger]
        yield (
            f"at a period of {1e3 * scene.period:g} ms {name} does not settle under {gain}: its swing grows "
            f"{np.exp(min(growth[finger] * scene.period, 99.0)):.3g}-fold each sample; lower the period or the gains, "
            "or raise the damping of device or hand"
        )


def _devices(parts: Parts) -> dict[int, Spring]:
    """Give by finger the mass [kg] and the damping [N s/m] that its device tells."""
    devices: dict[int, Spring] = {}
    for wire in parts.wires:
        features = wire.features
        if features.mass is not None:
            devices |= {int(i): (features.mass, features.friction or 0.0) for i in wire.used}
    return devices


def _springs(scene: Scene) -> tuple[dict[int, Spring], dict[int, Spring]]:
    """Find by finger the softest arm and grip along an axis; a hand that holds one finger is both."""
    arms: dict[int, Spring] = {}
    grips: dict[int, Spring] = {}
    for holding in holdings(scene):
        table = holding.table
        if table is not None and not isinstance(table, OwnHand | SharedHand):
            continue
        for i in holding.fingers:
            if isinstance(table, SharedHand):
                arms[i], grips[i] = _softest(table.arm), _softest(table.grip)
            else:
                arms[i] = grips[i] = (0.0, 0.0) if table is None else _softest(table)
    return arms, grips


def _softest(table: object) -> Spring:
    stiffness, damping = (np.asarray(getattr(table, name), dtype=float) for name in ("stiffness", "damping"))
    return float(stiffness.min()), float(damping.min())


def _growth(
    T: float, device: Spring, hand: Spring, gains: Spring, body: tuple[int, float, float, str] | None = None
) -> float:
    """Find the fastest growth [1/s] of a device m, b behind a hand K, B and gains k, d, held for T.

    Against an object that stays; or with `body`, n such devices that swing with an object of mass M and viscosity c,
    moved by the integrator named.
    """
    (m, b), (K, B), (k, d) = device, hand, gains
    if body is None:
        limits = wall_limits(m, b, T, spring=K, spring_damping=B, wall_damping=d)
    else:
        n, M, c, integrator = body
        limits = external_limits(
            m, b, T, M, c, fingers=n, spring=K, spring_damping=B, coupling_damping=d, integrator=integrator
        )
    radius = limits.spectral_radius(k)
    return log(radius) / T if isfinite(radius) else inf
