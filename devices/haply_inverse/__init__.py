"""Devices of the Haply Inverse service (Inverse3): one finger in space each, over a WebSocket.

The driver was tested only against an emulator (`graspfx.testing.wire.InverseWire`); the service's messages about a
device's basis, mount, damping and force gate are assumptions. The service answers each message once and sends nothing
else. All devices of a program share one connection, and one message contains the forces of all.

It is unknown whether the service removes a force when the program dies; `quench` connects again and sets zero force.
"""

from __future__ import annotations

import itertools

from graspfx.devices._settings import number, whole
from graspfx.devices.haply_inverse.inverse_device import Inverse, lock_of
from graspfx.devices.haply_inverse.inverse_messages import IDENTITY
from graspfx.devices.haply_inverse.service import Service, service_at
from graspfx.protocols import SMALLEST, WINDOW, DeviceError, InputError

__all__ = ["Inverse", "connect", "quench"]

URL = "ws://localhost:10001"
MOST_FORCE = 20.0  # [N]
MOST_SAMPLES = 1_000_000  # largest window [samples]
BASES = frozenset("".join(letters) for letters in itertools.permutations(IDENTITY))
QUIET = 2.0  # time for the service to answer `quench` [s]


def connect(
    *,
    url: str = URL,
    device: str | None = None,
    basis: str = IDENTITY,
    damping: float = 0.0,
    force_limit: float = 3.0,
    resolution: float = 1e-5,
    velocity_window: int = WINDOW,
    timeout: float = 0.002,
) -> Inverse:
    """Connect a device.

    Args:
        url: Address of the service.
        device: Id of the device, as shown by the service's tools; None for the only device.
        basis: Axes of the device, as the service must report them, such as "XYZ".
        damping: Damping that the service must add, treated as the device's b [N s/m].
        force_limit: Largest force at the handle; the service documents no limit [N].
        resolution: Resolution of a position [m].
        velocity_window: Longest window of the velocity estimate [samples].
        timeout: Longest wait for an answer, after which the last sample is kept; less than the period [s].

    Raises:
        MissingPackageError: If websockets is not installed; `pip install graspfx[inverse]` installs it.
    """
    service = service_at(url)
    _check_name(device)
    if basis not in BASES:
        raise InputError("basis", basis, f"one of {', '.join(sorted(BASES))}")
    return Inverse(
        service,
        device=device,
        basis=basis,
        damping=number("damping", damping, 0.0),
        force_limit=number("force_limit", force_limit, SMALLEST, MOST_FORCE),
        resolution=number("resolution", resolution, SMALLEST),
        velocity_window=whole("velocity_window", velocity_window, 1, MOST_SAMPLES),
        timeout=number("timeout", timeout, SMALLEST, 1.0),
    )


def quench(*, url: str = URL, device: str | None = None, **_: object) -> None:
    """Remove the force from a device whose program has died: connect again, and send zero until the service answers.

    Args:
        url, device: Same as for `connect`; other settings are ignored.

    Raises:
        MissingPackageError: If websockets is not installed.
        DeviceError: If the service does not answer, so that the force may persist.
    """
    service = Service(url)
    name = service.join(device)
    lock = lock_of(service, name)
    try:
        lock.take()
        deadline = service.now() + QUIET
        while service.now() < deadline:
            service.stop(name)
            service.ask(name)
            if service.sample(name, service.now() + 0.05) is not None:
                return
    finally:
        service.leave(name)
        lock.release()
    raise DeviceError(f"the service at {url} does not answer: switch {name} off, because its force may persist")


def _check_name(device: object) -> None:
    if device is not None and (not isinstance(device, str) or not device or not device.isprintable()):
        raise InputError("device", device, "the id of a device of the service, such as '049D'")
