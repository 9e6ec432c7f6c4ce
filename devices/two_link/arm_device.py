"""A two-link arm as a device: kernels of a sample, a real arm with a board, and a simulated arm."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from graspfx.devices._device import Closing
from graspfx.devices._plant import PlantDevice, all_of, clear_line, delay_values
from graspfx.devices.two_link.arm import (
    Arm,
    Both,
    Links,
    Mechanics,
    Pair,
    Point,
    joint_angles,
    link_directions,
    links_at,
)
from graspfx.devices.two_link.arm_dynamics import ArmPlant
from graspfx.protocols import (
    WINDOW,
    Device,
    DeviceError,
    DevicePorts,
    Features,
    Floats,
    InputError,
    Many,
    Record,
    Table,
    VelocityEstimate,
    VelocityEstimator,
    estimate,
    estimate_size,
    floats,
    kernel,
    many,
    size_for,
    start_of,
    table,
    zeros,
)

FloatArray = NDArray[np.float64]


# The board ------------------------------------------------------------------------------------------------------------


class Board(Protocol):
    """Interface to two encoders and two motors; counts and torques refer to the motors' shafts, before the gears.

    If the hardware is lost, a method raises OSError or DeviceError, and the run stops with zero force.
    """

    def open(self, period: float) -> None:
        """Enable the motors at zero torque, and prepare to call `counts` and `torque` once every `period` seconds."""

    def counts(self) -> tuple[int, int]:
        """Return the counts of the two encoders, zero at the joint positions `zero`; the counts must not overflow."""
        ...

    def torque(self, first: float, second: float) -> None:
        """Set the torques of the two motors [N m], which are held until the next call."""

    def close(self) -> None:
        """Disable the motors and release the hardware."""


@runtime_checkable
class TimedBoard(Protocol):
    """A board that reports the time of its counts; for other boards, the time when `counts` returns is used."""

    @property
    def time(self) -> float:
        """Time of the last counts on any non-decreasing clock [s]; an unchanged time means that no counts are new."""
        ...


@dataclass(frozen=True)
class Wiring:
    """Encoders, gears and motors between the two joints and the board; each argument is a pair, one value per joint.

    Args:
        counts: Counts of the encoder per revolution of its motor.
        gear: Revolutions of the motor per revolution of the joint; negative if the joint turns the other way.
        zero: Joint position at zero counts [rad].
        torque_limit: Torque limit of the motor [N m].
    """

    counts: Pair
    gear: Pair
    zero: Pair
    torque_limit: Pair

    def __post_init__(self) -> None:
        if 0.0 in self.gear:
            raise InputError("gear", self.gear, "ratios other than zero")

    @property
    def step(self) -> Pair:
        """Angle of each joint per count [rad]."""
        return math.tau / (self.counts[0] * self.gear[0]), math.tau / (self.counts[1] * self.gear[1])


# The sample -----------------------------------------------------------------------------------------------------------


class ArmState(Record):
    """State of an arm as a device: geometry, encoder readings and motor torques."""

    base: Point  # [m]
    lengths: Both  # lengths of the links [m]
    zero: Both  # joint positions at zero counts [rad]
    step: Both  # rotation of a joint per count [rad]
    gear: Both
    torque_limit: Both  # torque limits of the motors [N m]
    low: float  # smallest and largest distance of the finger from the base [m]
    high: float
    bend: float  # sign of sin(a2 - a1)
    elbow: bool  # the second motor is at the elbow
    delay: int  # [samples]
    estimate_size: int  # size of a velocity estimate
    slot: int  # row of the delay line to fill next
    angles: Both  # directions of the links, read by the encoders of a simulated arm [rad]
    counts: Both  # counts of the encoders
    links: Links  # [m]
    position: Point  # position of the finger [m]
    velocity: Point  # [m/s]
    command: Point  # force to display [N]
    largest: float  # largest force at the finger in every direction [N]
    torque: Floats = floats("2")  # torques of the motors [N m]
    effort: Floats = floats("2")  # torques at the joints [N m]
    estimates: Many[VelocityEstimate] = many("2", "estimate_size")
    line: Table = table("delay + 1", "2")


STRUCTURE = [start_of(ArmState, name) for name in ("elbow", "delay", "estimate_size")]

# Codes of the kernels other than 0.
NO_COUNTS, OUT_OF_REACH, OTHER_ELBOW, ENDLESS_TORQUE = range(1, 5)


@kernel
def place(arm: ArmState, a1: float, a2: float) -> None:
    """Compute the links as vectors from their directions a1, a2 [rad]; J = dp/da is [[-y1, -y2], [x1, x2]]."""
    arm.links = links_at(arm.lengths, a1, a2)


@kernel
def limit_force(arm: ArmState) -> None:
    """Compute the largest force that the motors can display in every direction [N].

    This force is the smaller of the ratios of a joint's largest torque to the joint's lever arm.
    """
    x1, y1, x2, y2 = arm.links.x1, arm.links.y1, arm.links.x2, arm.links.y2
    second = math.sqrt(x2 * x2 + y2 * y2)
    if arm.elbow:
        x1, y1 = x1 + x2, y1 + y2
    first = math.sqrt(x1 * x1 + y1 * y1)
    most, gear = arm.torque_limit, arm.gear
    arm.largest = min(most.first * abs(gear.first) / first, most.second * abs(gear.second) / second)


@kernel
def follow(arm: ArmState) -> int:
    """Compute the finger's position and velocity from counts that were taken one period after the previous ones."""
    counts = arm.counts
    if not (math.isfinite(counts.first) and math.isfinite(counts.second)):
        return NO_COUNTS
    rate1 = estimate(arm.estimates[0], counts.first)
    rate2 = estimate(arm.estimates[1], counts.second)
    return turn(arm, rate1, rate2)


@kernel
def turn(arm: ArmState, rate1: float, rate2: float) -> int:
    """Compute the finger's position and velocity from the counts and their rates [1/s]."""
    counts, step, elbow = arm.counts, arm.step, arm.elbow
    q1, q2 = arm.zero.first + counts.first * step.first, arm.zero.second + counts.second * step.second
    a1, a2 = link_directions(elbow, q1, q2)
    w1, w2 = link_directions(elbow, rate1 * step.first, rate2 * step.second)
    place(arm, a1, a2)
    x1, y1, x2, y2 = arm.links.x1, arm.links.y1, arm.links.x2, arm.links.y2
    if not arm.low <= math.sqrt((x1 + x2) * (x1 + x2) + (y1 + y2) * (y1 + y2)) <= arm.high:
        return OUT_OF_REACH
    if (x1 * y2 - y1 * x2) * arm.bend <= 0.0:
        return OTHER_ELBOW
    if elbow:  # otherwise the lever arms are the links, of constant length
        limit_force(arm)
    arm.position = Point(arm.base.x + x1 + x2, arm.base.y + y1 + y2)
    arm.velocity = Point(-y1 * w1 - y2 * w2, x1 * w1 + x2 * w2)
    return 0


@kernel
def drive(arm: ArmState) -> int:
    """Compute the motors' torques J'f/gear for the commanded force f; if one exceeds its limit, scale both down."""
    links, force, gear = arm.links, arm.command, arm.gear
    first = links.x1 * force.y - links.y1 * force.x
    second = links.x2 * force.y - links.y2 * force.x
    if arm.elbow:
        first += second
    first /= gear.first
    second /= gear.second
    if not (math.isfinite(first) and math.isfinite(second)):
        return ENDLESS_TORQUE
    most = arm.torque_limit
    excess = max(abs(first) / most.first, abs(second) / most.second)
    if excess > 1.0:  # the division may round to just above the limit
        first = max(-most.first, min(most.first, first / excess))
        second = max(-most.second, min(most.second, second / excess))
    arm.torque[0] = first
    arm.torque[1] = second
    return 0


def count(x: float) -> float:
    """Round x to the integer that an encoder reports; infinities and NaN are unchanged."""
    if math.isfinite(x):
        return float(math.floor(x + 0.5))
    return x


@kernel
def read(arm: ArmState) -> int:
    """Convert the link directions of a simulated arm to counts, and compute position and velocity by `follow`."""
    q1, q2 = joint_angles(arm.elbow, arm.angles.first, arm.angles.second)
    zero, step = arm.zero, arm.step
    arm.counts = Both(count((q1 - zero.first) / step.first), count((q2 - zero.second) / step.second))
    return follow(arm)


@kernel
def write(arm: ArmState) -> int:
    """Compute the joint torques of a simulated arm, with the output delay; stop the arm if the command is faulty."""
    code = drive(arm)
    if code != 0:
        stop(arm)
        return code
    torque, gear = arm.torque, arm.gear
    if arm.delay > 0:
        arm.slot = delay_values(arm.line, arm.slot, arm.delay, torque)
    arm.effort[0] = torque[0] * gear.first
    arm.effort[1] = torque[1] * gear.second
    return 0


@kernel
def stop(arm: ArmState) -> int:
    """Set the joint torques and the delay line of a simulated arm to zero."""
    clear_line(arm.line, arm.delay, arm.effort)
    return 0


# The devices ----------------------------------------------------------------------------------------------------------


class TwoLinkArm(Closing):  # type: ignore[misc] # mypy does not see devices from inside the package
    """Convert counts to the finger's position, and forces to the motors' torques.

        q = zero + 2 pi counts/(counts per revolution x gear),   p = p(q),   v = J(q) q',   tau = J'(q) f / gear

    q are the joint angles, p and v the position and velocity of the finger, J = dp/dq, f the force and tau the torques
    of the motors; J' is a transpose. The rates q' are estimated from the counts with a noise bound of half a count.
    Torques beyond `torque_limit` are scaled by a common factor, which keeps the direction of the force. `read` raises
    DeviceError if the finger is outside the arm's reach or the elbow is on the wrong side.
    """

    declaration = ArmState

    def __init__(
        self, arm: Arm, wiring: Wiring, mechanics: Mechanics | None, velocity_window: int, delay: int | None
    ) -> None:
        self.arm, self.wiring, self.mechanics = arm, wiring, mechanics
        self._window, self._delay = velocity_window, delay
        each, late = estimate_size(velocity_window), delay or 0
        self.state: FloatArray = zeros(size_for(ArmState, delay=late, estimate_size=each))
        self._entries: Any = self.state.data  # plain floats, because access to items of an array takes twice as long
        block = self._block = ArmState(self._entries)
        block.base, block.lengths = Point(*arm.base), Both(*arm.links)
        block.zero, block.step, block.gear = Both(*wiring.zero), Both(*wiring.step), Both(*wiring.gear)
        block.torque_limit = Both(*wiring.torque_limit)
        (block.low, block.high), block.bend = arm.reach, arm.bend
        block.elbow, block.delay, block.estimate_size = arm.drive == "elbow", late, each
        place(block, *arm.angles(arm.base[0], arm.base[1] + math.hypot(*arm.links)))
        limit_force(block)
        pairs = [start_of(ArmState, name) for name in ("angles", "position", "velocity", "command", "effort")]
        arrays = [self.state[start : start + 2].reshape(1, 2) for start in pairs]
        self._sensed, self._position, self._velocity, self._command, self._effort = arrays
        self._estimator: VelocityEstimator | None = None  # only while the device is open

    @property
    def features(self) -> Features:
        """Features of the arm; mass, damping, resolution and peak force are those with the elbow at a right angle.

        Mass and damping are the geometric means of the principal effective values at the finger. The peak force is the
        largest force that the motors can display in every direction. The resolution is the largest displacement of the
        finger per count. The workspace is the box around the arm's reach.
        """
        a1, a2 = self.arm.angles(self.arm.base[0], self.arm.base[1] + math.hypot(*self.arm.links))
        by_joint = self.arm.jacobian(a1, a2)
        if self.arm.drive == "elbow":
            by_joint[:, 0] += by_joint[:, 1]
        lever = np.hypot(*by_joint)  # displacement of the tip per radian of each joint [m]
        base, far = np.array(self.arm.base), self.arm.reach[1]
        m = self.mechanics
        return Features(
            fingers=1,
            dimensions=2,
            workspace=(base - far, base + far),
            peak_force=float((np.array(self.wiring.torque_limit) * np.abs(self.wiring.gear) / lever).min()),
            mass=None if m is None else math.sqrt(np.linalg.det(m.effective_mass(a1, a2))),
            friction=None if m is None else math.sqrt(np.linalg.det(m.effective_friction(a1, a2))),
            resolution=float((np.abs(self.wiring.step) * lever).max()),
            delay=self._delay,
        )

    def nearest(self, finger: int, place: FloatArray, room: float) -> FloatArray:
        """Return the position (2,) nearest to `place` whose distance from the base is within the arm's reach [m].

        Args:
            finger: Index of the finger, 0.
            place: Position (2,) [m].
            room: Margin from the smallest and the largest reach, at most half of their difference [m].
        """
        base, (low, high) = np.array(self.arm.base), self.arm.reach
        room = min(room, 0.5 * (high - low))
        away = np.asarray(place, dtype=float) - base
        r = float(np.hypot(*away))
        if not r:
            away, r = np.array([0.0, 1.0]), 1.0
        size = min(max(r, low + room), high - room)
        nearest: FloatArray = base + away * (size / r)
        return nearest

    @property
    def largest_force(self) -> FloatArray:
        """Largest force that the motors can display in every direction at the last reading (1,) [N].

        With both motors at the base, this force equals the peak force everywhere.
        """
        start = start_of(ArmState, "largest")
        return self.state[start : start + 1]

    def effective_mass(self, position: Sequence[float]) -> FloatArray:
        """Return the effective mass (2, 2) [kg] of the arm with the finger at a position [m].

        Raises:
            InputError: If the masses and damping of the arm are unknown.
        """
        x, y = position
        mass: FloatArray = self._require_mechanics().effective_mass(*self.arm.angles(x, y))
        return mass

    def effective_friction(self, position: Sequence[float]) -> FloatArray:
        """Return the effective damping (2, 2) [N s/m] of the arm with the finger at a position [m].

        Raises:
            InputError: If the masses and damping of the arm are unknown.
        """
        x, y = position
        damping: FloatArray = self._require_mechanics().effective_friction(*self.arm.angles(x, y))
        return damping

    def open(self, period: float) -> None:
        memory = self.state[self._block.estimates.offset :]
        self._estimator = VelocityEstimator(period, (2,), 0.5, self._window, memory)

    def fault_text(self, code: int) -> str:
        """Return the error message for a code of a kernel, with values from the block."""
        counts, links, force = self._block.counts, self._block.links, self._block.command
        if code == NO_COUNTS:
            return (
                f"the arm's board returned the counts {counts.first:.17g}, {counts.second:.17g}: "
                "check encoders and cables"
            )
        if code == OUT_OF_REACH:
            return str(self.arm.reach_fault(links.x1 + links.x2, links.y1 + links.y2))
        if code == OTHER_ELBOW:
            return str(self.arm.elbow_fault)
        return (
            f"a force of ({force.x}, {force.y}) N is not finite and cannot be displayed: "
            "the arm's motors are at zero torque"
        )

    def _take(self, forces: FloatArray) -> None:
        self._opened()
        if np.shape(forces) != (1, 2):
            raise InputError("forces", forces, "an array of shape (1, 2): one finger in the plane")
        self._command[...] = forces

    def _opened(self) -> VelocityEstimator:
        if self._estimator is None:
            raise DeviceError("the arm is not open: call open(period) first")
        return self._estimator

    def _require_mechanics(self) -> Mechanics:
        if self.mechanics is None:
            raise InputError(
                "mechanics",
                None,
                "a device with known masses and damping",
                "give link_masses to joint_damping, all five",
            )
        return self.mechanics


class TwoLink(TwoLinkArm):
    """A real arm, whose board reads the encoders and drives the motors."""

    def __init__(
        self,
        arm: Arm,
        wiring: Wiring,
        board: Board,
        *,
        mechanics: Mechanics | None = None,
        velocity_window: int = WINDOW,
    ) -> None:
        super().__init__(arm, wiring, mechanics, velocity_window, None)
        self.board = board
        self._raw: NDArray[np.int64] = np.zeros(2, dtype=np.int64)

    def open(self, period: float) -> None:
        super().open(period)
        try:
            self.board.open(period)
        except OSError as error:
            self._estimator = None
            raise DeviceError(f"the arm's board cannot be opened: {error}") from error
        self._began, self._time = time.perf_counter(), -math.inf

    @property
    def raw(self) -> NDArray[np.int64]:
        """Counts of the two encoders at the last reading (2,)."""
        return self._raw

    def read(self) -> tuple[FloatArray, FloatArray, float]:
        """Return position (1, 2) [m], velocity (1, 2) [m/s] and time [s].

        If the time of the counts has not changed, the last sample is returned again.
        """
        estimator = self._opened()
        try:
            counts = self.board.counts()
        except OSError as error:
            raise DeviceError(f"the arm's board returns no counts: {error}") from error
        own = self.board.time if isinstance(self.board, TimedBoard) else None
        now = time.perf_counter() - self._began if own is None else own
        if now != self._time:
            self._take_counts(estimator, counts, now)
        return self._position, self._velocity, now

    def _take_counts(self, estimator: VelocityEstimator, counts: tuple[int, int], now: float) -> None:
        if not (math.isfinite(counts[0]) and math.isfinite(counts[1])):
            self._block.counts = Both(*counts)
            raise DeviceError(self.fault_text(NO_COUNTS))
        rates = estimator.update(counts, now)
        self._time, self._block.counts = now, Both(*counts)
        self._raw[...] = counts
        code = turn(self._block, float(rates[0]), float(rates[1]))
        if code:
            raise DeviceError(self.fault_text(code))

    def write(self, forces: FloatArray) -> None:
        self._take(forces)
        code = drive(self._block)
        if code:
            self.stop()
            raise DeviceError(self.fault_text(code))
        self._send(self._block.torque[0], self._block.torque[1])

    def stop(self) -> None:
        if self._estimator is not None:
            self._send(0.0, 0.0)

    def close(self) -> None:
        if self._estimator is None:
            return
        self._estimator = None
        with suppress(OSError, DeviceError):  # the hardware may be disconnected
            self.board.torque(0.0, 0.0)
        with suppress(OSError, DeviceError):
            self.board.close()

    def _send(self, first: float, second: float) -> None:
        try:
            self.board.torque(first, second)
        except OSError as error:
            raise DeviceError(f"the arm's board accepts no torques: {error}") from error


class SimulatedTwoLink(TwoLinkArm, PlantDevice):  # type: ignore[misc] # mypy does not see devices from inside the package
    """An arm simulated together with its board: counts are rounded, and torques act after `delay` samples.

    The kernels `reading` and `writing` run once per sample on the block `state`.
    """

    reading = staticmethod(read)
    writing = staticmethod(write)
    stopping = staticmethod(stop)
    ports = DevicePorts(
        sensed=start_of(ArmState, "angles"),
        position=start_of(ArmState, "position"),
        velocity=start_of(ArmState, "velocity"),
        command=start_of(ArmState, "command"),
        effort=start_of(ArmState, "effort"),
    )

    def __init__(self, arm: Arm, wiring: Wiring, mechanics: Mechanics, velocity_window: int, delay: int) -> None:
        super().__init__(arm, wiring, mechanics, velocity_window, delay)
        lengths = [start_of(VelocityEstimate, "length") + estimate.offset for estimate in self._block.estimates]
        self.structure = np.array([*STRUCTURE, *lengths])
        self._wire(ArmPlant([mechanics]), 0)  # stationary, until the arm is connected to another plant

    @staticmethod
    def plant(devices: Sequence[Device]) -> ArmPlant:
        """Create the plant that moves the arms of the devices and the hand that holds their tips."""
        arms = all_of(SimulatedTwoLink, devices, "simulated two-link arm")
        plant = ArmPlant([device._require_mechanics() for device in arms])
        for i, device in enumerate(arms):
            device._wire(plant, i)
        return plant

    def open(self, period: float) -> None:
        super().open(period)
        self._begin()

    def _wire(self, plant: ArmPlant, i: int) -> None:
        """Connect the encoders to the plant's arm i."""
        self._connect(plant, plant.sensed(i))
