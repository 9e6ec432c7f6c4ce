"""The rig: two planar two-link arms on one controller, open hardware modelled on the paper's devices, one finger each.

It is a design that has not been built yet (docs/how-to/hardware.md). It is tested only against its own firmware on a
desktop computer: firmware/rig.c with firmware/host.c. If no torques arrive for 5 ms, the controller removes its force
within a further 20 ms. Arms, gears and encoders are those of `two-link`.
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

OWN = ("base", "elbow", "zero")  # settings that may differ between arms


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

    The other settings apply to each arm, as in `graspfx.devices.two_link.connect`.

    Args:
        port: Serial port of the controller, such as /dev/ttyACM0.
        arms: One or two tables, each with `base` [m], `elbow`, and optionally `zero`: directions of the links at zero
            counts [rad].
        timeout: Longest wait for an answer, after which the last sample is kept; less than the period, at most 2.5 ms
            [s].
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
    """Switch the motors off after a program has died, before the controller's own watchdog does.

    Args:
        port: Same as for `connect`; other settings are ignored.

    Raises:
        DeviceError: If another program has the port, or no controller answers.
    """
    controller = Controller(SerialPort(port), 0.0)
    try:
        controller.rest()
    finally:
        controller.close()
