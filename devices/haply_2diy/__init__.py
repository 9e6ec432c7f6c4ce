"""The Haply 2DIY, open hardware: a planar five-bar linkage with two motors and two encoders, one finger.

The driver was written from the board's protocol, and tested only against an emulator (`graspfx.testing.wire.DiyWire`).

The board's firmware has **no watchdog: the last torques persist when the program dies**, and a truncated frame blocks
the board for up to a second with its motors on. A frame is therefore sent by one call. `stop`, `close` and the end of
`with` send zero torques, and `quench` removes the torques after a program has died. The protocol has no checksum: a
bit error that changes an angle by less than a link can turn in a sample remains undetected.

`open` writes the offsets into the encoders, so the handle must then be at its home position.
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

FIRMWARE_LIMIT = 0.123  # torque limit of a motor in the board's firmware [N m]
MOST_SAMPLES = 1_000_000  # largest window [samples]
TRIES = 10  # attempts to send zero torques and receive an answer


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

    The origin is midway between the motors; x points to the right, y from the motors to the handle. The default links
    and distance are those of the third version; the second version has 0.05, 0.07 and 0.02 m.

    Args:
        port: Serial port, such as /dev/ttyACM0.
        links: Lengths of the links at the motors and of the links at the handle [m].
        distance: Distance between the motors [m].
        home: Directions of the links at the motors, encoders 1 and 2, for the handle's position at `open` [deg].
        counts: Counts of an encoder per revolution.
        torque_limit: Torque limit of a motor; the limit in the firmware is 0.123 [N m].
        margin: Smallest distance of the handle from the stretched posture [m].
        device: Number of the device on its line.
        timeout: Longest wait for an answer, after which the last sample is kept; less than the period [s].
        velocity_window: Longest window of the velocity estimate [samples].
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
    """Remove the torques from a board whose program has died: send zeros until it answers two successive frames.

    This needs no set-up, so that the offsets of the encoders are kept. A board that waits for the rest of a truncated
    frame interprets the first zeros as that rest, and so sets zero torques, too.

    Args:
        port, device: Same as for `connect`; other settings are ignored.

    Raises:
        DeviceError: If another program has the port, or the board does not answer, so that its torques may persist.
    """
    line = SerialPort(port)
    line.open()
    try:
        if _quiet(line, device):
            return
        line.sleep(BLOCKED + 0.05)  # after this time a board discards a truncated frame
        if _quiet(line, device):
            return
    finally:
        line.close()
    raise DeviceError(f"the board at {port} does not answer: disconnect its power, because its motors may be on")


def _quiet(line: SerialPort, device: int) -> bool:
    """Write zeros until two successive frames are answered; return whether they were."""
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
