"""One sample of a real or simulated two-link arm: finger motion from counts, and torques from forces."""

from __future__ import annotations

import math

from graspfx.devices._late import clear_line, delay_values
from graspfx.devices.two_link.arm import Both, Links, Point, joint_angles, link_directions, links_at
from graspfx.protocols import (
    Floats,
    Many,
    Record,
    Table,
    VelocityEstimate,
    estimate,
    floats,
    kernel,
    many,
    start_of,
    table,
)


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
    counts: Both
    links: Links  # [m]
    position: Point  # position of the finger [m]
    velocity: Point  # [m/s]
    command: Point  # [N]
    largest: float  # largest force at the finger in every direction [N]
    torque: Floats = floats("2")  # torques of the motors [N m]
    effort: Floats = floats("2")  # torques at the joints [N m]
    estimates: Many[VelocityEstimate] = many("2", "estimate_size")
    line: Table = table("delay + 1", "2")


STRUCTURE = [start_of(ArmState, name) for name in ("elbow", "delay", "estimate_size")]

# Codes of the kernels besides 0.
NO_COUNTS, OUT_OF_REACH, OTHER_ELBOW, ENDLESS_TORQUE = range(1, 5)


@kernel
def place(arm: ArmState, a1: float, a2: float) -> None:
    """Compute the links as vectors; the Jacobian with respect to their directions is [[-y1, -y2], [x1, x2]]."""
    arm.links = links_at(arm.lengths, a1, a2)


@kernel
def limit_force(arm: ArmState) -> None:
    """Compute the largest force reached in every direction: the smaller ratio of torque limit to lever arm."""
    x1, y1, x2, y2 = arm.links.x1, arm.links.y1, arm.links.x2, arm.links.y2
    second = math.sqrt(x2 * x2 + y2 * y2)
    if arm.elbow:
        x1, y1 = x1 + x2, y1 + y2
    first = math.sqrt(x1 * x1 + y1 * y1)
    most, gear = arm.torque_limit, arm.gear
    arm.largest = min(most.first * abs(gear.first) / first, most.second * abs(gear.second) / second)


@kernel
def follow(arm: ArmState) -> int:
    """Compute the finger's position and velocity from counts one period after the last counts."""
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
    """Compute the motors' torques from the command, J'f through the gears, scaled together to the limits."""
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
    """Return the integer that an encoder reports."""
    if math.isfinite(x):
        return float(math.floor(x + 0.5))
    return x


@kernel
def read(arm: ArmState) -> int:
    """Convert the sensed directions of a simulated arm to counts; then continue as `follow`."""
    q1, q2 = joint_angles(arm.elbow, arm.angles.first, arm.angles.second)
    zero, step = arm.zero, arm.step
    arm.counts = Both(count((q1 - zero.first) / step.first), count((q2 - zero.second) / step.second))
    return follow(arm)


@kernel
def write(arm: ArmState) -> int:
    """Drive a simulated arm through the delay line and the gears; stop it at a fault."""
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
    """Set the torques of a simulated arm and its delay line to zero."""
    clear_line(arm.line, arm.delay, arm.effort)
    return 0
