"""The wire of a device: what a bench that stands in for its hardware shows, and how it fails."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import InputError
from graspfx.loop.realtime.pacing import Clock, WallClock
from graspfx.resource import Resource

FloatArray = NDArray[np.float64]
Failure = Literal["late", "drop", "flip", "cut", "garbage", "wrong-id", "unplugged", "blocked"]
"""Names of the ways in which an emulator fails."""

FAILURES: tuple[Failure, ...] = get_args(Failure)
"""All names of `Failure`."""
NUMBERS: Mapping[Failure, float] = MappingProxyType(
    {"late": 0.004, "drop": 2.0, "flip": 0.5, "cut": -1.0, "garbage": 20.0}
)
"""The number of a failure where none is given."""

SMALL = 1e-6  # of an angle, for a difference [rad]


class Wire(Resource):
    """An emulator of hardware: it answers a driver, shows what the motors hold, and fails on demand.

    It is a context manager: inside `with`, `settings` are those of the driver's `connect` that lead to it.

    Args:
        clock: of the hardware, and of the conformance kit on it; the machine's if it is left out.

    Attributes:
        kinds: the failures that this hardware can have.
        limit: the largest torque of each motor [N m], or of a library the largest force [N].
        checksum: whether a changed bit is seen by who receives it.
        slowness: seconds in which a second of the hardware's own clock goes by.
    """

    kinds: frozenset[Failure] = frozenset(FAILURES)
    limit: float
    checksum = True
    slowness = 1.0

    def __init__(self, clock: Clock | None = None) -> None:
        self.clock: Clock = clock or WallClock()
        self.failure: Failure | None = None
        self.number = 0.0

    @property
    @abstractmethod
    def settings(self) -> dict[str, Any]:
        """Settings of `connect` that lead here, such as the port."""

    @property
    @abstractmethod
    def torque(self) -> FloatArray:
        """Torques that the motors hold now, (m,) [N m]; of a library that takes forces, those [N]."""

    @property
    def position(self) -> FloatArray | None:
        """The fingertips as they are, (k, d) [m]; None if the emulator does not know the mechanism."""
        return None

    @property
    def force(self) -> FloatArray | None:
        """Forces of the motors at the fingertips, (k, d) [N]; None if the emulator does not know the mechanism."""
        return None

    @abstractmethod
    def move(self) -> None:
        """Put every finger a few millimetres away from home, and leave it there."""

    @abstractmethod
    def home(self) -> None:
        """Put every finger where it was when the wire was made: where a device may be opened."""

    def fail(self, kind: Failure, number: float | None = None) -> None:
        """Have the wire fail from now on, until `heal`.

        Args:
            kind: "late": answers come `number` seconds late; "drop": one answer in `number` is lost; "flip": a bit is
                changed in an answer with the probability `number`; "cut": of an answer `number` bytes come through, or
                with -1 as many as the count of answers says, so that in time every byte is the last; "garbage":
                `number` random bytes before every answer; "wrong-id": answers are another device's; "unplugged": the
                cable is out; "blocked": the board neither reads nor answers, and its motors go on.
            number: of the failure; NUMBERS has the one where it is left out.

        Raises:
            InputError: a kind that this hardware cannot have.
        """
        if kind not in self.kinds:
            raise InputError("kind", kind, f"one of {', '.join(sorted(self.kinds))}")
        self.number = NUMBERS.get(kind, 0.0) if number is None else float(number)
        self.failure = kind
        self._change()

    def heal(self) -> None:
        """End the failure; a cable that was out is plugged in again, under the same settings."""
        self.failure = None
        self._change()

    @abstractmethod
    def _change(self) -> None:
        """Pass the failure on to where it happens."""

    @abstractmethod
    def close(self) -> None:
        """Take the bench down; returns also when it is called again."""


def tip_force(place: Callable[[FloatArray], FloatArray], angles: FloatArray, torque: FloatArray) -> FloatArray:
    """Compute f of J'f = tau, (d,) [N], by virtual work: J = dp/dq is taken by differences.

    Args:
        place: the fingertip (d,) [m] by the angles of the joints (d,) [rad].
        angles: where the joints are.
        torque: at the joints, (d,) [N m].
    """
    steps = SMALL * np.eye(len(angles))
    J = np.array([(place(angles + step) - place(angles - step)) / (2.0 * SMALL) for step in steps]).T
    force: FloatArray = np.linalg.solve(J.T, torque)
    return force
