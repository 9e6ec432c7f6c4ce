"""Protocol of the rig's controller: HELLO and ARM, then POLL, STATE and RUN in each sample, and STOP at the end.

A frame is the COBS encoding of a message and its CRC, followed by a zero byte; firmware/rig.h defines the messages.
"""

from __future__ import annotations

import binascii
import secrets
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from enum import IntEnum
from typing import NamedTuple, TypeVar

from graspfx.protocols import DeviceError, SerialPort

T = TypeVar("T")

VERSION, AXES = 2, 4

ABOUT = struct.Struct("<BBBBi4iII")
STATE = struct.Struct("<BHBBI8i")
RUN = struct.Struct("<BHI4i")
LONG = struct.Struct("<BHI")
SHORT = struct.Struct("<BH")

TRIES = 5  # attempts of HELLO and ARM
PATIENCE = 0.1  # longest wait for an answer to HELLO, to ARM, or to the STOP that `rest` sends [s]
GOODBYE = 0.02  # longest wait for an answer to the STOP that `close` sends [s]
LONGEST = 4096  # largest number of stored bytes of an incomplete frame
STILL = (0.0,) * AXES


class Kind(IntEnum):
    """Kind of a message, its first byte."""

    HELLO = 0x01
    ARM = 0x02
    STOP = 0x03
    RUN = 0x10
    POLL = 0x11
    ABOUT = 0x81
    STATE = 0x90


class Mode(IntEnum):
    """The controller's state."""

    IDLE = 0
    ARMED = 1
    RUNNING = 2
    FAULT = 3


FAULTS = (
    "no fault",
    "watchdog: no torques arrived for 5 ms, or for 5 s after the motors were switched on",
    "overspeed: a joint turned faster than the controller allows",
    "overcurrent: a motor driver has switched itself off",
    "encoder: a sensor returns no counts",
    "emergency stop: button pressed, deadman switch released, or motor supply off",
    "noise: ten damaged frames in a row",
)


class About(NamedTuple):
    """The controller's answer to HELLO."""

    version: int
    axes: int
    mode: int
    watchdog: float  # [s]
    limits: tuple[float, ...]  # torque limits of the motors [N m]
    nonce: int  # nonce of the answered HELLO
    session: int  # session number for ARM and RUN


class State(NamedTuple):
    """The controller's answer to POLL, ARM or STOP."""

    number: int  # number of the answered message
    mode: int
    fault: int
    microseconds: int  # controller's clock, modulo 2^32
    counts: tuple[int, ...]
    rates: tuple[int, ...]  # [counts/s]


class Controller:
    """A controller of two arms, used by one program.

    Args:
        port: Serial port.
        timeout: Longest wait for the answer to POLL [s].
    """

    def __init__(self, port: SerialPort, timeout: float) -> None:
        self.port, self.timeout = port, timeout
        # RUN and POLL are counted separately: after many POLLs, a common number would make a RUN look old.
        self._number = 0  # number of the last RUN
        self._question = 0  # number of the last POLL
        self._session = 0  # session number from the controller
        self._buffer = b""
        self._deadline: float | None = None  # deadline of the pending answer
        self._armed = False

    def open(self, torque_limit: float, watchdog: float) -> State:
        """Identify the controller, and switch the motors on at zero torque.

        Raises:
            DeviceError: If there is no answer, the version differs, the torque limits are too low, the watchdog is too
                long, or the controller does not arm.
        """
        self.close()
        self.port.open()
        try:
            about = self._meet()
            if about.version != VERSION or about.axes != AXES:
                text = f"version {about.version} with {about.axes} axes; this driver needs {VERSION} with {AXES}"
                raise DeviceError(f"the controller at {self.port.path} has {text}: load the driver's firmware")
            if min(about.limits) < torque_limit:
                text = f"{min(about.limits):g} N m, below `torque_limit`, {torque_limit:g} N m"
                raise DeviceError(f"the controller at {self.port.path} limits its motors to {text}: reduce the setting")
            if about.watchdog > watchdog:
                raise DeviceError(
                    f"the controller at {self.port.path} has a watchdog of {about.watchdog:g} s, which is too long: "
                    f"load firmware with at most {watchdog:g} s"
                )
            self._armed = True
            self._session = about.session
            state = self._exchange(Kind.ARM, lambda: long_frame(Kind.ARM, about.session), state_in)
            if state.mode != Mode.ARMED:
                raise DeviceError(f"the controller at {self.port.path} does not arm; {self._fault(state)}")
        except DeviceError:
            self.close()
            raise
        return state

    def ask(self) -> None:
        """Send POLL."""
        self._question += 1
        self._deadline = self.port.now() + self.timeout
        self.port.send(short_frame(Kind.POLL, self._question))

    def answer(self) -> State | None:
        """Wait for the STATE that answers the last `ask`; return None if STATE does not arrive in time.

        If no answer is pending, `ask` is called first.

        Raises:
            DeviceError: If the hardware is disconnected, or the controller has latched a fault or restarted.
        """
        if self._deadline is None:
            self.ask()
        deadline, self._deadline = self._deadline or 0.0, None
        for message in self._messages(deadline):
            state = state_in(message)
            if state is not None and state.mode not in (Mode.ARMED, Mode.RUNNING):
                raise DeviceError(f"the controller at {self.port.path} has disarmed; {self._fault(state)}")
            if state is not None and state.number == self._question & 0xFFFF:  # a late answer has an older number
                return state
        return None

    def run(self, torques: tuple[float, ...]) -> None:
        """Send the torques of the motors (4,) [N m]."""
        self._number += 1
        self.port.send(run_frame(self._number, self._session, torques))

    def rest(self) -> None:
        """Open the port again and switch the controller's motors off, even if another program switched them on."""
        self.close()
        self.port.open()
        self._exchange(Kind.STOP, lambda: short_frame(Kind.STOP), state_in)

    def close(self) -> None:
        """Set zero torque, switch the motors off and close the port; no error is raised if the hardware is lost."""
        if self._armed:
            self._armed = False
            with suppress(DeviceError):
                self.run(STILL)
                self.port.send(short_frame(Kind.STOP))
                next((each for each in self._messages(self.port.now() + GOODBYE) if state_in(each)), None)
        self.port.close()
        self._buffer, self._deadline = b"", None

    def _meet(self) -> About:
        """Begin a session and return the answer; each attempt has a new nonce, which identifies late answers."""
        nonce = 0

        def hello() -> bytes:
            nonlocal nonce
            nonce = secrets.randbits(32)
            frame: bytes = long_frame(Kind.HELLO, nonce)
            return frame

        def answer(message: bytes) -> About | None:
            about = about_in(message)
            return about if about is not None and about.nonce == nonce else None

        return self._exchange(Kind.HELLO, hello, answer)

    def _exchange(self, kind: Kind, question: Callable[[], bytes], reading: Callable[[bytes], T | None]) -> T:
        for _ in range(TRIES):
            self.port.send(b"\0" + question())  # the zero byte ends an incomplete frame of another program
            for message in self._messages(self.port.now() + PATIENCE):
                answer = reading(message)
                if answer is not None:
                    self._number = 0
                    return answer
        raise DeviceError(
            f"no controller of a rig at {self.port.path} has answered {TRIES} messages {kind.name}: check the setting "
            "`port`, and the controller's cable and power"
        )

    def _messages(self, deadline: float) -> Iterator[bytes]:
        """Yield the undamaged messages that arrive until a deadline on the port's clock [s].

        After the deadline the bytes that have arrived are read once, because the sender may never pause.
        """
        is_last = False
        while True:
            frame, end, rest = self._buffer.partition(b"\0")
            if end:
                self._buffer = rest
                message = unframed(frame)
                if message is not None:
                    yield message
                continue
            if is_last:
                return
            is_last = self.port.now() > deadline
            data = self.port.receive(deadline)
            if not data:
                return
            self._buffer = (self._buffer + data)[-LONGEST:]

    @staticmethod
    def _fault(state: State) -> str:
        if state.mode == Mode.FAULT:
            return FAULTS[state.fault] if state.fault < len(FAULTS) else f"fault {state.fault}"
        return f"its state is {Mode(state.mode).name if state.mode in set(Mode) else state.mode}"


# Frames ---------------------------------------------------------------------------------------------------------------


def framed(message: bytes) -> bytes:
    """Return the frame of a message: the COBS encoding of message and CRC-16/CCITT-FALSE, then a zero byte."""
    out = bytearray()
    for part in (message + struct.pack("<H", binascii.crc_hqx(message, 0xFFFF))).split(b"\0"):
        out.append(len(part) + 1)
        out += part
    out.append(0)
    return bytes(out)


def unframed(frame: bytes) -> bytes | None:
    """Return the message of a frame, given without the final zero byte; None if the frame is damaged."""
    out, at = bytearray(), 0
    while at < len(frame):
        run = frame[at]
        if run == 0 or at + run > len(frame):
            return None
        out += frame[at + 1 : at + run]
        at += run
        if at < len(frame):
            out.append(0)
    message = bytes(out[:-2])
    if len(message) < SHORT.size or binascii.crc_hqx(message, 0xFFFF) != int.from_bytes(out[-2:], "little"):
        return None
    return message


def short_frame(kind: Kind, number: int = 0) -> bytes:
    """Return a STOP or POLL frame."""
    return framed(SHORT.pack(kind, number & 0xFFFF))


def long_frame(kind: Kind, word: int) -> bytes:
    """Return a HELLO frame, where `word` is the nonce, or an ARM frame, where `word` is the session number."""
    return framed(LONG.pack(kind, 0, word))


def run_frame(number: int, session: int, torques: tuple[float, ...]) -> bytes:
    """Return a RUN frame with the session number and the motors' torques (4,) [N m]."""
    return framed(RUN.pack(Kind.RUN, number & 0xFFFF, session, *(round(1e6 * torque) for torque in torques)))


def about_in(message: bytes) -> About | None:
    """Return the content of an ABOUT message; None for a message of another kind."""
    if len(message) != ABOUT.size or message[0] != Kind.ABOUT:
        return None
    _, version, axes, mode, watchdog, *limits, nonce, session = ABOUT.unpack(message)
    return About(version, axes, mode, 1e-6 * watchdog, tuple(1e-6 * limit for limit in limits), nonce, session)


def state_in(message: bytes) -> State | None:
    """Return the content of a STATE message; None for a message of another kind."""
    if len(message) != STATE.size or message[0] != Kind.STATE:
        return None
    _, number, mode, fault, microseconds, *axes = STATE.unpack(message)
    return State(number, mode, fault, microseconds, tuple(axes[::2]), tuple(axes[1::2]))
