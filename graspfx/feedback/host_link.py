"""Host's side of the bridge: it reads the operator's state and writes the forces that devices display."""

from __future__ import annotations

from time import monotonic, sleep
from types import TracebackType
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from graspfx.errors import DeviceError, InputError
from graspfx.feedback.contact_split import Shown
from graspfx.feedback.host_record import (
    DIMENSIONS,
    FINGERS,
    HOST_ENDED,
    HOST_FIRST,
    HOST_NUMBER,
    HOST_SIZE,
    LOOP_FIRST,
    LOOP_NUMBER,
    LOOP_SAMPLE,
    LOOP_SIZE,
    RUNNING,
    SAMPLE,
    SLOTS,
    STATE,
    find_record,
    total,
)
from graspfx.numeric import single

FloatArray = NDArray[np.float64]

LOOK = 0.01  # time between two checks for the loop [s]
DEAD = 2.0  # time without a sample after which a loop is considered killed [s]
TRIES = 100  # attempts to read a complete sample; the loop writes one in a microsecond


class Operator(NamedTuple):
    """State of the operator in a tick of the loop.

    Attributes:
        time: Time of the tick on the loop's clock [s].
        position: Positions of the device's fingers, (n, d) [m].
        velocity: Velocities of the device's fingers, (n, d) [m/s].
        force: Forces on the operator that were displayed in the previous tick, (n, d) [N].
        age: Age of the last host sample that the loop has received [s].
        push_tank, squeeze_tank: Energies of the tanks [J]. If a tank is empty, the forces of its port are zero. If
            `host.tank` of the scene is 0, the tanks are not used.
        lost, late: Number of the host's samples that were lost, and number of those that arrived after a newer sample.
    """

    time: float
    position: FloatArray
    velocity: FloatArray
    force: FloatArray
    age: float
    push_tank: float
    squeeze_tank: float
    lost: int
    late: int

    @property
    def centre(self) -> FloatArray:
        """Mean position of the fingers (d,) [m], the position of the operator's hand."""
        return np.asarray(self.position.mean(axis=0))

    @property
    def aperture(self) -> float:
        """Twice the mean distance of the fingers from their centre [m]; for two fingers, the distance between them."""
        return float(2.0 * np.sqrt(((self.position - self.centre) ** 2).sum(axis=1)).mean())


class HostLink:
    """Link from a host program to the loop of the scene with this `host.name`; a context manager.

    At the end of the `with` block, also after an exception, the link reports to the loop that the host has ended, and
    all forces fade to zero.

    Args:
        name: Name of the record, `host.name` of the scene.
        timeout: Time to wait for the loop [s].

    Attributes:
        fingers: Number n of the device's fingers.
        dimensions: Number of dimensions d.

    Raises:
        DeviceError: If no loop with this name runs, or if the record of the loop has another version.
        InputError: If `timeout` is not a number.
    """

    def __init__(self, name: str, *, timeout: float = 10.0) -> None:
        self.name, end = name, monotonic() + single("timeout", timeout, "a time [s]")
        while (words := find_record(name)) is None:
            if monotonic() >= end:
                raise DeviceError(
                    f"no loop with host.name {name!r} runs: start its scene first, `graspfx run SCENE --real-time`"
                )
            sleep(LOOK)
        self._words: Any = words.data  # items are Python floats
        self.fingers, self.dimensions = int(words[FINGERS]), int(words[DIMENSIONS])
        first, size = int(words[HOST_FIRST]), int(words[HOST_SIZE])
        self._slots = [words[first + size * k :][:size] for k in range(SLOTS)]
        first, size = int(words[LOOP_FIRST]), int(words[LOOP_SIZE])
        self._told = [words[first + size * k :][:size] for k in range(SLOTS)]
        self._sample, self._number = np.zeros(int(words[HOST_SIZE])), int(words[HOST_NUMBER])
        self._head: Any = self._sample.data
        m = self.fingers * self.dimensions
        shape = (self.fingers, self.dimensions)
        self._ahead: float | None = None  # offset of the loop's clock from the host's [s]
        self._shape = (3, *shape)
        self._external = self._sample[SAMPLE : SAMPLE + m].reshape(shape)
        self._internal = self._sample[SAMPLE + m : SAMPLE + 2 * m].reshape(shape)
        self._origin = self._sample[SAMPLE + 2 * m : SAMPLE + 3 * m].reshape(shape)

    def read(self, time: float | None = None) -> Operator:
        """Read the state of the operator.

        Args:
            time: Time on the host's clock [s]. The call waits until the loop has reached this time; the clocks of host
                and loop are aligned at the first call with a time. If None, the call does not wait.

        Raises:
            DeviceError: If the loop has ended, has a fault, or writes no samples.
        """
        if time is not None:
            self._wait(time)
        self._require_running()
        for _ in range(TRIES):
            number = self._words[LOOP_NUMBER]
            slot = self._told[int(number) % SLOTS].copy()
            numbers = slot.tolist()
            check = numbers.pop()
            if numbers[0] == number and sum(numbers) == check and number:
                where, speed, force = slot[LOOP_SAMPLE:-1].reshape(self._shape)
                self._origin[:] = where
                _, time_, age, push, squeeze, lost, late = numbers[:LOOP_SAMPLE]
                return Operator(time_, where, speed, force, age, push, squeeze, int(lost), int(late))
            sleep(LOOK)
        raise DeviceError(f"host.name {self.name!r}: the loop writes no samples")

    def _wait(self, time: float) -> None:
        """Wait until the loop has reached a time on the host's clock [s]."""
        if self._ahead is None:
            self._ahead = self.read().time - time
        end, last = monotonic() + DEAD, -1.0
        while (now := self.read().time - self._ahead) < time:
            if now > last:
                end, last = monotonic() + DEAD, now
            elif monotonic() > end:
                raise DeviceError(
                    f"host.name {self.name!r}: the loop has written nothing for {DEAD:g} s; it was killed"
                )
            sleep(min(time - now, LOOK))

    def show(self, shown: Shown, time: float) -> None:
        """Display forces to the operator.

        A device with one finger displays the push. If `shown` has forces of two fingers, a device with two fingers
        displays these forces; otherwise it displays the push and the grip. A device with more fingers displays each
        finger's force; fingers without a counterpart in `shown` get zero force.

        Args:
            shown: Result of `Feedback.update` for the operator's state that the last `read` returned.
            time: Time on the host's clock [s].

        Raises:
            DeviceError: If the loop has ended, or has a fault.
            InputError: If the number of dimensions differs from the device's, or if the device has more than two
                fingers and `shown` has more fingers than the device.
        """
        external, internal = self._external, self._internal
        n, count = self.fingers, len(shown.external)
        if shown.push.shape != (self.dimensions,):
            raise InputError("shown", shown.push.shape, f"a push of {self.dimensions} coordinates, like the device's")
        if n == 1:
            external[0], internal[0] = shown.push, 0.0
        elif count == n:
            external[:], internal[:] = shown.external, shown.internal
        elif n == 2:
            between = self._origin[1] - self._origin[0]
            size = float(np.sqrt(between @ between))
            along = between / size if size > 0.0 else 0.0 * between
            external[:] = 0.5 * shown.push
            internal[0], internal[1] = shown.grip * along, -shown.grip * along
        elif count < n:  # the number of contacts so far
            external[:], internal[:] = 0.0, 0.0
            external[:count], internal[:count] = shown.external, shown.internal
        else:
            raise InputError("shown.fingers", count, f"forces on at most {n} fingers, the number of the device")
        self._require_running()
        self._write(time, 0.0)

    def stop(self) -> None:
        """Report to the loop that the host has ended."""
        if self._words[STATE] == RUNNING:
            self._sample[SAMPLE:] = 0.0
            self._write(self._head[1], float(HOST_ENDED))

    def _write(self, time: float, code: float) -> None:
        self._number += 1
        self._head[0], self._head[1], self._head[2] = self._number, time, code
        self._head[-1] = total(self._sample)
        self._slots[self._number % SLOTS][:] = self._sample
        self._words[HOST_NUMBER] = self._number

    def _require_running(self) -> None:
        if self._words[STATE] != RUNNING:
            how = "has ended" if self._words[STATE] == 2.0 else "has stopped with a fault, see the messages of its run"
            raise DeviceError(f"host.name {self.name!r}: the loop {how}; all forces are zero")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()
