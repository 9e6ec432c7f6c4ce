"""Devices of the Haply Inverse service (Inverse3): one finger in space each, over a WebSocket.

Tested against an emulator only (`graspfx.testing.wire.InverseWire`); what the service says of a device's basis, mount,
damping and force gate is suspected. It answers each message once and never speaks by itself; all devices of a program
share one connection, and one message carries the forces of all.

Whether the service drops a force when its program dies is not known: `quench` reaches it afresh and sets zero.
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
MOST_SAMPLES = 1_000_000  # of a window
BASES = frozenset("".join(letters) for letters in itertools.permutations(IDENTITY))
QUIET = 2.0  # for the service to answer `quench` [s]


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
        url: of the service.
        device: its id, as the service's own tools tell it; None for the only one there is.
        basis: axes that the service has for it, such as "XYZ"; another one is refused.
        damping: that the service adds, counted as the device's own b; another one is refused [N s/m].
        force_limit: largest force at the handle; the service documents none [N].
        resolution: of a position [m].
        velocity_window: the longest window of the velocity estimate [samples].
        timeout: until an answer is given up and the last sample stands; less than the period [s].

    Raises:
        MissingPackageError: websockets is not installed, which `pip install graspfx[inverse]` brings.
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
    """Take the force from a device whose program has died: a connection of its own, and zero until it is answered.

    Args:
        url, device: as of `connect`; other settings do not matter.

    Raises:
        MissingPackageError: websockets is not installed.
        DeviceError: the service does not answer, so that the force may still be there.
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
    raise DeviceError(f"the service at {url} does not answer: switch {name} off, its force may be there")


def _check_name(device: object) -> None:
    if device is not None and (not isinstance(device, str) or not device or not device.isprintable()):
        raise InputError("device", device, "the id of a device of the service, such as '049D'")
