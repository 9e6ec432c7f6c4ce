"""API for drivers, hands and bodies: protocols, kernels and records, numeric checks, and errors.

A driver is a module with `connect(**settings) -> Device`, a hand is a module with `hold(**settings) -> Hand`, and
dynamics are a module with `create(state) -> Body`. For certificates, a dynamics module also states its integrator, such
as `INTEGRATOR = "semi-implicit"`. Each of the objects returned must implement `Device`, `Hand` or `Body`. The other
protocols are optional: they are for simulated devices, for force limits that change, and for blocks and kernels that
become part of the compiled tick.
"""

from __future__ import annotations

from graspfx import elementary
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
    Calls,
    CallsDevice,
    Device,
    DevicePorts,
    DrivingDevice,
    Features,
    FusedDevice,
    LimitedDevice,
    QuenchableDriver,
    RawDevice,
    SimulatedDevice,
    SwitchedDevice,
    former_settings,
)
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
from graspfx.screen.touch_screen import TouchScreen, approach
from graspfx.serial_port import SerialPort
from graspfx.system.file_lock import ProgramLock

__all__ = [  # noqa: RUF022 (in reading order: common names first, then by kind)
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
    # devices with an explicit request for a reading; drivers that zero the force after their program has died
    "AskedDevice",
    "QuenchableDriver",
    # devices with switches; devices that expose raw readings
    "SwitchedDevice",
    "RawDevice",
    # C functions of a device, for loops without Python
    "Calls",
    "CallsDevice",
    "DrivingDevice",
    "adapt",
    "Mailbox",
    # serial port, and a lock for other hardware; both for one program at a time
    "SerialPort",
    "ProgramLock",
    # devices that are simulated, have a varying limit, or are part of the compiled tick; renamed settings
    "SimulatedDevice",
    "LimitedDevice",
    "FusedDevice",
    "DevicePorts",
    "former_settings",
    # plants and hands in the compiled tick
    "FusedPlant",
    "Ports",
    "Kernel",
    "FusedHand",
    "HandPorts",
    "HandKernel",
    "is_still",
    # spring hand, and its motions
    "SpringHand",
    "Motion",
    "Rest",
    "Sine",
    "Reach",
    "Path",
    "Levels",
    "Sum",
    "Turn",
    # operator model other than a spring
    "Operator",
    "FingerOperator",
    # bodies: moved by GraspFX's integrators, or by other software
    "BlockBody",
    "NativeBody",
    "BodyState",
    "fill_body",
    "Guest",
    # smooth motion from stepwise input, and the page of a touch screen
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
    # numeric checks
    "finite",
    "number",
    "LARGEST",
    "SMALLEST",
    "elementary",
    "expm1",
    "zeros",
]


def __dir__() -> list[str]:
    return sorted(__all__)
