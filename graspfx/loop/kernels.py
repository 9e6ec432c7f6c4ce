"""Kernels of a scene's parts, identified by numbers.

The number 0 denotes no kernel. A number from 1 to `len(KERNELS)` - 1 denotes a kernel of this package, which is
compiled into the program that runs ticks. A larger number denotes a third-party kernel: in compiled ticks, the number
is the address of the kernel's machine code; in interpreted ticks, it is the number returned by `announce`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any

from graspfx.compile.kernel import source_function
from graspfx.compile.kernel_marks import bound_late

Kernel = Callable[..., Any]

PARTS = (  # kernels of devices and plants; argument: block
    "graspfx.devices.simulated.point_device.read",
    "graspfx.devices.simulated.point_device.write",
    "graspfx.devices.simulated.point_device.stop",
    "graspfx.devices.simulated.points.advance",
    "graspfx.devices.simulated.operated_points.advance",
    "graspfx.devices.two_link.arm_device.read",
    "graspfx.devices.two_link.arm_device.write",
    "graspfx.devices.two_link.arm_device.stop",
    "graspfx.devices.two_link.arm_dynamics.advance",
)
HANDS = (  # kernels of hands; arguments: block, time
    "graspfx.loop.motion.targets.target",
    "graspfx.loop.motion.targets.guided_target",
    "graspfx.loop.motion.targets.joined_target",
    "graspfx.loop.motion.targets.joined_guided_target",
)
BODIES = (  # kernels of bodies; arguments: block, second block, period
    "graspfx.objects.body.advance",
    "graspfx.objects.body.expect",
    "graspfx.objects.floor.floor.advance",
    "graspfx.objects.floor.floor.expect",
    "graspfx.objects.guest.hand_over",
    "graspfx.objects.guest.take_over",
)
KERNELS = ("", *PARTS, *HANDS, *BODIES)  # number 0 means no kernel

_ANNOUNCED: dict[int, Kernel] = {}  # third-party kernels, for interpreted ticks


def number_of(kernel: Kernel) -> int | None:
    """Return the number of a kernel of this package; None for a third-party kernel."""
    return _numbers().get(f"{kernel.__module__}.{kernel.__qualname__}")


@cache
def _numbers() -> dict[str, int]:
    return {name: k for k, name in enumerate(KERNELS) if k}


@cache
def _kernel(number: int) -> Kernel:
    """Import a kernel of this package and lower it to a function of buffers, offsets and numbers."""
    return source_function(kernel_of(number))


def kernel_of(number: int) -> Kernel:
    """Import the kernel of this package with this number."""
    module, _, name = KERNELS[number].rpartition(".")
    kernel: Kernel = getattr(import_module(module), name)
    return kernel


def announce(kernel: Kernel) -> int:
    """Register a third-party kernel for interpreted ticks, and return the number of the kernel."""
    number = len(KERNELS) + id(kernel)
    _ANNOUNCED[number] = kernel
    return number


def _function(number: int) -> Kernel:
    return _kernel(number) if number < len(KERNELS) else _ANNOUNCED[number]


@bound_late
def invoke(buffer: Any, kernel: int, place: int) -> int:
    """Call the kernel of a device or a plant, identified by its number; return its fault code."""
    result: int = _function(kernel)(buffer, place)
    return result


@bound_late
def invoke_at(buffer: Any, kernel: int, place: int, t: float) -> int:
    """Call the kernel of a hand at the time t; return 0."""
    _function(kernel)(buffer, place, t)
    return 0


@bound_late
def invoke_beside(buffer: Any, kernel: int, place: int, beside: int, T: float) -> int:
    """Call the kernel of a body with two blocks and the period T; return its fault code, 0 if it returns None."""
    return _function(kernel)(buffer, place, buffer, beside, T) or 0


@bound_late
def call(buffer: Any, address: int, place: int) -> int:
    """Call the machine code of a device's or plant's kernel by its address; unavailable in interpreted ticks."""
    raise NotImplementedError


@bound_late
def call_at(buffer: Any, address: int, place: int, t: float) -> int:
    """Call the machine code of a hand's kernel by its address; unavailable in interpreted ticks."""
    raise NotImplementedError


@bound_late
def call_beside(buffer: Any, address: int, place: int, beside: int, t: float) -> int:
    """Call the machine code of a body's kernel by its address; unavailable in interpreted ticks."""
    raise NotImplementedError
