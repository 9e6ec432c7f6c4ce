"""All that a driver, a hand or a body of another's imports: protocols, kernels and records, numbers, and errors.

A driver is a module with `connect(**settings) -> Device`, a hand one with `hold(**settings) -> Hand`, dynamics one with
`create(state) -> Body`, whose module tells certificates its step: `INTEGRATOR = "semi-implicit"` or another. Each is
whole with the first protocol of its kind; the others are for devices that are simulated, tell a limit that changes, or
show their blocks and kernels, so that they become part of the compiled tick.
"""

from __future__ import annotations

from graspfx.compile.kernel import inline, kernel
from graspfx.compile.memory import zeros
from graspfx.compile.records import (
    Floats,
    Many,
    Record,
    Table,
    floats,
    layout,
    many,
    size_for,
    size_of,
    start_of,
    table,
)
from graspfx.errors import DeviceError, GraspFXError, InputError, MissingPackageError
from graspfx.exponential import expm1
from graspfx.loop.adapt import adapt
from graspfx.loop.device import (
    AskedDevice,
    Device,
    DevicePorts,
    Features,
    FusedDevice,
    LimitedDevice,
    QuenchableDriver,
    RawDevice,
    SimulatedDevice,
    SwitchedDevice,
    former_settings,
)
from graspfx.loop.device_calls import Calls, CallsDevice, DrivingDevice
from graspfx.loop.follower import Follower
from graspfx.loop.hand import Hand as SpringHand
from graspfx.loop.mailbox import Mailbox
from graspfx.loop.motion import Levels, Motion, Path, Reach, Rest, Sine, Sum, Turn
from graspfx.loop.operator import FingerOperator, Operator
from graspfx.loop.plant import FusedHand, FusedPlant, Hand, HandKernel, HandPorts, Kernel, Plant, Ports, is_still
from graspfx.loop.velocity import WINDOW, VelocityEstimate, VelocityEstimator, estimate, estimate_size
from graspfx.numeric import LARGEST, SMALLEST, finite, number
from graspfx.objects.body import BlockBody, Body, NativeBody, fill_body
from graspfx.objects.body_state import BodyState
from graspfx.objects.guest import Guest
from graspfx.program_lock import ProgramLock
from graspfx.screen.approach import approach
from graspfx.screen.touch_screen import TouchScreen
from graspfx.serial_port import SerialPort

__all__ = [  # noqa: RUF022 (as a reader meets them: what everybody needs, then by kind)
    "Device",
    "Features",
    "Hand",
    "Plant",
    "Body",
    "VelocityEstimator",
    "DeviceError",
    "InputError",
    "MissingPackageError",
    "GraspFXError",
    # devices that are asked for an answer, and drivers that take the force from hardware whose program has died
    "AskedDevice",
    "QuenchableDriver",
    # devices with switches, and devices that show what came over the wire
    "SwitchedDevice",
    "RawDevice",
    # C functions of a device, for loops in which no Python runs
    "Calls",
    "CallsDevice",
    "DrivingDevice",
    "adapt",
    "Mailbox",
    # a board's serial port, and a lock of other hardware, for one program at a time
    "SerialPort",
    "ProgramLock",
    # devices: simulated, with a limit that changes, part of the compiled tick; settings under former names
    "SimulatedDevice",
    "LimitedDevice",
    "FusedDevice",
    "DevicePorts",
    "former_settings",
    # plants and hands that are part of the compiled tick
    "FusedPlant",
    "Ports",
    "Kernel",
    "FusedHand",
    "HandPorts",
    "HandKernel",
    "is_still",
    # a hand of springs, and what moves it
    "SpringHand",
    "Motion",
    "Rest",
    "Sine",
    "Reach",
    "Path",
    "Levels",
    "Sum",
    "Turn",
    # an operator who is no spring
    "Operator",
    "FingerOperator",
    # bodies: a block that GraspFX's own integrators move, or other software does
    "BlockBody",
    "NativeBody",
    "BodyState",
    "fill_body",
    "Guest",
    # motion behind an input that comes in steps, and a touch screen's page
    "Follower",
    "approach",
    "TouchScreen",
    # velocity from positions
    "VelocityEstimate",
    "estimate",
    "estimate_size",
    "WINDOW",
    # kernels and records
    "kernel",
    "inline",
    "Record",
    "Floats",
    "Many",
    "Table",
    "floats",
    "many",
    "table",
    "layout",
    "size_of",
    "size_for",
    "start_of",
    # numbers
    "finite",
    "number",
    "LARGEST",
    "SMALLEST",
    "expm1",
    "zeros",
]


def __dir__() -> list[str]:
    return sorted(__all__)
