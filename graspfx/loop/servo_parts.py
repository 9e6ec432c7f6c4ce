"""Parts that a servo runs: devices, objects, bodies, plants and observers, with the indices that connect the parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.coupling.grasped import GraspedObject
from graspfx.feedback.bridge import HostPart
from graspfx.loop.columns import Layout
from graspfx.loop.device import Device, SimulatedDevice
from graspfx.loop.device_mount import PLAIN, Fitting
from graspfx.loop.energy.observer import Observer
from graspfx.loop.plant import Hand, Plant, unaltered
from graspfx.loop.safety.chain import SafetyChain
from graspfx.objects.guest import Guest

Index = NDArray[np.intp]


@dataclass(frozen=True)
class GraspedPart:
    """An object, and the index of the finger of each contact on the object."""

    name: str
    grasped: GraspedObject
    fingers: Index


@dataclass(frozen=True)
class BodyGroup:
    """A body or a world of bodies, and the index of the object that each of these bodies moves."""

    body: Any
    objects: Sequence[int]


@dataclass(frozen=True)
class DeviceWiring:
    """A device, the index of the finger of each device channel (-1 for an unused channel), and the device's fitting."""

    device: Device
    fingers: Index
    fitting: Fitting = PLAIN


@dataclass(frozen=True)
class PlantWiring:
    """A plant, the hand that holds it, the devices that drive the plant, and the fingers that the plant moves."""

    plant: Plant
    hand: Hand
    devices: Sequence[SimulatedDevice]
    fingers: Index


@dataclass(frozen=True)
class Parts:
    """All parts of a servo."""

    period: float
    layout: Layout
    stations: Sequence[DeviceWiring]
    objects: Sequence[GraspedPart]
    movers: Sequence[BodyGroup]
    plants: Sequence[PlantWiring]
    observers: Sequence[Observer]
    every: int = 1  # ticks from one recorded row to the next
    safety: SafetyChain | None = None
    host: HostPart | None = None


def guest_of(body: object) -> Guest | None:
    """Return the body if its kernels and `exchange` can replace its `step`; otherwise None."""
    if isinstance(body, Guest) and unaltered(body, ("step",), ("exchange", "handing", "taking")):
        return body
    return None
