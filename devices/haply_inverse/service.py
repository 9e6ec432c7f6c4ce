"""Client of the Haply Inverse service: all devices of a program share one connection and one message per exchange.

Messages are JSON, in metres and newtons, with z up; every field that is used is validated. The service omits default
values, so a missing coordinate is zero, but a position without any coordinate is invalid. The keys of a device's
configuration are assumptions, which have not been confirmed with a service.
"""

from __future__ import annotations

import json
import math
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from graspfx.protocols import DeviceError, MissingPackageError

if TYPE_CHECKING:
    from graspfx.devices.haply_inverse.websocket import WebSocket

KIND = "inverse3"
AXES = "x", "y", "z"
IDENTITY = "XYZ"  # identity basis: the service's own axes

Force = tuple[float, float, float]
INVENTORY = 1.0  # longest wait for the service's first message, the list of devices [s]
LOST = 0.02  # time after which a missing answer counts as lost [s]
ABSENT = 2  # number of successive answers without a device after which the device counts as disconnected
ZERO: Force = (0.0, 0.0, 0.0)

Sample = tuple[tuple[float, float, float], float]  # position [m] and time of the request [s]


class Service:
    """A connection shared by the devices of a program.

    The service sends a list of devices first, and then answers each message once. A message contains the forces of all
    devices. In each tick, a message is sent when the first device asks, and another when the last device has written.
    Answers arrive in order. A lost or late answer does not delay the messages of the next tick.

    Args:
        url: Address of the service.

    Raises:
        MissingPackageError: If websockets is not installed.
    """

    def __init__(self, url: str) -> None:
        self._line = _websocket(url)
        self.forces: dict[str, Force] = {}
        self.samples: dict[str, Sample] = {}  # newest sample of each device
        self._inventory: Mapping[str, Mapping[str, Any]] = {}
        self._sent: deque[float] = deque()  # times of unanswered messages
        self._round: set[str] = set()  # devices that have asked since the last request
        self._written: set[str] = set()  # devices that have written since the last message
        self._missing: dict[str, int] = {}

    @property
    def url(self) -> str:
        return str(self._line.url)

    def now(self) -> float:
        """Return the time of the connection's clock [s]."""
        return float(self._line.now())

    def join(self, name: str | None, basis: str | None = None, damping: float = 0.0) -> str:
        """Register a device, at zero force; return its id.

        Args:
            name: Id of the device; None for the only device.
            basis, damping: Configuration that the service must report; not checked if `basis` is None.

        Raises:
            DeviceError: If the service or the device does not exist, or the device is in use or configured differently.
        """
        if not self.forces:
            self._connect()
        try:
            name = self._choose(name)
            if basis is not None:
                check_config(self._inventory[name], basis, damping)
        except DeviceError:
            if not self.forces:
                self._line.close()
            raise
        self.forces[name] = ZERO
        self._missing[name] = 0
        return name

    def leave(self, name: str) -> None:
        """Set a device to zero force and release it; the release of the last device closes the connection."""
        if name not in self.forces:
            return
        self.forces[name] = ZERO
        with suppress(DeviceError):  # the service may have ended
            self._send()
            self._drain(self.now() + LOST, all_of_them=True)  # lets the service answer before the connection closes
        del self.forces[name]
        self.samples.pop(name, None)
        self._round.discard(name)
        self._written.discard(name)
        if not self.forces:
            self._line.close()

    def ask(self, name: str) -> None:
        """Request a position; in each tick, the request of the first device is sent and serves all devices."""
        if self._round and name not in self._round:
            self._round.add(name)
            return
        self._round = {name}
        self._drain(0.0, keep=False)  # discards answers to written forces, which are a period old
        self._send()

    def sample(self, name: str, deadline: float) -> Sample | None:
        """Wait for an answer to the last request until a deadline [s]; return the newest sample of a device, or None.

        Raises:
            DeviceError: If the service has ended, or no longer lists the device.
        """
        if self._sent:
            self._drain(deadline)
        if self._missing[name] >= ABSENT:
            raise DeviceError(f"{name} is disconnected: the service at {self.url} no longer lists it")
        return self.samples.get(name)

    def write(self, name: str, force: Force) -> None:
        """Set the force of a device; the forces of all devices are sent together."""
        self.forces[name] = force
        self._written.add(name)
        if self._written >= self.forces.keys():
            self._send()

    def stop(self, name: str) -> None:
        """Set the force of a device to zero immediately."""
        self.forces[name] = ZERO
        self._send()

    def _connect(self) -> None:
        self._line.open()
        self._sent.clear()
        self._round, self._written = set(), set()
        self.samples, self._missing, self._question = {}, {}, 0.0
        deadline = self.now() + INVENTORY
        while (text := self._line.receive(deadline)) is not None:
            devices = devices_in(text)
            if devices is not None:
                self._inventory = devices
                return
        self._line.close()
        raise DeviceError(f"the service at {self.url} sent no list of devices within {INVENTORY:g} s")

    def _choose(self, name: str | None) -> str:
        names = ", ".join(self._inventory) or "none"
        if name is None:
            if len(self._inventory) != 1:
                raise DeviceError(f"the service at {self.url} has the devices {names}: set `device` to one of them")
            name = next(iter(self._inventory))
        if name not in self._inventory:
            raise DeviceError(f"the service at {self.url} has no device {name!r}; it has {names}")
        if name in self.forces:
            raise DeviceError(f"{name} is in use: only one driver may use a device")
        return name

    def _send(self) -> None:
        self._written.clear()
        now = self.now()
        self._line.send(forces_text(self.forces))
        self._sent.append(now)
        self._question = now

    def _drain(self, deadline: float, *, keep: bool = True, all_of_them: bool = False) -> None:
        """Wait until a deadline [s] for one answer, or for all if `all_of_them`; process the answers that arrive.

        Samples in the answers are stored if `keep`.
        """
        while (text := self._line.receive(deadline)) is not None:
            self._take(text, keep)
            if not (all_of_them and self._sent):
                deadline = 0.0
        while self._sent and self.now() - self._sent[0] > LOST:
            self._sent.popleft()

    def _take(self, text: str, keep: bool) -> None:
        """Process a message as the answer to the oldest request; after a lost answer, sample times are too early."""
        when = self._sent.popleft() if self._sent else self._question
        devices = devices_in(text)
        if devices is None:
            return
        for name in self.forces:
            device = devices.get(name)
            self._missing[name] = 0 if device is not None else self._missing[name] + 1
            position = None if device is None else position_in(device)
            last = self.samples.get(name)
            if keep and position is not None and (last is None or when > last[1]):
                self.samples[name] = position, when


def _websocket(url: str) -> WebSocket:
    try:
        from graspfx.devices.haply_inverse.websocket import WebSocket
    except ImportError as error:
        raise MissingPackageError.of_extra("websockets", "a device of the Inverse service", "inverse") from error
    return WebSocket(url)


_services: dict[str, Service] = {}


def service_at(url: str) -> Service:
    """Return this program's connection to a service, shared by its devices."""
    return _services.setdefault(url, Service(url))


# Messages -------------------------------------------------------------------------------------------------------------


def forces_text(forces: Mapping[str, Force]) -> str:
    """Return the message that sets the force of each device [N]."""
    devices = [
        {"device_id": name, "commands": {"set_cursor_force": {"values": dict(zip(AXES, force, strict=True))}}}
        for name, force in forces.items()
    ]
    return json.dumps({KIND: devices}, separators=(",", ":"), allow_nan=False)


def devices_in(text: str) -> dict[str, Mapping[str, Any]] | None:
    """Return the data of each device in a message, by id; None if the text is not a valid message."""
    try:
        message = json.loads(text)
    except (ValueError, RecursionError):
        return None
    each = message.get(KIND, []) if isinstance(message, dict) else None
    if not isinstance(each, list):
        return None
    return {
        device["device_id"]: device
        for device in each
        if isinstance(device, dict) and isinstance(device.get("device_id"), str)
    }


def position_in(device: Mapping[str, Any]) -> tuple[float, float, float] | None:
    """Return a device's position [m]; None if it is missing or not finite."""
    state = device.get("state")
    position = state.get("cursor_position") if isinstance(state, dict) else None
    if not isinstance(position, dict) or not position.keys() & set(AXES):
        return None
    values = [position.get(axis, 0.0) for axis in AXES]
    if any(isinstance(x, bool) or not isinstance(x, int | float) or not math.isfinite(x) for x in values):
        return None
    x, y, z = values
    return float(x), float(y), float(z)


def check_config(device: Mapping[str, Any], basis: str, damping: float) -> None:
    """Check that the service's configuration of a device agrees with the scene.

    Raises:
        DeviceError: If the basis or the damping differs, if the mount is not the identity, or if the force gate is
            closed.
    """
    name, config = device["device_id"], device.get("config")
    if not isinstance(config, dict):
        config = {}
    own = _part(config.get("basis"), "permutation", IDENTITY)
    if own != basis:
        raise _other(name, "basis", own, basis, "rotate the axes with the device's `frame`")
    mount = config.get("mount")
    if mount and not _is_identity(mount):
        raise _other(name, "mount", mount, "none", "set the position with the device's `frame`")
    viscous = _part(config.get("damping"), "scalar", 0.0)
    if isinstance(viscous, bool) or not isinstance(viscous, int | float) or abs(viscous - damping) > 1e-9:
        raise _other(name, "damping", viscous, f"{damping:g} N s/m", "set `damping` to the service's value")
    gate = _part(config.get("force_gate"), "enabled", True)
    if gate is False or (isinstance(gate, int | float) and gate == 0):
        raise DeviceError(f"the service blocks the force of {name}: open its force gate")


def _part(value: Any, key: str, default: Any) -> Any:
    """Return a value, or its entry `key` if the value is a table; return the default if the result is missing."""
    if isinstance(value, dict):
        value = value.get(key)
    return default if value is None else value


def _is_identity(value: Any) -> bool:
    """Tell whether a transform is the identity: scales and the entry `w` of a rotation are 1, other entries are 0."""
    if isinstance(value, dict):
        return all(
            part == 1 if key == "w" else _scale_is_one(part) if key == "scale" else _is_identity(part)
            for key, part in value.items()
        )
    return value is None or value == 0


def _scale_is_one(value: Any) -> bool:
    return all(part == 1 for part in value.values()) if isinstance(value, dict) else value == 1


def _other(name: str, key: str, own: Any, expected: str, do: str) -> DeviceError:
    own_text = json.dumps(own)[:80]
    return DeviceError(f"the service's {key} of {name} is {own_text}, but the scene expects {expected}: {do}")
