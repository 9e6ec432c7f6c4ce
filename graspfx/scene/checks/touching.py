"""Faults of friction, soft fingers, and of what asks for the masses of devices."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from graspfx.loop.device import Device
from graspfx.scene.tables.parts import SceneTable

Location = tuple[str | int, ...]
Found = tuple[Location, str]


def own_coefficient(scene: SceneTable, at: Location, finger: Any) -> Iterator[Found]:
    """A coefficient that a finger has beside a coupling which leaves no room for it."""
    if finger.friction is None:
        return
    if scene.coupling.contact == "attached":
        yield at, "attached contacts do not slip: leave it out"
    elif scene.coupling.friction == "stick":
        yield at, "coupling.friction = 'stick' holds every finger; a coefficient there lets each have its own"


def soft_faults(scene: SceneTable, i: int, finger: Any) -> Iterator[Found]:
    """What a soft finger lacks, or a hard one has of it."""
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


def control_faults(scene: SceneTable, connected: Mapping[Location, Device]) -> Iterator[Found]:
    """Devices that do not tell the mass that limits the damping which control adds."""
    if scene.coupling.passivity != "control":
        return
    for at, device in connected.items():
        if device.features.mass is None:
            where = ".".join(map(str, at))
            text = f"'control' expects every device to tell its mass, which limits damping; that of {where} does not"
            yield ("coupling", "passivity"), f"{text} ('observe' needs none)"


def metric_faults(scene: SceneTable, connected: Mapping[Location, Device]) -> Iterator[Found]:
    """Devices that do not tell the mass by which the metric would count them."""
    if scene.coupling.metric != "mass":
        return
    for at, device in connected.items():
        if device.features.mass is None:
            where = ".".join(map(str, at))
            yield ("coupling", "metric"), f"'mass' expects every device to tell its mass; that of {where} does not"
