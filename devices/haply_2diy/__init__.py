"""The Haply 2DIY, open hardware: two motors and two encoders on a planar five-bar linkage, one finger.

Tested against an emulator only (`graspfx.testing.wire.DiyWire`); written from the facts of its line.

Its firmware has **no watchdog: the last torques stay when the program dies**, and a frame that is cut blocks the board
for up to a second with its motors on. A frame is sent by one call, zero torques on `stop`, `close` and at the end of
`with`, and `quench` takes the torques away when a program has died. Nothing on the line is checked: a bit that changes
an angle by less than a link can turn in a sample is not seen.

`open` writes the offsets into the encoders, so that the handle must stand at home then.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from graspfx.devices._settings import number, pair, port_name, whole
from graspfx.devices.haply_2diy.diy_device import BLOCKED, Haply2Diy
from graspfx.devices.haply_2diy.diy_frames import ANGLES, angles_in, torque_frame
from graspfx.devices.haply_2diy.five_bar import FiveBar
from graspfx.protocols import LARGEST, SMALLEST, WINDOW, DeviceError, InputError, SerialPort

__all__ = ["Haply2Diy", "connect", "quench"]

FIRMWARE_LIMIT = 0.123  # of a motor, clamped by the board [N m]
MOST_SAMPLES = 1_000_000  # of a window
TRIES = 10  # to have zeros answered


def connect(
    *,
    port: str,
    links: Sequence[float] = (0.07, 0.09),
    distance: float = 0.038,
    home: Sequence[float] = (168.0, 12.0),
    counts: float = 4880,
    torque_limit: float = 0.1,
    margin: float = 0.01,
    device: int = 5,
    timeout: float = 0.002,
    velocity_window: int = WINDOW,
) -> Haply2Diy:
    """Connect a 2DIY.

    The origin is midway between the motors, x to the right, y away from them to the handle. Links and distance of the
    third version are the defaults; the second has 0.05, 0.07 and 0.02 m.

    Args:
        port: its serial port, such as /dev/ttyACM0.
        links: at the motors, and from those to the handle [m].
        distance: between the motors [m].
        home: directions of the links at the motors, encoders 1 and 2, where the handle stands at `open` [deg].
        counts: of an encoder for a revolution.
        torque_limit: of a motor; the firmware's own is 0.123 [N m].
        margin: how near to the stretched posture the handle may come [m].
        device: number of the device on its line.
        timeout: until an answer is given up and the last sample stands; less than the period [s].
        velocity_window: the longest window of the velocity estimate [samples].
    """
    inner, outer = pair("links", links, SMALLEST)
    first, second = pair("home", home, -LARGEST)
    linkage = FiveBar((inner, outer), number("distance", distance, 0.0), number("margin", margin, SMALLEST))
    try:
        linkage.handle(math.radians(first), math.radians(second))
    except DeviceError as error:
        raise InputError("home", (first, second), "angles at which the links meet", str(error)) from error
    return Haply2Diy(
        SerialPort(port_name(port)),
        linkage,
        device=whole("device", device, 0, 255),
        home=(first, second),
        counts=number("counts", counts, SMALLEST),
        torque_limit=number("torque_limit", torque_limit, SMALLEST, FIRMWARE_LIMIT),
        velocity_window=whole("velocity_window", velocity_window, 1, MOST_SAMPLES),
        timeout=number("timeout", timeout, SMALLEST),
    )


def quench(*, port: str, device: int = 5, **_: object) -> None:
    """Take the torques from a board whose program has died: zeros until it answers to two frames in a row.

    It works without a set-up, so that the encoders' offsets stay. A board that waits for the rest of a frame that was
    cut takes the first zeros for it, which are torques of nothing too.

    Args:
        port, device: as of `connect`; other settings do not matter.

    Raises:
        DeviceError: another program has the port, or the board does not answer, so that its torques may still be there.
    """
    line = SerialPort(port)
    line.open()
    try:
        if _quiet(line, device):
            return
        line.sleep(BLOCKED + 0.05)  # a board that takes frames for the rest of others begins afresh after that
        if _quiet(line, device):
            return
    finally:
        line.close()
    raise DeviceError(f"the board at {port} does not answer: take its power away, its motors may be on")


def _quiet(line: SerialPort, device: int) -> bool:
    """Write zeros until two in a row are answered; tell whether they were."""
    answers = 0
    for _ in range(TRIES):
        line.flush()
        line.send(torque_frame(device, 0.0, 0.0))
        data, until = b"", line.now() + 0.02
        while len(data) < ANGLES.size and (part := line.receive(until)):
            data += part
        answers = answers + 1 if angles_in(data, device) is not None else 0
        if answers == 2:
            return True
    return False
