"""A two-link arm as a device: counts to the finger's motion, forces to torques; the same before a simulated board."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Self

import numpy as np
from numpy.typing import NDArray

from graspfx.devices._arm import Arm, Mechanics
from graspfx.devices._board import Board, SimulatedBoard, Wiring
from graspfx.devices._dynamics import ArmPlant
from graspfx.errors import DeviceError, InputError
from graspfx.loop.device import Device, Features
from graspfx.loop.velocity import WINDOW, VelocityEstimator

FloatArray = NDArray[np.float64]


class TwoLink:
    """One arm behind a board: counts to the finger's position, force to the motors' torques.

        q = zero + 2 pi counts/(counts per revolution x gear),   p = p(q),   v = J(q) q',   tau = J'(q) f / gear

    q' comes from the counts by a VelocityEstimator with a noise bound of half a count. Torques beyond
    `torque_limit` are scaled down together, so that the force keeps its direction. A finger outside the arm's reach, or
    an elbow that has gone over to its other side, raises DeviceError at `read`.
    """

    def __init__(
        self,
        arm: Arm,
        wiring: Wiring,
        board: Board,
        *,
        mechanics: Mechanics | None = None,
        velocity_window: int = WINDOW,
        delay: int | None = None,
    ) -> None:
        self.arm, self.wiring, self.board, self.mechanics = arm, wiring, board, mechanics
        self._step = wiring.step
        self._window, self._delay = velocity_window, delay
        self._position, self._velocity = np.zeros((1, 2)), np.zeros((1, 2))
        self._counts = np.zeros(2)
        self._estimator: VelocityEstimator | None = None
        self._set_jacobian(*arm.angles(arm.base[0], arm.base[1] + math.hypot(*arm.links)))

    @property
    def features(self) -> Features:
        """Mass, friction, resolution and peak force are those at the right-angled elbow, wherever the arm points.

        Mass and friction are the geometric means of their principal values there; the peak force is the one that the
        motors reach in every direction, the resolution the longest step of the tip for one count. The workspace is the
        box around the arm's reach.
        """
        a1, a2 = self.arm.angles(self.arm.base[0], self.arm.base[1] + math.hypot(*self.arm.links))
        by_joint = self.arm.jacobian(a1, a2)
        if self.arm.drive == "elbow":
            by_joint[:, 0] += by_joint[:, 1]
        lever = np.hypot(*by_joint)  # how far the tip goes for a radian of each joint [m]
        base, far = np.array(self.arm.base), self.arm.reach[1]
        m = self.mechanics
        return Features(
            fingers=1,
            dimensions=2,
            workspace=(base - far, base + far),
            peak_force=float((np.array(self.wiring.torque_limit) * np.abs(self.wiring.gear) / lever).min()),
            mass=None if m is None else math.sqrt(np.linalg.det(m.effective_mass(a1, a2))),
            friction=None if m is None else math.sqrt(np.linalg.det(m.effective_friction(a1, a2))),
            resolution=float((np.abs(self._step) * lever).max()),
            delay=self._delay,
        )

    def effective_mass(self, position: Sequence[float]) -> FloatArray:
        """Lambda = (J M^-1 J')^-1, (2, 2) [kg], with the finger at a position [m]; needs the masses of the links."""
        x, y = position
        mass: FloatArray = self._known().effective_mass(*self.arm.angles(x, y))
        return mass

    def effective_friction(self, position: Sequence[float]) -> FloatArray:
        """J^-T D J^-1, (2, 2) [N s/m], with the finger at a position [m]; needs the joints' friction."""
        x, y = position
        friction: FloatArray = self._known().effective_friction(*self.arm.angles(x, y))
        return friction

    def open(self, period: float) -> None:
        self._estimator = VelocityEstimator(period, (2,), noise=0.5, window=self._window)
        try:
            self.board.open(period)
        except OSError as error:
            self._estimator = None
            raise DeviceError(f"the arm's board does not open: {error}") from error
        self._began = time.perf_counter()

    def read(self) -> tuple[FloatArray, FloatArray, float]:
        self._opened()
        try:
            first, second = self.board.counts()
        except OSError as error:
            raise DeviceError(f"the arm's board gives no counts: {error}") from error
        taken = self._clock()
        if not (math.isfinite(first) and math.isfinite(second)):
            raise DeviceError(f"the arm's board gives counts {first}, {second}: check encoders and cables")
        self._counts[0], self._counts[1] = first, second
        rate = self._count_rates()
        arm = self.arm
        a1, a2 = arm.directed(self.wiring.zero[0] + first * self._step[0], self.wiring.zero[1] + second * self._step[1])
        w1, w2 = arm.directed(float(rate[0]) * self._step[0], float(rate[1]) * self._step[1])
        x1, y1, x2, y2 = self._set_jacobian(a1, a2)
        arm.check_reach(x1 + x2, y1 + y2)
        arm.check_elbow(x1 * y2 - y1 * x2)
        self._position[0, 0], self._position[0, 1] = arm.base[0] + x1 + x2, arm.base[1] + y1 + y2
        self._velocity[0, 0], self._velocity[0, 1] = -y1 * w1 - y2 * w2, x1 * w1 + x2 * w2
        return self._position, self._velocity, taken

    def write(self, forces: FloatArray) -> None:
        self._opened()
        if forces.shape != (1, 2):
            raise InputError("forces", forces, "an array of shape (1, 2): one finger in the plane")
        fx, fy = float(forces[0, 0]), float(forces[0, 1])
        x1, y1, x2, y2 = self._links
        first, second = x1 * fy - y1 * fx, x2 * fy - y2 * fx
        if self.arm.drive == "elbow":
            first += second
        first, second = first / self.wiring.gear[0], second / self.wiring.gear[1]
        if not (math.isfinite(first) and math.isfinite(second)):
            self.stop()
            raise DeviceError(f"a force of ({fx}, {fy}) N cannot be displayed: the arm's motors are at zero torque")
        most, next_most = self.wiring.torque_limit
        excess = max(abs(first) / most, abs(second) / next_most)
        if excess > 1.0:  # and the division may round to just above the limit
            first = max(-most, min(most, first / excess))
            second = max(-next_most, min(next_most, second / excess))
        self._send(first, second)

    def stop(self) -> None:
        if self._estimator is not None:
            self._send(0.0, 0.0)

    def close(self) -> None:
        if self._estimator is None:
            return
        self._estimator = None
        with suppress(OSError, DeviceError):  # the hardware may be gone, and then nothing is left to tell it
            self.board.torque(0.0, 0.0)
        with suppress(OSError, DeviceError):
            self.board.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _send(self, first: float, second: float) -> None:
        try:
            self.board.torque(first, second)
        except OSError as error:
            raise DeviceError(f"the arm's board takes no torques: {error}") from error

    def _opened(self) -> VelocityEstimator:
        if self._estimator is None:
            raise DeviceError("the arm is not open: call open(period) first")
        return self._estimator

    def _known(self) -> Mechanics:
        if self.mechanics is None:
            raise InputError(
                "mechanics", None, "a device that knows its masses and friction", "give all five settings to connect"
            )
        return self.mechanics

    def _set_jacobian(self, a1: float, a2: float) -> tuple[float, float, float, float]:
        """The links as vectors x1, y1, x2, y2 [m]: the Jacobian by link directions is [[-y1, -y2], [x1, x2]]."""
        l1, l2 = self.arm.links
        self._links = l1 * math.cos(a1), l1 * math.sin(a1), l2 * math.cos(a2), l2 * math.sin(a2)
        return self._links

    def _count_rates(self) -> FloatArray:
        """Of the counts that have just come, (2,) [1/s]."""
        return self._opened().update(self._counts)

    def _clock(self) -> float:
        """When the counts that have just come were taken [s]."""
        return time.perf_counter() - self._began


class SimulatedTwoLink(TwoLink):
    """The same adapter before a simulated board: its time is counted in samples, and a plant moves it."""

    board: SimulatedBoard

    def open(self, period: float) -> None:
        super().open(period)
        self._seen = (-1, 0.0)  # placement and time of the last sample

    def stop(self) -> None:
        self.board.halt()

    @property
    def effort(self) -> FloatArray:
        """Torques at the joints until the next sample, (1, 2) [N m]."""
        effort: FloatArray = self.board.effort
        return effort

    @staticmethod
    def plant(devices: Sequence[Device]) -> ArmPlant:
        """The arms of these devices, moved together with the hand at their tips."""
        boards = [device.board for device in devices if isinstance(device, SimulatedTwoLink)]
        if not boards or len(boards) < len(devices):
            given = [type(device).__name__ for device in devices]
            raise InputError("devices", given, "one or more simulated two-link arms")
        plant = ArmPlant([board.mechanics for board in boards])
        for i, board in enumerate(boards):
            board.wire(plant, i)
        return plant

    def _count_rates(self) -> FloatArray:
        """Once per tick of the plant, and from the first position after `place`."""
        estimator = self._opened()
        now = self.board.plant.placed, self.board.plant.time
        if now != self._seen:
            if now[0] != self._seen[0]:
                estimator.reset()
            self._seen = now
            self._rates = estimator.update(self._counts)
        return self._rates

    def _clock(self) -> float:
        taken: float = self.board.plant.time
        return taken
