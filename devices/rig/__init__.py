"""The rig, open hardware modelled on the paper's devices: two planar two-link arms, one finger each, on one controller.

The rig is a design that has not been built yet (docs/how-to/hardware.md). The driver is tested only against the rig's
firmware on a desktop computer: firmware/rig.c with firmware/host.c. If no torques arrive for 5 ms, the controller
removes the force within a further 20 ms. Arms, gears and encoders are those of `two-link`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.devices._device import Closing
from graspfx.devices._settings import number, port_name
from graspfx.devices.rig.controller import STILL, Controller, State
from graspfx.devices.two_link import TwoLink
from graspfx.devices.two_link import connect as two_link
from graspfx.protocols import SMALLEST, DeviceError, Features, InputError, SerialPort

__all__ = ["Rig", "connect", "quench"]

FloatArray = NDArray[np.float64]

OWN = ("base", "elbow", "zero")  # settings that may differ between arms
SILENCE = 20  # largest number of successive readings without an answer before the controller counts as lost
WATCHDOG = 0.005  # time of the controller's watchdog; a longer time without torques is a fault [s]
DECAY = 0.02  # time in which forces decay to zero after the watchdog has expired [s]
LONGEST = 0.0025  # longest period, because the watchdog must not expire between samples [s]
WRAP = 1 << 32  # range of the controller's clock [us]


class Half:
    """`Board` of one arm, which stores the last encoder reading and the next torques."""

    def __init__(self) -> None:
        self.reading, self.time = (0, 0), 0.0
        self.goal = (0.0, 0.0)

    def open(self, period: float) -> None:
        self.goal = (0.0, 0.0)

    def counts(self) -> tuple[int, int]:
        return self.reading

    def torque(self, first: float, second: float) -> None:
        self.goal = (first, second)

    def close(self) -> None:
        self.goal = (0.0, 0.0)


class Rig(Closing):  # type: ignore[misc] # mypy does not see devices from inside the package
    """One or two arms on one controller.

    In each sample, the driver sends POLL, receives the encoder counts in STATE, and sends the torques in RUN.
    Positions, velocities and torques are computed as for `two-link`, with times of the controller's clock. Without an
    answer, `read` returns the last sample and the time of this sample again.

    Args:
        controller: Controller, not yet open.
        arms: One or two arms.
        halves: Board of each arm.
    """

    def __init__(self, controller: Controller, arms: Sequence[TwoLink], halves: Sequence[Half]) -> None:
        self.controller, self.arms, self.halves = controller, tuple(arms), tuple(halves)
        shape = len(self.arms), 2
        self._position: FloatArray = np.zeros(shape)
        self._velocity: FloatArray = np.zeros(shape)
        self._raw: NDArray[np.int64] = np.zeros(1 + 2 * len(STILL), dtype=np.int64)
        self._period: float | None = None  # None unless the device is open

    @property
    def features(self) -> Features:
        """Features: smallest peak force and coarsest resolution of the arms, mass and damping of the first arm."""
        each = [arm.features for arm in self.arms]
        corners = [feature.workspace for feature in each]
        return Features(
            fingers=len(each),
            dimensions=2,
            workspace=(np.min([low for low, _ in corners], axis=0), np.max([high for _, high in corners], axis=0)),
            peak_force=min(feature.peak_force for feature in each),
            mass=each[0].mass,
            friction=each[0].friction,
            resolution=max(feature.resolution for feature in each),
            watchdog=WATCHDOG + DECAY,
        )

    @property
    def largest_force(self) -> FloatArray:
        """Largest force that each of the k arms can display in every direction at the last reading (k,) [N]."""
        return np.concatenate([arm.largest_force for arm in self.arms])

    @property
    def raw(self) -> NDArray[np.int64]:
        """Clock of the controller [us] modulo 2^32, then the counts and the rates [1/s] of its four encoders (9,)."""
        return self._raw

    def open(self, period: float) -> None:
        if not 0.0 < period <= LONGEST:
            raise InputError(
                "period",
                period,
                f"a period of at most {LONGEST:g} s",
                f"the rig's watchdog removes its force after {WATCHDOG:g} s",
            )
        self.close()
        state = self.controller.open(max(max(arm.wiring.torque_limit) for arm in self.arms), WATCHDOG)
        try:
            for arm in self.arms:
                arm.open(period)
            self._period, self._silent, self._time, self._clock = period, 0, 0.0, state.microseconds
            self._heard = self.controller.port.now()
            self._take(state)
        except DeviceError:
            self.close()
            raise

    def ask(self) -> None:
        self._opened()
        self.controller.ask()

    def read(self) -> tuple[FloatArray, FloatArray, float]:
        """Return positions (k, 2) [m], velocities (k, 2) [m/s] and the controller's time since `open` [s]."""
        period = self._opened()
        state = self.controller.answer()
        if state is None:
            self._silent += 1
            if self._silent > SILENCE and self.controller.port.now() - self._heard > SILENCE * period:
                self._abandon()
                text = f"did not answer {self._silent} readings in a row"
                raise DeviceError(f"the controller at {self.controller.port.path} {text}")
            return self._position, self._velocity, self._time
        step = (state.microseconds - self._clock) % WRAP
        if step >= WRAP // 2:
            self._abandon()
            back = 1e-6 * (WRAP - step)
            raise DeviceError(f"the clock of the controller at {self.controller.port.path} ran backwards by {back:g} s")
        since = 1e-6 * step
        self._clock, self._silent, self._heard = state.microseconds, 0, self.controller.port.now()
        self._time += since
        try:
            self._take(state)
        except DeviceError:  # a finger is out of reach
            self._abandon()
            raise
        return self._position, self._velocity, self._time

    def write(self, forces: FloatArray) -> None:
        self._opened()
        if np.shape(forces) != self._position.shape:
            raise InputError("forces", forces, f"an array of shape {self._position.shape}")
        try:
            for arm, force in zip(self.arms, forces, strict=True):
                arm.write(force[None, :])
        except DeviceError:  # a force is not finite: set zero torques for every arm
            self.stop()
            raise
        goals = [torque for half in self.halves for torque in half.goal]
        self.controller.run((*goals, *STILL)[: len(STILL)])

    def stop(self) -> None:
        for half in self.halves:
            half.goal = (0.0, 0.0)
        if self._period is not None:
            self.controller.run(STILL)

    def close(self) -> None:
        self._period = None
        self.controller.close()
        for arm in self.arms:
            arm.close()

    def _take(self, state: State) -> None:
        """Write the counts of an answer into the arms' boards, and read the arms."""
        self._raw[:] = (state.microseconds, *state.counts, *state.rates)
        for i, (arm, half) in enumerate(zip(self.arms, self.halves, strict=True)):
            half.reading, half.time = (state.counts[2 * i], state.counts[2 * i + 1]), self._time
            position, velocity, _ = arm.read()
            self._position[i], self._velocity[i] = position[0], velocity[0]

    def _abandon(self) -> None:
        with suppress(DeviceError):  # the hardware may be disconnected
            self.stop()

    def _opened(self) -> float:
        if self._period is None:
            raise DeviceError("the rig is not open: call open(period) first")
        return self._period


def connect(
    *,
    port: str,
    arms: Sequence[Mapping[str, Any]] = (
        {"base": (-0.04, -0.18), "elbow": "left"},
        {"base": (0.04, -0.18), "elbow": "right"},
    ),
    links: Sequence[float] = (0.128, 0.128),
    link_masses: Sequence[float] | None = None,
    link_inertias: Sequence[float] | None = None,
    link_centres: Sequence[float] | None = None,
    rotor_inertias: Sequence[float] | None = None,
    joint_damping: float | Sequence[float] | None = None,
    counts: float | Sequence[float] = 4000,
    gear: float | Sequence[float] = 15.0,
    torque_limit: float | Sequence[float] = 0.06,
    margin: float = 0.01,
    velocity_window: int = 16,
    timeout: float = 0.0005,
) -> Rig:
    """Connect the rig: channel 0 is the first arm, channel 1 the second.

    Settings that are not described here apply to both arms, and are those of `graspfx.devices.two_link.connect`.

    Args:
        port: Serial port of the controller, such as /dev/ttyACM0.
        arms: One or two tables, one for each arm, with the keys `base` [m] and `elbow`, and optionally `zero`, the
            directions of the links at zero counts [rad].
        timeout: Longest wait for an answer [s], less than the sampling period and at most 0.0025; after it the last
            sample is returned.
    """
    tables = _tables(arms)
    settings = {
        "links": links,
        "link_masses": link_masses,
        "link_inertias": link_inertias,
        "link_centres": link_centres,
        "rotor_inertias": rotor_inertias,
        "joint_damping": joint_damping,
        "counts": counts,
        "gear": gear,
        "torque_limit": torque_limit,
        "margin": margin,
        "velocity_window": velocity_window,
    }
    halves = [Half() for _ in tables]
    pair = []
    for arm, half in zip(tables, halves, strict=True):
        device = two_link(**settings, **arm, board=half)
        assert isinstance(device, TwoLink)
        pair.append(device)
    return Rig(Controller(SerialPort(port_name(port)), number("timeout", timeout, SMALLEST, LONGEST)), pair, halves)


def _tables(value: object) -> list[Mapping[str, Any]]:
    if isinstance(value, str | Mapping) or not isinstance(value, Sequence) or not 1 <= len(value) <= 2:
        raise InputError("arms", value, "one or two tables with base and elbow")
    for i, arm in enumerate(value):
        if not isinstance(arm, Mapping) or not set(arm) <= set(OWN):
            raise InputError(f"arms.{i}", arm, f"a table with {', '.join(OWN)}")
    return list(value)


def quench(*, port: str, **_: object) -> None:
    """Switch the motors off after a program has crashed, without waiting for the controller's watchdog.

    Args:
        port: Same as for `connect`; other settings are ignored.

    Raises:
        DeviceError: If another program has the port, or no controller answers.
    """
    controller = Controller(SerialPort(port), 0.0)
    try:
        controller.rest()
    finally:
        controller.close()
