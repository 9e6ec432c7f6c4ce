"""A sample of a two-link arm on a flat block: counts to the finger's motion, force to torques; and their simulation."""

from __future__ import annotations

import math
from typing import Any

from graspfx.devices._late import cleared, delayed
from graspfx.devices.two_link.arm import directed, turned, vectors
from graspfx.loop.velocity import estimate

# The block. Two entries each, unless they are said to be others; of joints and motors, first and second.
BASE, LINKS = 0, 2  # [m]
ZERO, STEP = 4, 6  # [rad]
GEAR, MOST = 8, 10  # -, [N m]
LOW, HIGH = 12, 13  # one each: the reach [m]
BEND = 14  # one: the sign of sin(a2 - a1)
ELBOW = 15  # one: 1 if the second motor sits at the elbow
DELAY, ESTIMATE, SLOT = 16, 17, 18  # one each: ESTIMATE entries are the state of one velocity estimate
ANGLES = 19  # directions of the links, what the encoders of a simulated arm see [rad]
COUNTS = 21
VECTORS = 23  # 4: the links x1, y1, x2, y2 [m]
POSITION, VELOCITY, COMMAND = 27, 29, 31  # of the finger, [m], [m/s], [N]
TORQUE = 33  # of the motors [N m]
EFFORT = 35  # at the joints [N m]
LARGEST = 37  # one: the largest force at the finger in every direction [N]
STATES = 38  # of the velocity estimates; the delay line follows, (delay + 1, 2)
STRUCTURE = ELBOW, DELAY, ESTIMATE

# What the kernels give besides 0.
NO_COUNTS, OUT_OF_REACH, OTHER_ELBOW, ENDLESS_TORQUE = range(1, 5)


def place(S: Any, o: int, a1: float, a2: float) -> None:
    """The links as vectors: the Jacobian by their directions is [[-y1, -y2], [x1, x2]]."""
    x1, y1, x2, y2 = vectors(S[o + LINKS], S[o + LINKS + 1], a1, a2)
    S[o + VECTORS] = x1
    S[o + VECTORS + 1] = y1
    S[o + VECTORS + 2] = x2
    S[o + VECTORS + 3] = y2


def reach_torque(S: Any, o: int) -> None:
    """The largest force that the motors reach in every direction: a motor's torque over the longest lever."""
    x1, y1, x2, y2 = S[o + VECTORS], S[o + VECTORS + 1], S[o + VECTORS + 2], S[o + VECTORS + 3]
    second = math.sqrt(x2 * x2 + y2 * y2)
    if int(S[o + ELBOW]) == 1:
        x1, y1 = x1 + x2, y1 + y2
    first = math.sqrt(x1 * x1 + y1 * y1)
    S[o + LARGEST] = min(S[o + MOST] * abs(S[o + GEAR]) / first, S[o + MOST + 1] * abs(S[o + GEAR + 1]) / second)


def follow(S: Any, o: int) -> int:
    """The finger's position and velocity from the counts."""
    c1, c2 = S[o + COUNTS], S[o + COUNTS + 1]
    if not (math.isfinite(c1) and math.isfinite(c2)):
        return NO_COUNTS
    s1, s2, elbow = S[o + STEP], S[o + STEP + 1], int(S[o + ELBOW]) == 1
    rate1 = estimate(S, o + STATES, c1)
    rate2 = estimate(S, o + STATES + int(S[o + ESTIMATE]), c2)
    a1, a2 = directed(elbow, S[o + ZERO] + c1 * s1, S[o + ZERO + 1] + c2 * s2)
    w1, w2 = directed(elbow, rate1 * s1, rate2 * s2)
    place(S, o, a1, a2)
    x1, y1, x2, y2 = S[o + VECTORS], S[o + VECTORS + 1], S[o + VECTORS + 2], S[o + VECTORS + 3]
    if not S[o + LOW] <= math.sqrt((x1 + x2) * (x1 + x2) + (y1 + y2) * (y1 + y2)) <= S[o + HIGH]:
        return OUT_OF_REACH
    if (x1 * y2 - y1 * x2) * S[o + BEND] <= 0.0:
        return OTHER_ELBOW
    if int(S[o + ELBOW]) == 1:  # else the levers are the links, which stay as long as they are
        reach_torque(S, o)
    S[o + POSITION] = S[o + BASE] + x1 + x2
    S[o + POSITION + 1] = S[o + BASE + 1] + y1 + y2
    S[o + VELOCITY] = -y1 * w1 - y2 * w2
    S[o + VELOCITY + 1] = x1 * w1 + x2 * w2
    return 0


def drive(S: Any, o: int) -> int:
    """The motors' torques from the command, J'f through the gears, scaled down together to the limits."""
    x1, y1, x2, y2 = S[o + VECTORS], S[o + VECTORS + 1], S[o + VECTORS + 2], S[o + VECTORS + 3]
    fx, fy = S[o + COMMAND], S[o + COMMAND + 1]
    first, second = x1 * fy - y1 * fx, x2 * fy - y2 * fx
    if int(S[o + ELBOW]) == 1:
        first += second
    first /= S[o + GEAR]
    second /= S[o + GEAR + 1]
    if not (math.isfinite(first) and math.isfinite(second)):
        return ENDLESS_TORQUE
    most, next_most = S[o + MOST], S[o + MOST + 1]
    excess = max(abs(first) / most, abs(second) / next_most)
    if excess > 1.0:  # and the division may round to just above the limit
        first = max(-most, min(most, first / excess))
        second = max(-next_most, min(next_most, second / excess))
    S[o + TORQUE] = first
    S[o + TORQUE + 1] = second
    return 0


def count(x: float) -> float:
    """The whole number that an encoder shows."""
    if math.isfinite(x):
        return float(math.floor(x + 0.5))
    return x


def read(S: Any, o: int) -> int:
    """Of a simulated arm: the directions that are sensed, counted; then as `follow`."""
    q1, q2 = turned(int(S[o + ELBOW]) == 1, S[o + ANGLES], S[o + ANGLES + 1])
    S[o + COUNTS] = count((q1 - S[o + ZERO]) / S[o + STEP])
    S[o + COUNTS + 1] = count((q2 - S[o + ZERO + 1]) / S[o + STEP + 1])
    return follow(S, o)


def write(S: Any, o: int) -> int:
    """Of a simulated arm: as `drive`, then through the delay line and the gears to the joints; or it has stopped."""
    code = drive(S, o)
    if code:
        stop(S, o)
        return code
    delayed(S, o + SLOT, o + STATES + 2 * int(S[o + ESTIMATE]), int(S[o + DELAY]), o + TORQUE, 2)
    S[o + EFFORT] = S[o + TORQUE] * S[o + GEAR]
    S[o + EFFORT + 1] = S[o + TORQUE + 1] * S[o + GEAR + 1]
    return 0


def stop(S: Any, o: int) -> int:
    """Of a simulated arm: no torque now, and none on its way."""
    cleared(S, o + STATES + 2 * int(S[o + ESTIMATE]), int(S[o + DELAY]), o + EFFORT, 2)
    return 0
