"""The Inverse service for all devices of a program: one connection, and one message for all of them at a time."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from graspfx.devices.haply_inverse.inverse_messages import Force, check_config, devices_in, forces_text, position_in
from graspfx.protocols import DeviceError, MissingPackageError

if TYPE_CHECKING:
    from graspfx.devices.haply_inverse.websocket import WebSocket

INVENTORY = 1.0  # for the first message of the service [s]
LOST = 0.02  # an answer that has not come by then is not waited for any more [s]
ABSENT = 2  # answers in a row without a device that was there
ZERO: Force = (0.0, 0.0, 0.0)

Sample = tuple[tuple[float, float, float], float]  # where [m], and when it was asked for [s]


class Service:
    """A connection that the devices of a program share; the service answers each message once, and says nothing else.

    A message carries the forces of all devices. One is sent when the first of them asks in a tick, and one when the
    last has written. Answers come in order; one that is lost or late holds nobody up: the next tick sends all the same.

    Args:
        url: of the service.

    Raises:
        MissingPackageError: websockets is not installed.
    """

    def __init__(self, url: str) -> None:
        self._line = _websocket(url)
        self.forces: dict[str, Force] = {}
        self.samples: dict[str, Sample] = {}  # the newest of each device
        self._inventory: Mapping[str, Mapping[str, Any]] = {}
        self._sent: deque[float] = deque()  # times of messages that are not answered
        self._round: set[str] = set()  # devices that have asked since the last question
        self._written: set[str] = set()  # devices that have written since the last message
        self._missing: dict[str, int] = {}

    @property
    def url(self) -> str:
        return str(self._line.url)

    def now(self) -> float:
        """Give the time of the connection's clock [s]."""
        return float(self._line.now())

    def join(self, name: str | None, basis: str | None = None, damping: float = 0.0) -> str:
        """Take a device, at zero force; give its id.

        Args:
            name: its id; None for the only one there is.
            basis, damping: that the service has to have for it; not looked at if there is no basis.

        Raises:
            DeviceError: no service, no such device, one that is taken, or one that the service has set otherwise.
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
        """Let go of a device at zero force; the last one closes the connection."""
        if name not in self.forces:
            return
        self.forces[name] = ZERO
        with suppress(DeviceError):  # the service may be gone, and then nothing is left to tell it
            self._send()
            self._drain(self.now() + LOST, all_of_them=True)  # so that it has been read before the line closes
        del self.forces[name]
        self.samples.pop(name, None)
        self._round.discard(name)
        self._written.discard(name)
        if not self.forces:
            self._line.close()

    def ask(self, name: str) -> None:
        """Ask where devices are, once for all that ask in a tick."""
        if self._round and name not in self._round:
            self._round.add(name)
            return
        self._round = {name}
        self._drain(0.0, keep=False)  # answers to what was written, which are a period old
        self._send()

    def sample(self, name: str, deadline: float) -> Sample | None:
        """Give the newest sample of a device, after an answer to the last question or at a time; None if there is none.

        Raises:
            DeviceError: the service is gone, or says that the device is.
        """
        if self._sent:
            self._drain(deadline)
        if self._missing[name] >= ABSENT:
            raise DeviceError(f"{name} is gone: the service at {self.url} has it no more")
        return self.samples.get(name)

    def write(self, name: str, force: Force) -> None:
        """Set the force of a device; what all have written goes out together."""
        self.forces[name] = force
        self._written.add(name)
        if self._written >= self.forces.keys():
            self._send()

    def stop(self, name: str) -> None:
        """Set the force of a device to zero, now."""
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
        raise DeviceError(f"the service at {self.url} gives no inventory")

    def _choose(self, name: str | None) -> str:
        names = ", ".join(self._inventory) or "none"
        if name is None:
            if len(self._inventory) != 1:
                raise DeviceError(f"the service at {self.url} has the devices {names}: name one, as `device`")
            name = next(iter(self._inventory))
        if name not in self._inventory:
            raise DeviceError(f"the service at {self.url} has no device {name!r}; it has {names}")
        if name in self.forces:
            raise DeviceError(f"{name} is taken: two must not drive one device")
        return name

    def _send(self) -> None:
        self._written.clear()
        now = self.now()
        self._line.send(forces_text(self.forces))
        self._sent.append(now)
        self._question = now

    def _drain(self, deadline: float, *, keep: bool = True, all_of_them: bool = False) -> None:
        """Take the answers that have come; wait for one, or for all, until a time."""
        while (text := self._line.receive(deadline)) is not None:
            self._take(text, keep)
            if not (all_of_them and self._sent):
                deadline = 0.0
        while self._sent and self.now() - self._sent[0] > LOST:
            self._sent.popleft()

    def _take(self, text: str, keep: bool) -> None:
        """Take an answer: of the oldest question, unless that one is lost, so that a sample is never called younger."""
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
    """Give this program's connection to a service, whichever device asked for it first."""
    return _services.setdefault(url, Service(url))
