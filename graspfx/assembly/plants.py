"""The plants of a scene's simulated devices, with the hands that hold them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.live import GUIDE
from graspfx.assembly.numbers import general
from graspfx.assembly.wiring import Wire, placing_faults
from graspfx.errors import DeviceError
from graspfx.loop.device import OperatedDevice, SimulatedDevice
from graspfx.loop.hand import join
from graspfx.loop.parts import PlantWiring
from graspfx.loop.update import SteerablePlant

if TYPE_CHECKING:
    from graspfx.assembly.hand_parts import HandPart
    from graspfx.assembly.resolve import Parts

FloatArray = NDArray[np.float64]


def make_plants(
    parts: Parts, wired: Sequence[Wire], inward: FloatArray, live: Collection[str] = ()
) -> Iterator[PlantWiring]:
    """Make the plants of the simulated devices: one for all devices that hands join to one another.

    Args:
        parts: of the scene.
        wired: its devices.
        inward: unit normals of the fingers' contacts (n, d).
        live: keys that may change in mid-run: a squeeze among them has a course in time also where it is zero.

    Raises:
        SceneError: a finger that starts out of its device's reach.
        DeviceError: a plant that does not take its fingers together.
    """
    scene, start = parts.scene, parts.start
    others = [key for key in live if general(key) not in GUIDE]  # goals of guided hands change no plant
    squeezes = any(key.endswith(".squeeze") for key in others)
    changes = any(key.startswith(("hand.", "device.")) or ".hand." in key or ".device." in key for key in others)
    for members in _components(wired, parts.hands):
        simulated = [wired[i] for i in members]
        fingers = np.concatenate([wire.fingers for wire in simulated])
        devices = [wire.device for wire in simulated]
        hands, order = [], []
        for hand in parts.hands:
            if hand.fingers[0] in fingers:
                hands.append((hand.with_course() if squeezes else hand).hold(start, inward))
                order += hand.fingers
        first = devices[0]
        assert isinstance(first, SimulatedDevice)
        joined = join(hands, [order.index(f) for f in fingers])
        operator = getattr(joined, "operator", None)
        if operator is None:
            plant = type(first).plant(devices)
        else:
            assert isinstance(first, OperatedDevice)
            plant = type(first).operated_plant(devices, operator, scene.period)
        if changes and isinstance(plant, SteerablePlant):
            plant.live = True
        try:
            plant.place(start[fingers])
        except DeviceError as error:
            if faults := placing_faults(start, wired):
                raise scene.error(faults) from error
            raise DeviceError(f"{', '.join(scene.finger_names[f] for f in fingers)}: {error}") from error
        yield PlantWiring(plant, joined, [d for d in devices if isinstance(d, SimulatedDevice)], fingers)


def _components(wired: Sequence[Wire], hands: Sequence[HandPart]) -> Iterator[list[int]]:
    """Find the sets of simulated devices that share a hand, directly or through others."""
    of_finger = {int(f): i for i, wire in enumerate(wired) for f in wire.used}
    left = {i for i, wire in enumerate(wired) if isinstance(wire.device, SimulatedDevice)}
    while left:
        members = [min(left)]
        for member in members:  # grows while it is walked
            left.discard(member)
            for hand in hands:
                near = {of_finger[f] for f in hand.fingers}
                if member in near:
                    members += sorted((near & left) - set(members))
        yield members
