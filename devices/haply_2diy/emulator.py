"""An emulator of the Haply 2DIY: two motors, two encoders, frames without a checksum, and no watchdog."""

from __future__ import annotations

import math
import struct
from collections import deque
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from graspfx.testing.wire import Clock, SerialWire, WallClock, tip_force

FloatArray = NDArray[np.float64]

PATIENCE = 1.0  # time for which the board waits for the rest of a frame, with its motors on [s]
CLAMP = 0.123  # torque limit of a motor [N m]
HOME = 168.0, 12.0  # directions of the links at the motors, encoders 1 and 2 [deg]
RESET, SETUP, TORQUE = 0, 1, 2
STEP = 3.0  # rotation of `move` [deg]
MOST_FRAMES = 100_000  # largest number of frames stored


class DiyWire(SerialWire):
    """A 2DIY board with its five-bar linkage.

    The linkage is moved by `move` and `place`, and also by the torques if `inertia` is given. After a frame with a
    truncated payload, the board waits a second for the rest: the last torques persist, and all bytes received are
    interpreted as the rest of the frame. Only a frame of zero torques or a reset removes the torques.

    Args:
        links: Lengths of the links at the motors and of the links at the handle [m].
        distance: Distance between the motors [m].
        inertia: Moment of inertia of each link at a motor, including the parts that the link moves [kg m^2]. If given,
            torques move the links, and the encoders report integer counts. If None, torques do not move the links.
        friction: Viscous friction at each motor [N m s/rad].
        seed: Seed of the random damage to data.
        clock: Same as for `SerialWire`.

    Attributes:
        frames: Received frames of torques: time on the clock [s], and torques of motors 1 and 2 [N m].
    """

    limit = CLAMP
    checksum = False

    def __init__(
        self,
        *,
        links: tuple[float, float] = (0.07, 0.09),
        distance: float = 0.038,
        inertia: float | None = None,
        friction: float = 0.0,
        seed: int = 0,
        clock: Clock | None = None,
    ) -> None:
        self.links, self.distance, self.inertia, self.friction = links, distance, inertia, friction
        self._speed, self._step = np.zeros(2), 0.0  # speeds [rad/s], and size of a count [deg]
        self._moved = (clock or WallClock()).now()  # time up to which torques have moved the links [s]
        self.frames: deque[tuple[float, tuple[float, float]]] = deque(maxlen=MOST_FRAMES)
        self._angles, self._offset = np.array(HOME), np.zeros(2)
        self._torque: FloatArray = np.zeros(2)  # torques of motors 1 and 2, at ports 2 and 1
        self._identity: int | None = None
        self._buffer, self._began = b"", 0.0
        super().__init__(seed, clock)

    @property
    def torque(self) -> FloatArray:
        return self._torque.copy()

    @property
    def position(self) -> FloatArray:
        return self._place(np.radians(self._angles))[None, :]

    @property
    def force(self) -> FloatArray:
        return tip_force(self._place, np.radians(self._angles), self._torque)[None, :]

    def move(self) -> None:
        """Turn both links inwards by 3 degrees, which moves the handle away from the motors."""
        self.place(np.array(HOME) + np.array([-STEP, STEP]))

    def home(self) -> None:
        self.place(np.array(HOME))

    def place(self, angles: FloatArray) -> None:
        """Place the links at the motors in these directions (2,) [deg]."""
        self._angles = np.array(angles, dtype=float)

    def _place(self, angles: FloatArray) -> FloatArray:
        """Return the handle's position (2,) [m], where the outer links meet on the side away from the motors."""
        inner, outer = self.links
        tips = inner * np.array([np.cos(angles), np.sin(angles)]).T + [
            [-self.distance / 2, 0.0],
            [self.distance / 2, 0.0],
        ]
        middle, across = tips.mean(axis=0), tips[1] - tips[0]
        height = math.sqrt(outer**2 - 0.25 * across @ across)
        away = np.array([-across[1], across[0]]) / math.hypot(*across)
        handle: FloatArray = middle + height * away
        return handle

    def receive(self, data: bytes) -> Iterator[bytes]:
        if not self._buffer:
            self._began = self.clock.now()
        self._buffer += data
        while (size := self._size()) and len(self._buffer) >= size:
            frame, self._buffer = self._buffer[:size], self._buffer[size:]
            self._began = self.clock.now()
            yield from self._act(frame)

    def _move_on(self) -> None:
        """Advance the links' angles a to the present time, exactly: inertia a'' + friction a' = torque."""
        now = self.clock.now()
        passed, self._moved = now - self._moved, now
        if self.inertia is None or passed <= 0.0:
            return
        p = self.friction / self.inertia
        slow = -math.expm1(-p * passed) / p if p * passed > 1e-9 else passed
        push = self._torque / self.inertia
        glide = (passed - slow) / p if p * passed > 1e-6 else 0.5 * passed * passed
        self._angles = self._angles + np.degrees(slow * self._speed + glide * push)
        self._speed = self._speed * (1.0 - p * slow) + slow * push

    def tick(self) -> None:
        self._move_on()
        if self._buffer and self.clock.now() - self._began > PATIENCE:
            self._buffer = b""  # discard the received part of the frame

    def _encoders(self) -> FloatArray:
        """Return the angles that the encoders report (2,) [deg]."""
        if self._step == 0.0:
            return self._angles + self._offset
        angles: FloatArray = np.round(self._angles / self._step) * self._step + self._offset
        return angles

    def _size(self) -> int:
        """Return the size of the frame at the start of the buffer [bytes]; a single byte is treated as a frame."""
        if len(self._buffer) < 2:
            return len(self._buffer)
        command, identity = self._buffer[:2]
        if command == TORQUE and identity == self._identity:
            return 10
        if command == SETUP:
            return 26
        return 2  # a reset, or an unknown command

    def _act(self, frame: bytes) -> Iterator[bytes]:
        if len(frame) < 2:
            return
        self._move_on()
        if frame[0] == SETUP:
            self._identity = frame[1]
            second, _, first, counts = struct.unpack_from("<4f", frame, 10)  # ascending ports: encoder 2 is at port 1
            self._step = 360.0 / counts if self.inertia is not None and counts > 0.0 else 0.0
            self._offset = np.array([first, second]) - self._angles  # the board assumes that the handle is at home
        elif frame[0] == RESET and frame[1] == self._identity:
            self._torque = np.zeros(2)
        elif frame[0] == TORQUE and frame[1] == self._identity:
            second, first = struct.unpack_from("<2f", frame, 2)
            wished = np.nan_to_num(np.array([first, second], dtype=float), posinf=CLAMP, neginf=-CLAMP)
            self._torque = np.clip(wished, -CLAMP, CLAMP)
            self.frames.append((self.clock.now(), (float(self._torque[0]), float(self._torque[1]))))
            first, second = self._encoders()
            yield struct.pack("<B2f", frame[1], second, first)
