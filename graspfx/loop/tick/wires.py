"""The parts of a scene as its tick sees them: pieces of their memories, and their kernels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.records import Floats
from graspfx.coupling.grasp_state import GraspState
from graspfx.loop.energy.books import LedgerState
from graspfx.loop.safety.safety_state import Pace, SafetyState
from graspfx.loop.tick.memory import ServoState
from graspfx.objects.body_state import BodyState
from graspfx.objects.guest import GuestState

FloatArray = NDArray[np.float64]
Kernel = Callable[..., Any]


@dataclass(eq=False, repr=False)
class FingerWires:
    """One finger; each array is a piece of a longer memory."""

    position: FloatArray  # as its device read it, in the object's block, (d,) [m]
    velocity: FloatArray  # (d,) [m/s]
    force: FloatArray  # on the object, (d,) [N]
    limit: FloatArray | None  # the largest force that its device displays where it is, (1,) [N]
    displayed: FloatArray  # force on the operator, (d,) [N]
    tip: FloatArray  # where the fingertip truly is, or where it was read if that is not known, (d,) [m]
    before: FloatArray  # where it was one sample ago, (d,) [m]
    energy: FloatArray  # work that the device did on it so far, (1,) [J]


@dataclass(eq=False, repr=False)
class Channel:
    """One channel of a device: where it shows what it reads of a finger, and takes the force to display."""

    finger: FingerWires
    position: FloatArray  # (d,) [m]
    velocity: FloatArray  # (d,) [m/s]
    limit: FloatArray | None  # (1,) [N], where the finger takes it
    command: FloatArray  # (d,) [N]


@dataclass(eq=False, repr=False)
class DeviceWires:
    """A simulated device, which kernels read and write."""

    index: int
    state: FloatArray
    sensed: FloatArray  # what its sensors see, in its block
    plant: FloatArray  # the block of what it is read from
    sensed_entries: Sequence[int]  # the entries of it that the sensors see
    channels: Sequence[Channel]
    reading: Kernel
    writing: Kernel
    stopping: Kernel


@dataclass(eq=False, repr=False)
class PortWires:
    """The memory of a device that is read and written between two calls."""

    index: int
    readable: FloatArray  # 1 if it could be read, (1,)
    channels: Sequence[Channel]


@dataclass(eq=False, repr=False)
class LedgerWires:
    """The energies of an object's grasp; on planes also what these did to the body."""

    state: LedgerState
    met: FloatArray | None  # where the ledger takes it, (6,) [N, N m]
    contact_wrench: FloatArray | None  # where the planes' memory has it, (6,) [N, N m]


@dataclass(eq=False, repr=False)
class SafetyWires:
    """The safety chain of an object."""

    state: SafetyState
    pace: Pace
    steered: bool  # a gain may change in mid-run


@dataclass(eq=False, repr=False)
class GraspWires:
    """An object and its coupling."""

    index: int
    state: GraspState
    limited: bool
    stuck: FloatArray  # 1 if its body cannot go on, (1,)
    ledger: LedgerWires | None
    safety: SafetyWires | None


@dataclass(eq=False, repr=False)
class BodyWires:
    """A body that kernels move."""

    index: int
    stuck: FloatArray  # 1 if it cannot go on, (1,)
    state: BodyState
    floor: Floats  # memory of what it stands on, or the object's block again
    predicting: Kernel | None  # under the implicit integrator
    stepping: Kernel


@dataclass(eq=False, repr=False)
class GuestPart:
    """One object of a guest, and its part of the guest's buffer."""

    body: BodyState
    guest: GuestState


@dataclass(eq=False, repr=False)
class GuestWires:
    """A body, or a world of bodies, that other software moves between two calls."""

    index: int
    stuck: FloatArray  # 1 if it cannot go on, (1,)
    parts: Sequence[GuestPart]
    handing: Kernel
    taking: Kernel


@dataclass(eq=False, repr=False)
class Target:
    """A hand's intended positions r and their velocities r', flat."""

    position: FloatArray  # (n d,) [m]
    velocity: FloatArray  # (n d,) [m/s]


@dataclass(eq=False, repr=False)
class HandWires:
    """A hand whose kernel works out its targets."""

    state: FloatArray
    kernel: Kernel
    target: Target


@dataclass(eq=False, repr=False)
class TableWires:
    """The targets of a hand that is plain Python, asked beforehand for many ticks."""

    memory: FloatArray
    start: FloatArray  # the tick that it begins with, (1,)
    width: int  # of a tick: r and r' at the end of its sample, then in its middle if asked for


@dataclass(eq=False, repr=False)
class PlantWires:
    """A plant that a kernel moves."""

    index: int
    stuck: FloatArray  # 1 if it cannot go on, (1,)
    state: FloatArray
    kernel: Kernel
    efforts: Sequence[tuple[FloatArray, FloatArray]]  # where it takes each device's, and where that has them
    hand: HandWires | TableWires | None  # None for one that keeps still: its targets stand in the plant's block
    middle: Target | None  # where it takes them for the middle of the sample, if it asks for that
    end: Target


@dataclass(eq=False, repr=False)
class Wiring:
    """A scene."""

    servo: ServoState
    faulted: FloatArray  # 1 after a fault, (1,)
    period: FloatArray  # T, (1,) [s]
    dimensions: int
    pace: Pace | None  # of the safety chain, where there is one
    fingers: Sequence[FingerWires]
    devices: Sequence[DeviceWires | PortWires]
    grasps: Sequence[GraspWires]
    bodies: Sequence[BodyWires | GuestWires]
    plants: Sequence[PlantWires]
    width: int  # of a recorded row
    every: int  # ticks from one recorded row to the next
    columns: Sequence[tuple[int, FloatArray, int]] | None  # each with the entry that it shows; None without recording
