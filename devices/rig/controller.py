"""The rig's controller at its port: HELLO and ARM, then POLL, STATE and RUN in each sample, and STOP at the end."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import TypeVar

from graspfx.devices.rig.rig_frames import (
    AXES,
    FAULTS,
    VERSION,
    About,
    Kind,
    Mode,
    State,
    about_in,
    long_frame,
    run_frame,
    short_frame,
    state_in,
    unframed,
)
from graspfx.protocols import DeviceError, SerialPort

T = TypeVar("T")

TRIES = 5  # attempts of HELLO and ARM
PATIENCE = 0.1  # time for an answer to HELLO or ARM [s]
GOODBYE = 0.02  # time for an answer to STOP [s]
LONGEST = 4096  # largest number of stored bytes without an end of frame
STILL = (0.0,) * AXES


class Controller:
    """A controller of two arms, used by one program.

    Args:
        port: Serial port.
        timeout: Longest wait for the answer to POLL [s].
    """

    def __init__(self, port: SerialPort, timeout: float) -> None:
        self.port, self.timeout = port, timeout
        self._number = 0  # number of the last RUN, counted separately because many POLLs would make commands look old
        self._question = 0  # number of the last POLL
        self._session = 0  # session number from the controller
        self._buffer = b""
        self._deadline: float | None = None  # deadline of the pending answer
        self._armed = False

    def open(self, torque_limit: float, watchdog: float) -> State:
        """Identify the controller, and switch the motors on at zero torque.

        Raises:
            DeviceError: If there is no answer, the version differs, limits are too low, or the controller does not arm.
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
        """Wait for the STATE that answers the last `ask`, and ask first if necessary; return None if STATE is too late.

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
            if state is not None and state.number == self._question & 0xFFFF:  # older numbers answer lost requests
                return state
        return None

    def run(self, torques: tuple[float, ...]) -> None:
        """Send the torques of the motors (4,) [N m]."""
        self._number += 1
        self.port.send(run_frame(self._number, self._session, torques))

    def rest(self) -> None:
        """Connect to the controller again and switch its motors off, whichever program switched them on."""
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
        """Begin a session; each attempt has its own nonce, by which a late answer is recognised."""
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
            self.port.send(b"\0" + question())  # the zero byte ends a frame left by another program
            for message in self._messages(self.port.now() + PATIENCE):
                answer = reading(message)
                if answer is not None:
                    self._number = 0
                    return answer
        raise DeviceError(f"nothing at {self.port.path} answers {kind.name} like a rig's controller")

    def _messages(self, deadline: float) -> Iterator[bytes]:
        """Yield messages until a deadline of the port's clock [s], skipping damaged messages."""
        while True:
            frame, end, rest = self._buffer.partition(b"\0")
            if end:
                self._buffer = rest
                message = unframed(frame)
                if message is not None:
                    yield message
                continue
            data = self.port.receive(deadline)
            if not data:
                return
            self._buffer = (self._buffer + data)[-LONGEST:]

    @staticmethod
    def _fault(state: State) -> str:
        if state.mode == Mode.FAULT:
            return FAULTS[state.fault] if state.fault < len(FAULTS) else f"fault {state.fault}"
        return f"its state is {Mode(state.mode).name if state.mode in set(Mode) else state.mode}"
