"""Warnings about likely mistakes in a valid scene, such as unstable gains or settings without effect."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from graspfx.analysis.sampled_plant import Plant
from graspfx.assembly.bodies import mass
from graspfx.assembly.checks.units import unit_notes
from graspfx.assembly.grasps import grasps
from graspfx.assembly.hands import holdings
from graspfx.assembly.resolve import Parts
from graspfx.assembly.wiring import table_at
from graspfx.coupling.grasp_state import FingerState
from graspfx.grasp.object_impedance import ObjectImpedance
from graspfx.grasp.rigid_modes import NO_ARM, smoothstep
from graspfx.objects import integrators as body
from graspfx.objects.dynamics_table import DYNAMICS
from graspfx.scene.keys import dotted
from graspfx.scene.model import Scene
from graspfx.scene.tables.hand_tables import OwnHand, SharedHand

if TYPE_CHECKING:
    from graspfx.coupling.grasped import GraspedObject

SLOWEST = 1.0  # slower growth is not noticeable in a run [1/s]
Spring = tuple[float, float]  # K [N/m], B [N s/m]


def doubts(parts: Parts) -> list[str]:
    """List warnings about likely mistakes, as sentences; those about units come first."""
    return [*unit_notes(parts.scene, parts.stock), *other_doubts(parts)]


def other_doubts(parts: Parts) -> list[str]:
    """List warnings about meshes, former names of settings, `coupling.damping_depth`, and unstable gains."""
    return [*parts.mesh_notes, *former_notes(parts.scene), *depth_notes(parts.scene), *unsettled(parts)]


def former_notes(scene: Scene) -> list[str]:
    """Return a warning for each setting of a device that the scene gives under a former name."""
    tables = dict(table_at(scene, i) for i in range(len(scene.finger)))
    return [
        f"{dotted((*at, old))} is now called {now!r}; the old name is still accepted"
        for at, table in tables.items()
        for old, now in table.former.items()
    ]


def is_damped(scene: Scene) -> bool:
    """Return whether the external or the internal damping is not zero."""
    return any(np.any(np.asarray(each.damping)) for each in (scene.coupling.external, scene.coupling.internal))


def why_not_gradual(scene: Scene) -> str:
    """Return the reason why damping does not grow with penetration depth; empty if it does."""
    if not is_damped(scene):
        return "there is no damping"
    if scene.coupling.contact == "attached":
        return "attached contacts always have full damping"
    if scene.coupling.damping_depth == 0.0:
        return "coupling.damping_depth = 0: a touching finger has full damping at once"
    return ""


def depth_notes(scene: Scene) -> list[str]:
    """Return a warning if `coupling.damping_depth` is set but has no effect."""
    depth = scene.coupling.damping_depth
    if depth == 0.0:
        return []
    why = why_not_gradual(scene)
    return [f"coupling.damping_depth = {depth:g} m has no effect: {why}"] if why else []


def unsettled(parts: Parts) -> list[str]:
    """Return a warning for each oscillation that would grow from sample to sample, with the name of a finger.

    Two oscillations of each of the n fingers on an object are examined, as if all n fingers were equal. In the first,
    the finger oscillates against a fixed object; the springs are kip and the grip of the hand. In the second, all n
    fingers oscillate together with the object; the springs are kep and the arm of the hand. For each object, only the
    finger with the fastest growth is reported.

    Velocities are backward differences, and delays of forces and rotations are ignored. Therefore, a loop can be
    unstable without a warning. Devices that do not state their mass, plug-in hands, plug-in dynamics, and gains that
    are matrices are not examined.
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
        share = {i: devices[i][0] / float(mean) if scene.coupling.split == "mass" else 1.0 for i in own}
        squeezing = {
            i: _growth(Plant(*devices[i], scene.period, *grips[i], share[i] * kid), share[i] * kip) for i in own
        }
        notes += _sentences(scene, squeezing, f"kip = {kip:g} N/m")
        if any(scene.free(thing)[: scene.dimensions]) and thing.dynamics in DYNAMICS:
            M, kind = mass(thing, parts.objects[number].solid), DYNAMICS[thing.dynamics].integrator or thing.integrator
            moving = {}
            for i in own:
                device = Plant(*devices[i], scene.period, *arms[i], share[i] * ked, integrator=kind)
                device = replace(device, object_mass=M, object_damping=thing.viscosity, fingers=len(own))
                moving[i] = _growth(device, share[i] * kep)
            notes += _sentences(scene, moving, f"kep = {kep:g} N/m with the {1e3 * M:.3g} g of {thing.name}")
    return notes


def _sentences(scene: Scene, growth: dict[int, float], gain: str) -> Iterator[str]:
    finger = max(growth, key=lambda i: growth[i])
    if growth[finger] > SLOWEST:
        name = scene.finger_names[finger]
        yield (
            f"at a period of {1e3 * scene.period:g} ms {name} is unstable under {gain}: its oscillation grows "
            f"{np.exp(min(growth[finger] * scene.period, 99.0)):.3g}-fold each sample; lower the period or the gains, "
            "or raise the damping of device or hand"
        )


def _devices(parts: Parts) -> dict[int, Spring]:
    """Return the mass [kg] and friction [N s/m] of each finger's device, if the device states its mass."""
    devices: dict[int, Spring] = {}
    for wire in parts.wires:
        features = wire.features
        if features.mass is not None:
            devices |= {int(i): (features.mass, features.friction or 0.0) for i in wire.used}
    return devices


def _springs(scene: Scene) -> tuple[dict[int, Spring], dict[int, Spring]]:
    """Return arm and grip of each finger: smallest stiffness [N/m] and smallest damping [N s/m] along an axis.

    A hand with one finger has one spring, which is used for both.
    """
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


def _growth(device: Plant, gain: float) -> float:
    """Compute the growth rate [1/s] of the fastest growing motion of a sampled device with a gain [N/m]."""
    radius = device.limits().spectral_radius(gain)
    return math.log(radius) / device.period if math.isfinite(radius) else math.inf


def blend_notes(parts: Parts) -> list[str]:
    """Return a note on the deviation from eq. (4) for each grasp that starts within the band of `coupling.blend`."""
    scene = parts.scene
    if scene.coupling.blend == "off" or not any(map(scene.turns, scene.object)):
        return []
    return [note for part in grasps(parts) for note in _notes(part.name, part.grasped)]


def arms(grasped: GraspedObject) -> list[float]:
    """Compute the root-mean-square lever arms of the contacts about the principal axes of free rotations [m].

    The arms are the singular values of the contacts' velocities for unit rotations about the free axes, divided by the
    square root of the sum of the contacts' weights. The velocities are weighted by the square root of the weights, and
    their components along free translations are removed. Arms are in ascending order; arms of zero are omitted.
    """
    S = grasped.body_state
    points = grasped.array(FingerState.contact) @ S[body.ROTATION : body.ROTATION + 9].reshape(3, 3).T
    weights = grasped.array(FingerState.share)
    free = S[body.FREE : body.FREE + 6] != 0.0
    root = np.sqrt(weights)[:, None]
    fields = [root * np.cross(axis, points) for axis in np.eye(3)[free[3:]]]
    shifts = np.array([(root * axis).ravel() for axis in np.eye(3)[free[:3]]]).reshape(-1, 3 * len(points))
    shifts /= math.sqrt(weights.sum())
    turns = np.array([field.ravel() for field in fields]).reshape(-1, 3 * len(points))
    turns -= turns @ shifts.T @ shifts
    values = np.linalg.svd(turns, compute_uv=False) / math.sqrt(weights.sum())
    return sorted(float(arm) for arm in values if arm > NO_ARM)


def _notes(name: str, grasped: GraspedObject) -> Iterator[str]:
    state = grasped.state
    if state.equal or not state.freedom.turns:
        return
    low, high = state.arm_low, state.arm_high
    small = [arm for arm in arms(grasped) if arm < high]
    if not small:
        return
    blend = smoothstep(small[0], low, high)
    kep, kip = state.external_stiffness, state.internal_stiffness
    outer = grasped.law.external
    if isinstance(outer, ObjectImpedance):
        turning = float(np.linalg.eigvalsh(outer.stiffness[grasped.dimensions :, grasped.dimensions :]).max())
        own, most = (turning / (float(grasped.array(FingerState.share).sum()) * arm**2) for arm in (small[0], high))
        figure = (
            f"there the object is softer than object_stiffness: a fingertip feels at most {most:.3g} N/m "
            f"instead of up to {own:.3g} N/m"
        )
    elif grasped.matrices:
        figure = f"{100.0 * (1.0 - blend):.2g} % of its stiffness is internal"
    else:
        blended = kip + (kep - kip) * blend
        figure = (
            f"it has {blended:.4g} N/m where eq. (4) has kep = {kep:g} N/m ({100.0 * (blended / kep - 1.0):+.2g} %)"
        )
    yield (
        f"the contacts of {name} have an arm of {1e3 * small[0]:.3g} mm about an axis of rotation, in the band of "
        f"coupling.blend, {1e3 * low:g} to {1e3 * high:g} mm: {figure}; coupling.blend = 'off' applies eq. (4) exactly"
    )
