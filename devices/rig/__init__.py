"""The rig: two planar two-link arms on one controller, open hardware after the paper's, a finger each.

A proposal that nobody has built yet (docs/how-to/hardware.md); tested against its own firmware on a desktop computer
only, firmware/rig.c behind firmware/host.c. The controller drops its force by itself 5 ms after the last torques,
within 20 ms more. Arms, gears and encoders are those of `two-link`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from graspfx.devices._settings import number, port_name
from graspfx.devices.rig.controller import Controller
from graspfx.devices.rig.rig_device import LONGEST, Half, Rig
from graspfx.devices.two_link import TwoLink
from graspfx.devices.two_link import connect as two_link
from graspfx.protocols import SMALLEST, InputError, SerialPort

__all__ = ["Rig", "connect", "quench"]

OWN = ("base", "elbow", "zero")  # settings that an arm may have for itself


def connect(
    *,
    port: str,
    arms: Sequence[Mapping[str, Any]] = (
        {"base": (-0.04, -0.18), "elbow": "left"},
        {"base": (0.04, -0.18), "elbow": "right"},
    ),
    links: Sequence[float] = (0.128, 0.128),
    link_masses: Sequence[float] | None = None,
    link_inertias: Sequence[float] | None = None,
    link_centres: Sequence[float] | None = None,
    rotor_inertias: Sequence[float] | None = None,
    joint_damping: float | Sequence[float] | None = None,
    counts: float | Sequence[float] = 4000,
    gear: float | Sequence[float] = 15.0,
    torque_limit: float | Sequence[float] = 0.06,
    margin: float = 0.01,
    velocity_window: int = 16,
    timeout: float = 0.0005,
) -> Rig:
    """Connect the rig: channel 0 is the first arm, channel 1 the second.

    Settings that are not here are explained by `graspfx.devices.two_link.connect`, which takes them for each arm.

    Args:
        port: the controller's serial port, such as /dev/ttyACM0.
        arms: one or two tables, each with `base` [m], `elbow`, and `zero` if the directions of its links are not zero
            where the counts are [rad].
        timeout: until an answer is given up and the last sample stands; less than the period, 2.5 ms at most [s].
    """
    tables = _tables(arms)
    settings = {
        "links": links,
        "link_masses": link_masses,
        "link_inertias": link_inertias,
        "link_centres": link_centres,
        "rotor_inertias": rotor_inertias,
        "joint_damping": joint_damping,
        "counts": counts,
        "gear": gear,
        "torque_limit": torque_limit,
        "margin": margin,
        "velocity_window": velocity_window,
    }
    halves = [Half() for _ in tables]
    pair = []
    for arm, half in zip(tables, halves, strict=True):
        device = two_link(**settings, **arm, board=half)
        assert isinstance(device, TwoLink)
        pair.append(device)
    return Rig(Controller(SerialPort(port_name(port)), number("timeout", timeout, SMALLEST, LONGEST)), pair, halves)


def _tables(value: object) -> list[Mapping[str, Any]]:
    if isinstance(value, str | Mapping) or not isinstance(value, Sequence) or not 1 <= len(value) <= 2:
        raise InputError("arms", value, "one or two tables with base and elbow")
    for i, arm in enumerate(value):
        if not isinstance(arm, Mapping) or not set(arm) <= set(OWN):
            raise InputError(f"arms.{i}", arm, f"a table with {', '.join(OWN)}")
    return list(value)


def quench(*, port: str, **_: object) -> None:
    """Switch the motors off after a program has died, ahead of the controller's own watchdog.

    Args:
        port: as of `connect`; other settings do not matter.

    Raises:
        DeviceError: another program has the port, or nothing answers there.
    """
    controller = Controller(SerialPort(port), 0.0)
    try:
        controller.rest()
    finally:
        controller.close()
