"""Promises of devices and scenes: tests of single promises, the error for a broken promise, and reports."""

from __future__ import annotations

from dataclasses import dataclass
from types import TracebackType

from graspfx.errors import GraspFXError


class ConformanceError(GraspFXError, AssertionError):
    """Error if a device or a scene breaks a promise.

    Args:
        promise: Text of the promise.
        found: Observation that contradicts the promise.
        subject: Subject of the promise, "device" or "scene".
    """

    def __init__(self, promise: str, found: str, subject: str = "device") -> None:
        self.promise, self.found = promise, found
        super().__init__(f"the {subject} does not keep its promise: {promise}; found: {found}")


class Promise:
    """Context manager that tests a promise; any exception in its `with` block means that the promise is broken.

    Args:
        text: Text of the promise.
        subject: Subject of the promise, "device" or "scene".
        record: List to which the text is added if the promise is kept.
    """

    def __init__(self, text: str, subject: str = "device", record: list[str] | None = None) -> None:
        self.text, self.subject, self._record = text, subject, record

    def __enter__(self) -> Promise:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        if isinstance(error, Exception) and not isinstance(error, ConformanceError):
            raise ConformanceError(self.text, f"{type(error).__name__}: {error}", self.subject) from error
        if error is None and self._record is not None and self.text not in self._record:
            self._record.append(self.text)

    def holds(self, outcome: object, finding: str) -> None:
        if not outcome:
            raise ConformanceError(self.text, finding, self.subject)


class Promises:
    """Tests promises of one subject, and records which of them are kept.

    Attributes:
        texts: Texts of the promises that are kept, in the order of the tests.
    """

    def __init__(self, subject: str) -> None:
        self._subject = subject
        self.texts: list[str] = []

    def __call__(self, text: str) -> Promise:
        """Return the context manager that tests a promise."""
        return Promise(text, self._subject, self.texts)


@dataclass(frozen=True)
class BlindSpot:
    """A promise of a device that the conformance kit cannot verify.

    Attributes:
        promise: Requirement of the protocol.
        reason: Reason why the kit cannot verify the requirement, or a weaker requirement that it has checked.
    """

    promise: str
    reason: str

    def __str__(self) -> str:
        return f"{self.promise} ({self.reason})"


@dataclass(frozen=True, repr=False)
class DeviceReport:
    """Result of `check_device`: promises that the device keeps, and promises that could not be checked.

    Attributes:
        checks: Promises that were checked and are kept, in the order of the checks.
        not_visible: Promises that the kit could not observe, so that a driver that breaks them passes. Test them with a
            force gauge and a ruler before a person holds the device.
        needs_person: Promises of the hardware that only a person can check, each with an instruction.
    """

    checks: tuple[str, ...]
    not_visible: tuple[BlindSpot, ...]
    needs_person: tuple[BlindSpot, ...] = ()

    def __str__(self) -> str:
        parts = (
            ("passed", self.checks),
            ("not visible", self.not_visible),
            ("needs a person", self.needs_person),
        )
        return "\n".join(f"{name}:\n" + "\n".join(f"  - {each}" for each in lines) for name, lines in parts if lines)

    def __repr__(self) -> str:
        return str(self)


# Promises of hardware that the kit can observe only with a wire (an emulator of the hardware).
ZERO = "`stop` and `close` set zero force"
NOT_FINITE = "a non-finite force is displayed as zero"
LIMIT = "the force limit is applied last"
NEWTONS = "a force reaches its own finger, in its direction, in newtons"
METRES = "positions are in metres, velocities in metres per second, each for its own finger and axis"
SECONDS = "the time is that of the reading, in seconds"
ALONE = "the device's force ends without further writes"

HARDWARE = (
    BlindSpot(ZERO, "the kit cannot observe the force, only that the calls return"),
    BlindSpot(NOT_FINITE, "the kit checks that DeviceError is raised, but cannot observe the force"),
    BlindSpot(LIMIT, "the kit writes only small forces, and cannot observe the force"),
    BlindSpot(NEWTONS, "the kit cannot observe the actuators"),
    BlindSpot(
        METRES,
        "the kit checks only that the arrays have the right shape and are finite: millimetres pass",
    ),
    BlindSpot(SECONDS, "the kit checks only that the time does not decrease"),
    BlindSpot(ALONE, "the kit cannot kill the program that uses the device"),
)
"""Promises that the kit cannot observe in hardware."""

PERSON = (
    BlindSpot(
        "the motors exert the forces that the driver sends",
        "measure magnitude, direction and sign of the force of every finger with a force gauge",
    ),
    BlindSpot(
        "lengths, encoders and axes are those of the settings",
        "put each finger at positions measured with a ruler, and compare the readings",
    ),
    BlindSpot("the emergency stop switches the power off", "press the emergency stop while a force is displayed"),
)
"""Promises of hardware that only a person can test."""

FORCELESS = HARDWARE[4:6]
"""Promises that the kit cannot observe in hardware without force feedback."""

SIMULATED = (
    BlindSpot("velocities are the derivatives of the positions", "the kit checks only that the velocities are finite"),
)
"""Promises that the kit cannot observe in a simulated device."""

NO_LIMIT = BlindSpot("a force limit", "`features.peak_force` is None, so no limit was tested")
NOT_NEWTONS = BlindSpot(
    "forces and their limit are in newtons",
    "the device's efforts are not in newtons: the kit checks only that each force causes an effort of its own finger, "
    "and that efforts are bounded",
)
ONE_DEVICE = BlindSpot(
    "two devices of one kind are independent", "a device was given: pass a function that creates a device"
)
ALWAYS = (
    BlindSpot("`read` and `write` neither wait nor allocate more than necessary", "no time is measured"),
    BlindSpot(
        "mass, friction, stiffness, damping and delay are those that `features` reports",
        "the kit checks only that the numbers are plausible",
    ),
)
"""Promises that the kit cannot observe in any device."""
