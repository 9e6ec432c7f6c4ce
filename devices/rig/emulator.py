"""An emulator of the rig: the controller's firmware runs on this computer, with two simulated arms."""

from __future__ import annotations

import atexit
import ctypes
import os
import subprocess
from functools import cache
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.protocols import DeviceError
from graspfx.testing.wire import FAILURES, Clock, Plug, Wire, build, shared_page, tip_force

FloatArray = NDArray[np.float64]

AXES = 4
LIMIT = 0.06  # torque limit of a motor in the firmware [N m]
GEAR = 15.0
LINK = 0.128  # [m]
BASES = (-0.04, -0.18), (0.04, -0.18)  # [m]
HOME = 2.2752353, 0.7000749, 0.8663574, 2.4415177  # directions of the links with fingers at (-0.025, 0), (0.025, 0)
STEP = 0.05  # rotation of `move` [rad]
NEAR = 1e-5  # largest distance from the goal, and largest motion in 10 ms, of a link that has arrived [rad]
MOST = 1 << 16  # largest number of bytes read from the controller at once
PATIENCE = 5.0  # longest wait for the program to start or end, or to connect its port [s]


class Page(ctypes.Structure):
    """Memory shared with firmware/host.c: `struct page` there."""

    _fields_ = (
        ("rest", ctypes.c_double * AXES),
        ("stiffness", ctypes.c_double),
        ("damping", ctypes.c_double),
        ("slowness", ctypes.c_double),
        ("number", ctypes.c_double),
        ("angle", ctypes.c_double * AXES),
        ("speed", ctypes.c_double * AXES),
        ("quiet", ctypes.c_double),
        ("kind", ctypes.c_int32),
        ("health", ctypes.c_int32),
        ("torque", ctypes.c_int32 * AXES),
        ("enabled", ctypes.c_int32),
        ("state", ctypes.c_int32),
        ("fault", ctypes.c_int32),
        ("good", ctypes.c_int32),
        ("bad", ctypes.c_int32),
        ("plugs", ctypes.c_int32),
        ("port", ctypes.c_char * 64),
    )


@cache
def _built(name: str, *options: str) -> Path:
    """Build the emulator once per process, in a temporary folder."""
    folder = Path(mkdtemp(prefix="graspfx-rig-"))
    atexit.register(rmtree, folder, ignore_errors=True)
    return build([*options, "host.c", "rig.c", "-lm"], folder / name, Path(__file__).with_name("firmware"))


class RigWire(Wire):
    """The rig without hardware: rig.c compiled for this computer.

    Without `clock`, the emulator is a separate program with a port. With `clock`, the emulator is a library in this
    process, has no port, and advances only when `exchange` is called; only one such emulator can exist at a time.

    Simulated hands hold both fingers at home with springs and dampers at the joints. The failure "flip" damages frames
    in both directions, because all frames have a checksum.

    Args:
        stiffness: Stiffness of the hands at each joint [N m/rad].
        damping: Damping of the hands at each joint [N m s/rad].
        slowness: Factor by which the controller's clock runs slower; values above 1 extend the controller's watchdog
            for tests on a busy machine.
        clock: Clock of the controller; None for the system's clock.

    Raises:
        MissingPackageError: If there is no C compiler.
    """

    limit = LIMIT

    def __init__(
        self, *, stiffness: float = 40.0, damping: float = 0.3, slowness: float = 1.0, clock: Clock | None = None
    ) -> None:
        super().__init__(clock)
        self._plug = Plug()
        self._library: Any = None
        self._unread, self._ends = b"", tuple[int, ...]()
        self._program: subprocess.Popen[bytes] | None = None
        self.slowness = slowness
        try:
            path = self._plug.folder / "page"
            self.page = shared_page(Page, path)
            self.page.rest[:] = HOME
            self.page.stiffness, self.page.damping, self.page.slowness = stiffness, damping, slowness
            if clock is not None:
                self._library = ctypes.CDLL(str(_built("host.so", "-shared", "-fPIC")))
                self._ends = os.pipe()
                for end in self._ends:
                    os.set_blocking(end, False)
                self._library.host_begin(ctypes.byref(self.page), self._ends[1], ctypes.c_double(clock.now()))
                return
            self._program = subprocess.Popen([_built("host"), path], stdin=subprocess.PIPE)
            self._await_plug(0)
        except BaseException:
            self.close()
            raise

    def exchange(self, data: bytes = b"") -> bytes:
        """Pass bytes to the controller, advance it to the present time of `clock`, and return its pending output."""
        self._unread += data
        taken = b"" if self.failure == "blocked" else self._unread
        self._unread = self._unread[len(taken) :]
        memory = ctypes.create_string_buffer(taken, len(taken) + 1)
        self._library.host_turn(ctypes.c_double(self.clock.now()), memory, ctypes.c_size_t(len(taken)))
        try:
            return os.read(self._ends[0], MOST)
        except BlockingIOError:
            return b""

    @property
    def settings(self) -> dict[str, Any]:
        return {"port": self._plug.port}

    @property
    def torque(self) -> FloatArray:
        return 1e-6 * np.array(self.page.torque, dtype=float)

    @property
    def position(self) -> FloatArray:
        angles = np.array(self.page.angle)
        return np.array([self._place(i)(angles[2 * i : 2 * i + 2]) for i in range(2)])

    @property
    def force(self) -> FloatArray:
        angles, joints = np.array(self.page.angle), GEAR * self.torque
        pieces = [slice(0, 2), slice(2, 4)]
        return np.array([tip_force(self._place(i), angles[each], joints[each]) for i, each in enumerate(pieces)])

    @staticmethod
    def _place(arm: int) -> Any:
        return lambda a: np.array(BASES[arm]) + LINK * np.array([np.cos(a).sum(), np.sin(a).sum()])

    def move(self) -> None:
        """Move the hands so that the first link of each arm turns by 0.05 rad.

        If the controller is idle, wait up to 0.3 s until the arms have arrived.
        """
        self._bring(np.array(HOME) + STEP * np.array([1.0, 0.0, 1.0, 0.0]))

    def home(self) -> None:
        self._bring(np.array(HOME))

    def _bring(self, angles: FloatArray) -> None:
        self.page.rest[:] = angles.tolist()
        deadline = self.clock.now() + 0.3
        while self.clock.now() < deadline and self.page.state == 0 and not self._is_at(angles):
            self.clock.sleep(0.01)

    def _is_at(self, angles: FloatArray) -> bool:
        off, speed = np.array(self.page.angle) - angles, np.array(self.page.speed)
        return bool(np.abs(off).max() < NEAR and np.abs(speed).max() < NEAR / 0.01)

    def _change(self) -> None:
        plugs = self.page.plugs
        self.page.number = self.number
        self.page.kind = 0 if self.failure is None else 1 + FAILURES.index(self.failure)
        if self._library is not None:
            return
        if self.failure == "unplugged":
            self._plug.pull()
            self.clock.sleep(0.01)  # waits until the data are sent
        elif not self._plugged:
            self._await_plug(plugs)

    @property
    def _plugged(self) -> bool:
        return (self._plug.folder / "port").is_symlink()

    def _await_plug(self, plugs: int) -> None:
        deadline = self.clock.now() + PATIENCE
        while self.page.plugs == plugs:
            if self.clock.now() > deadline:
                raise DeviceError(f"the emulator of the rig has opened no port within {PATIENCE:g} s")
            self.clock.sleep(0.001)
        self._plug.lead(self.page.port.decode())

    def close(self) -> None:
        if self._program is not None:
            assert self._program.stdin is not None
            self._program.stdin.close()
            try:
                self._program.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                self._program.kill()
                self._program.wait()
            self._program = None
        for end in self._ends:
            os.close(end)
        self._ends = ()
        self._plug.remove()
