"""A scene resolved once: its devices connected, its shapes loaded, its laws and hands made, for all that asks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly import encounters
from graspfx.assembly.force_limits import force_limits
from graspfx.assembly.hand_parts import HandPart, make_hand
from graspfx.assembly.holdings import holdings
from graspfx.assembly.meshes import mesh_name
from graspfx.assembly.object_parts import ObjectPart, make_objects
from graspfx.assembly.placement import start_of
from graspfx.assembly.safety_limits import safety_limits
from graspfx.assembly.stock import Stock
from graspfx.assembly.wiring import Finding, Wire, placing_faults, wires, wires_anew
from graspfx.compile.memory import ROOM, Memory, within
from graspfx.loop.device import is_hardware
from graspfx.loop.device_exchange import device_name
from graspfx.loop.parts import DeviceWiring
from graspfx.loop.safety.chain import SafetyLimits
from graspfx.objects.surroundings import Obstacle

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Parts:
    """A scene's parts, each made when it is first asked for, and only then.

    Attributes:
        scene: the description.
        stock: its connected devices and its shapes.
    """

    scene: Scene
    stock: Stock

    @property
    def folder(self) -> Path | None:
        """The folder in which relative paths of the scene start; None for the current one."""
        return self.stock.folder

    @cached_property
    def wires(self) -> tuple[Wire, ...]:
        """The devices, to be looked at: a run takes those of `own_wires`."""
        return wires(self.scene, self.stock)

    def claim(self, room: int = ROOM) -> tuple[tuple[Wire, ...], Memory]:
        """Give devices as `own_wires` does, with the memory in which all that goes with them is to stand.

        Args:
            room: entries of that memory; of devices that the checks connected it is that of any scene.
        """
        if self.stock.claim():
            return self.wires, self.stock.memory
        with within(Memory(room)) as memory:
            return wires_anew(self.scene, self.folder), memory

    def own_wires(self) -> tuple[Wire, ...]:
        """Give devices to open, or to move by a plant, that nobody else has.

        The first caller has those that the checks connected; a later one has devices connected anew, as a device
        belongs to one run: it carries that run's state, and hardware may still be open.
        """
        return self.claim()[0]

    @cached_property
    def start(self) -> FloatArray:
        """Where the fingers start, (n, d) [m]."""
        return np.array([start_of(self.scene, i, self.stock) for i in range(len(self.scene.finger))], dtype=float)

    @cached_property
    def objects(self) -> tuple[ObjectPart, ...]:
        """The objects with their solids, laws and rules, in the scene's order."""
        return make_objects(self.scene, self.stock, self.wires)

    @cached_property
    def hands(self) -> tuple[HandPart, ...]:
        """The hands in the order of their first fingers."""
        return tuple(make_hand(self.scene, self.stock, each) for each in holdings(self.scene))

    @cached_property
    def obstacles(self) -> list[Obstacle]:
        """The obstacles in their places."""
        return encounters.obstacles(self.scene, self.stock)

    @cached_property
    def limits(self) -> FloatArray | None:
        """The largest force of each finger [N], its device's or its safety's, infinite without; None if all are."""
        limits = force_limits(len(self.scene.finger), self.wires)
        if self.safety is None:
            return limits
        return self.safety.force if limits is None else np.minimum(limits, self.safety.force)

    @cached_property
    def safety(self) -> SafetyLimits | None:
        """The limits of the safety chain; None for a scene without one."""
        return safety_limits(self.scene, self.wires)

    @cached_property
    def simulated(self) -> bool:
        """Whether every device is a simulation."""
        return not self.hardware

    @property
    def hardware(self) -> list[str]:
        """The devices that are no simulations, by name."""
        names = self.scene.finger_names
        return [
            device_name(DeviceWiring(wire.device, wire.fingers), names)
            for wire in self.wires
            if is_hardware(wire.device)
        ]

    @property
    def mesh_notes(self) -> list[str]:
        """The repairs of the meshes, and what looks wrong in them, a sentence each."""
        meshes = [(part.table, part.solid.mesh) for part in self.objects]
        return [f"{mesh_name(table)}: {note}" for table, mesh in meshes if mesh is not None for note in mesh.mesh.notes]

    @property
    def mesh_frames(self) -> dict[str, Mapping[str, list[float]]]:
        """The `SceneMesh.frame` of each object that has a mesh, by its name."""
        meshes = [(part.name, part.solid.mesh) for part in self.objects]
        return {name: mesh.frame for name, mesh in meshes if mesh is not None}


def reach_faults(scene: Scene) -> list[Finding]:
    """Find the fingers of a scene without other faults that cannot be put where they start."""
    parts = resolve(scene)
    return placing_faults(parts.start, parts.own_wires())


def resolve(scene: Scene) -> Parts:
    """Give the parts of a scene: the same ones each time, for as long as there is the scene.

    What the scene's checks have connected and loaded is not asked for again. A copy of a scene, or one with values
    replaced, has parts of its own.
    """
    if scene._stock is None:
        scene._stock = Stock(scene.source.folder)
    stock: Stock = scene._stock
    if stock.parts is None:
        stock.parts = Parts(scene, stock)
    parts: Parts = stock.parts
    return parts
