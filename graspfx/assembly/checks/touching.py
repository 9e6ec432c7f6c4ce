"""Faults of friction, soft fingers, pads, and of what asks for the masses of devices."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from graspfx.loop.device import Device
from graspfx.scene.tables.part_tables import ObjectImpedance
from graspfx.scene.tables.scene_table import SceneTable

Location = tuple[str | int, ...]
Finding = tuple[Location, str]


def own_coefficient(scene: SceneTable, at: Location, finger: Any) -> Iterator[Finding]:
    """Find a coefficient of a finger's own beside a coupling which leaves no room for it."""
    if finger.friction is None:
        return
    if scene.coupling.contact == "attached":
        yield at, "attached contacts do not slip: leave it out"
    elif scene.coupling.friction == "stick":
        yield at, "coupling.friction = 'stick' holds every finger; a coefficient there lets each have its own"


def soft_faults(scene: SceneTable, i: int, finger: Any) -> Iterator[Finding]:
    """Find what a soft finger lacks, or what a hard one has of it."""
    at: Location = ("finger", i, "patch")
    if finger.model == "hard":
        if finger.patch is not None:
            yield at, "only a soft finger has one (model = 'soft')"
        return
    if scene.dimensions != 3:
        yield (
            ("finger", i, "model"),
            f"a soft finger in {scene.dimensions} dimension(s) is a hard one: torsion is in space",
        )
        return
    if finger.patch is None:
        yield at, "required for a soft finger: the length that torsion is measured with, the radius of its patch [m]"
    coupling = scene.coupling
    gains = [
        np.ndim(gain) for part in (coupling.external, coupling.internal) for gain in (part.stiffness, part.damping)
    ]
    if any(gains):
        yield ("finger", i, "model"), "soft fingers expect each gain as one number"
    if coupling.contact == "attached":
        if scene.object[scene.finger_objects[i]].shape is None:
            yield ("finger", i, "model"), "a soft finger expects an object with a shape: torsion is about its normal"
    elif coupling.friction != "stick" and scene.coefficients[i] == 0.0:
        yield ("finger", i, "model"), "a soft finger without friction has no torsion: give coupling.friction or its own"


def pad_faults(scene: SceneTable, i: int, finger: Any) -> Iterator[Finding]:
    """Find a compliant fingertip where a pad cannot be in series with the coupling."""
    if finger.pad is None:
        return
    at: Location = ("finger", i, "pad")
    coupling, thing = scene.coupling, scene.object[scene.finger_objects[i]]
    if coupling.contact == "attached":
        yield at, "expected unilateral contact: a pad only pushes, attached contacts pull too"
    implicit = thing.dynamics == "native" and thing.integrator == "implicit"
    if implicit and any(np.any(part.damping) for part in (coupling.external, coupling.internal)):
        text = "expected no damping beside the integrator 'implicit', which solves it with the motion"
        yield at, f"{text}: a pad's depth follows the elastic force; take another integrator, or no damping"


def contact_axes_faults(scene: SceneTable, share: str) -> Iterator[Finding]:
    """Find matrices that are none in contact axes: k_n along the normal, one k_t along the surface."""
    coupling, d = scene.coupling, scene.dimensions
    if isinstance(getattr(coupling, share), ObjectImpedance):
        if coupling.axes != "object":
            yield ("coupling", "axes"), "expected 'object': a stiffness of the object stands in its own axes"
        return
    if coupling.axes != "contact":
        return
    for quantity in ("stiffness", "damping"):
        at: Location = ("coupling", share, quantity)
        gain = np.asarray(getattr(getattr(coupling, share), quantity), dtype=float)
        if gain.ndim < 2:
            continue
        if gain.shape[-1] != d:
            yield at, "an m x m matrix has no contact axes: give one d x d matrix, or one per finger"
            continue
        even = gain * np.eye(d)
        if np.array_equal(even, gain) and (gain[..., d - 1, d - 1] == gain[..., 1 % d, 1 % d]).all():
            continue
        form = {1: "[[k_n]]", 2: "[[k_n, 0], [0, k_t]]", 3: "[[k_n, 0, 0], [0, k_t, 0], [0, 0, k_t]]"}[d]
        yield at, f"contact axes expect {form}, the normal first: along the surface no direction is another's better"
    if share == "external" and coupling.contact == "attached" and any(thing.shape is None for thing in scene.object):
        yield ("coupling", "axes"), "'contact' expects objects with a shape, which have normals"


def control_faults(scene: SceneTable, connected: Mapping[Location, Device]) -> Iterator[Finding]:
    """Find devices that do not tell the mass that limits the damping which control adds."""
    if scene.coupling.passivity != "control":
        return
    for at, device in connected.items():
        if device.features.mass is None:
            where = ".".join(map(str, at))
            text = f"'control' expects every device to tell its mass, which limits damping; that of {where} does not"
            yield ("coupling", "passivity"), f"{text} ('observe' needs none)"


def metric_faults(scene: SceneTable, connected: Mapping[Location, Device]) -> Iterator[Finding]:
    """Find devices that do not tell the mass by which the metric would count them."""
    coupling = scene.coupling
    if coupling.metric == "mass" and coupling.split != "mass":
        yield ("coupling", "metric"), "coupling.split says how fingers count: leave the metric out"
    weights, n = coupling.weights, len(scene.finger)
    if (weights is not None) != (coupling.split == "weights"):
        wanted = "a number above zero for each finger" if weights is None else "no weights without split = 'weights'"
        yield ("coupling", "weights"), f"expected {wanted}"
    elif weights is not None and (len(weights) != n or not all(weight > 0.0 for weight in weights)):
        yield ("coupling", "weights"), f"expected {n} numbers above zero, one per finger; given {list(weights)}"
    if coupling.split != "mass":
        return
    key = "metric" if coupling.metric == "mass" else "split"
    for at, device in connected.items():
        if device.features.mass is None:
            where = ".".join(map(str, at))
            yield ("coupling", key), f"'mass' expects every device to tell its mass; that of {where} does not"
