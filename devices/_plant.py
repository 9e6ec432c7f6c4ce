"""Common parts of simulated devices: plants held by a hand, sensors that read a plant, and output delays."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from graspfx.devices._device import Closing
from graspfx.protocols import (
    DeviceError,
    DevicePorts,
    Floats,
    FusedHand,
    Hand,
    InputError,
    Kernel,
    Ports,
    Record,
    Table,
    VelocityEstimator,
    floats,
    is_still,
    kernel,
    size_for,
    start_of,
    zeros,
)

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]
Pair = tuple[FloatArray, FloatArray]
D = TypeVar("D")

NOT_FINITE = 1  # code of a kernel whose inputs are not finite


class PlantState(Record):
    """First fields of the block of every plant of n fingers in d dimensions; arrays are (n, d), one row per finger.

    In a plant that needs the target in the middle of a sample, the fields `middle` and `middle_rate` follow.
    """

    fingers: int  # n
    dimensions: int  # d
    period: float  # sampling period T [s]
    since: float  # time at which `ticks` was zero [s]
    ticks: float
    still: bool  # the targets are constant
    position: Floats = floats("fingers * dimensions")  # [m]
    velocity: Floats = floats("fingers * dimensions")  # [m/s]
    effort: Floats = floats("fingers * dimensions")  # effort u, held over the sample [N, or N m at joints]
    start: Floats = floats("fingers * dimensions")  # target r of the hand at the beginning of the sample [m]
    start_rate: Floats = floats("fingers * dimensions")  # rate of the target at the beginning of the sample [m/s]
    end: Floats = floats("fingers * dimensions")  # target at the end of the sample [m]
    end_rate: Floats = floats("fingers * dimensions")  # rate of the target at the end of the sample [m/s]


PERIOD, SINCE, TICKS, STILL = (start_of(PlantState, name) for name in ("period", "since", "ticks", "still"))
ARRAYS = "position", "velocity", "effort", "start", "start_rate", "end", "end_rate"


class HeldPlant(ABC):
    """Fingers held by a hand and moved by a kernel, which works on the block `state`.

    The block contains a copy of the hand's gains, which is renewed if `stiffness` or `damping` of the hand is another
    array.

    Args:
        kind: Record that declares the plant's block.
        fingers: Number of fingers n.
        dimensions: Number of dimensions d.
        whole: Further integers on which the size of the block depends, by name.
    """

    kernel: Kernel  # advances the block by one sample; returns 0, or a code for `fault_text`

    def __init__(self, kind: type[PlantState], fingers: int, dimensions: int, **whole: int) -> None:
        shape, step = (fingers, dimensions), fingers * dimensions
        self.declaration = kind
        self.state: FloatArray = zeros(size_for(kind, fingers=fingers, dimensions=dimensions, **whole))
        block = kind(self.state)
        block.fingers, block.dimensions = shape
        names = ARRAYS + (("middle", "middle_rate") if hasattr(block, "middle") else ())
        starts = {name: getattr(block, name).offset for name in names}
        arrays = {name: self.state[start : start + step].reshape(shape) for name, start in starts.items()}
        self.ports = Ports(
            effort=starts["effort"],
            middle=starts.get("middle"),
            end=starts["end"],
            position=starts["position"],
            velocity=starts["velocity"],
        )
        self.position: FloatArray = arrays["position"]
        self.velocity: FloatArray = arrays["velocity"]
        self._effort = arrays["effort"]
        self._start, self._end = (arrays["start"], arrays["start_rate"]), (arrays["end"], arrays["end_rate"])
        self._middle = (arrays["middle"], arrays["middle_rate"]) if "middle" in arrays else None
        self._entries: Any = self.state.data  # plain floats, because access to items of an array takes twice as long
        self._coupled_hand: tuple[Hand, FloatArray, FloatArray] | None = None  # hand of the last `hold`, and its gains
        self._targets: tuple[FusedHand, Any, FloatArray, FloatArray] | None = None  # block and targets of the hand
        self.placed = 0  # number of calls of `place`; when it changes, a device resets its velocity estimate

    @property
    def time(self) -> float:
        """Time since `place` [s]: time of the last change of the period T, plus T times the samples since then."""
        S = self._entries
        now: float = S[SINCE] + S[TICKS] * S[PERIOD]
        return now

    def place(self, position: FloatArray) -> None:
        """Place the fingertips at positions (n, d) [m] with zero velocity, and set the time to zero.

        Raises:
            DeviceError: If a position is out of reach.
        """
        p = np.asarray(position, dtype=np.float64)
        if p.shape != self.position.shape or not np.isfinite(p).all():
            raise InputError("position", position, f"finite positions of shape {self.position.shape} [m]")
        self._put(p)
        self.position[...] = p
        self.velocity[...] = 0.0
        self._entries[SINCE] = self._entries[TICKS] = 0.0
        self._coupled_hand = None
        self.placed += 1

    def hold(self, hand: Hand, T: float) -> None:
        """Write the gains of the hand, the hand's targets at the plant's time, and the period T [s] into the block."""
        K, B, S = hand.stiffness, hand.damping, self._entries
        n, d = self.position.shape
        if not (math.isfinite(T) and T > 0.0):
            raise InputError("T", T, "a finite time above zero [s]")
        for name, gain in (("hand.stiffness", K), ("hand.damping", B)):
            if gain.shape != (d, n, n) or not np.isfinite(gain).all():
                raise InputError(name, gain, f"finite gains of shape {(d, n, n)}, for {n} fingers in {d} dimensions")
        now = self.time
        self._grip(K, B, T)
        if S[PERIOD] != T:
            S[SINCE], S[TICKS], S[PERIOD] = now, 0.0, T
        self._targets = None
        if isinstance(hand, FusedHand):
            r, v = (hand.state[at : at + n * d].reshape(n, d) for at in hand.ports)
            self._targets = hand, hand.state.data, r, v
        S[STILL] = float(is_still(hand))
        self._aim(hand, now, self._start)
        self._coupled_hand = hand, K, B

    def advance(self, force: FloatArray, hand: Hand, T: float) -> None:
        """Advance by a sample of T seconds, with the hand's forces, and with efforts (n, d) held over the sample.

        Raises:
            DeviceError: If the kernel returns a code other than 0.
        """
        if force.shape != self._effort.shape:
            raise InputError("force", force, f"an array of shape {self._effort.shape}")
        S, coupled = self._entries, self._coupled_hand
        if (
            coupled is None
            or hand is not coupled[0]
            or hand.stiffness is not coupled[1]
            or hand.damping is not coupled[2]
            or S[PERIOD] != T
        ):
            self.hold(hand, T)
        ends = S[SINCE] + (S[TICKS] + 1.0) * T
        if self._middle is not None:
            self._aim(hand, 0.5 * (self.time + ends), self._middle)
        self._aim(hand, ends, self._end)
        self._effort[...] = force
        code = self.kernel(S, 0)
        if code:
            raise DeviceError(self.fault_text(code))

    def _aim(self, hand: Hand, time: float, at: Pair) -> None:
        """Write the positions and velocities that the hand intends at a time [s] into the arrays `at`."""
        if self._targets is None:
            at[0][...], at[1][...] = hand.target(time)
            return
        fused, S, r, v = self._targets
        fused.kernel(S, 0, time)
        at[0][...] = r
        at[1][...] = v

    def fault_text(self, code: int) -> str:
        """Return the error message for a code of the kernel."""
        return "efforts or the hand's targets are not finite, so a simulated plant cannot move"

    @property
    @abstractmethod
    def structure(self) -> Index:
        """Indices in the block of the integers and booleans that select the computation; constant after `hold`."""

    @abstractmethod
    def _put(self, position: FloatArray) -> None:
        """Set internal states for positions (n, d) [m]; if out of reach, raise DeviceError and change nothing."""

    @abstractmethod
    def _grip(self, K: FloatArray, B: FloatArray, T: float) -> None:
        """Write the hand's gains K and B (d, n, n) into the block, and the quantities that depend on K, B and T."""


@kernel
def unfit(inputs: Floats, rows: int, columns: int) -> int:
    """Return NOT_FINITE if any of the first rows * columns inputs is not finite, else 0.

    Each row has a separate sum, so that the processor can compute several sums at the same time.
    """
    nothing = 0.0
    for row in range(rows):
        part = 0.0
        for i in range(row * columns, (row + 1) * columns):
            part += 0.0 * inputs[i]
        nothing += part
    return 0 if nothing == 0.0 else NOT_FINITE


# Devices --------------------------------------------------------------------------------------------------------------


class PlantDevice(Closing):  # type: ignore[misc] # mypy does not see devices from inside the package
    """A simulated device whose sensors read a plant; the device's kernels run once per sample on the block `state`.

    Attributes:
        sensed: Indices of the entries of the plant's block that the sensors measure; empty without a plant.
    """

    reading: Kernel
    writing: Kernel
    stopping: Kernel
    ports: DevicePorts
    state: FloatArray
    _entries: Any  # `state` as plain floats, because access to items of an array takes twice as long
    _estimator: VelocityEstimator | None  # only while the device is open
    _sensed: FloatArray  # arrays (k, d) in `state`
    _position: FloatArray
    _velocity: FloatArray
    _effort: FloatArray
    _true: FloatArray  # values in the plant's block that the sensors measure
    _plant: HeldPlant | None = None
    _seen = (-1, 0.0)  # `placed` and `time` of the plant at the last reading
    _fault = 0  # fault code of the last reading
    sensed: Index = np.zeros(0, dtype=np.intp)

    @property
    def effort(self) -> FloatArray:
        """Efforts of the actuators (k, d), held until the next sample [N, or N m at joints]; read-only."""
        return self._effort

    def read(self) -> tuple[FloatArray, FloatArray, float]:
        """Return positions (k, d) [m], velocities (k, d) [m/s] and the plant's time [s].

        Calls within the same sample of the plant return the same values.
        """
        estimator, plant = self._opened(), self._plant
        if plant is None:
            kind = type(self).__name__
            raise DeviceError(f"this simulated device has no plant to read: create one with {kind}.plant([device])")
        now = plant.placed, plant.time
        if now != self._seen:
            if now[0] != self._seen[0]:
                estimator.reset()
            self._seen = now
            self._sensed[...] = self._true
            self._fault = self.reading(self._entries, 0)
        if self._fault:
            raise DeviceError(self.fault_text(self._fault))
        return self._position, self._velocity, plant.time

    def write(self, forces: FloatArray) -> None:
        """Display forces (k, d) [N] after the device's output delay; scale down a force above the device's limit.

        If a force is not finite, stop the device, clear the delay line and raise DeviceError.
        """
        self._take(forces)
        code = self.writing(self._entries, 0)
        if code:
            raise DeviceError(self.fault_text(code))

    def stop(self) -> None:
        self.stopping(self._entries, 0)

    def close(self) -> None:
        self.stop()
        self._estimator = None

    @abstractmethod
    def fault_text(self, code: int) -> str:
        """Return the error message for a code of a kernel, with values from the block."""

    @abstractmethod
    def _opened(self) -> VelocityEstimator:
        """Return the velocity estimator; raise DeviceError if the device is not open."""

    @abstractmethod
    def _take(self, forces: FloatArray) -> None:
        """Check forces (k, d) [N], and write them into the block as the command."""

    def _begin(self) -> None:
        """Set zero effort, and let the next reading reset the velocity estimate."""
        self._seen = (-1, 0.0)
        self.stop()

    def _connect(self, plant: HeldPlant, first: int) -> None:
        """Connect the sensors to the entries of the plant's block that begin at index `first`."""
        last = first + self._sensed.size
        self._plant, self.sensed, self._seen = plant, np.arange(first, last), (-1, 0.0)
        self._true = plant.state[first:last].reshape(self._sensed.shape)


def all_of(kind: type[D], devices: Sequence[object], name: str) -> list[D]:
    """Return the devices; raise InputError if there are none or one is not of `kind`, called `name` in the message."""
    found = [device for device in devices if isinstance(device, kind)]
    if not found or len(found) < len(devices):
        kinds = [type(device).__name__ for device in devices]
        raise InputError("devices", kinds, f"at least one {name}, and no other device")
    return found


@kernel
def delay_values(line: Table, slot: int, delay: int, values: Floats) -> int:
    """Store values in row `slot` of a delay line, and replace the values by those stored `delay` calls before.

    The line has delay + 1 rows. Returns the row for the next call.
    """
    for j in range(line.columns):
        line[slot, j] = values[j]
    slot += 1
    if slot > delay:
        slot = 0
    for j in range(line.columns):
        values[j] = line[slot, j]
    return slot


@kernel
def clear_line(line: Table, delay: int, values: Floats) -> None:
    """Set the values and the delay line to zero."""
    for row in range(delay + 1):
        for j in range(line.columns):
            line[row, j] = 0.0
    for j in range(line.columns):
        values[j] = 0.0
