"""Pushes on the bench: pulses that show how late a force is and what it moves, and runs that show what brakes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from graspfx.analysis.push_response import (
    GROUPS,
    Estimate,
    Push,
    Response,
    drag_matrix,
    friction_of,
    response,
)
from graspfx.assembly.calibration.calibration_bench import Bench, Sample
from graspfx.errors import DeviceError
from graspfx.numeric import SMALLEST

FloatArray = NDArray[np.float64]

UNTOLD = 1e-5  # resolution of a device that tells none, for the length of a push [m]
SEEN = 4.0  # steps of the encoder that are a motion
STEPS = 60.0  # of a pulse
LONGEST_TRIAL = 0.15  # [s]
LONGEST_PULSE, SHORTEST_PULSE = 0.08, 6  # [s], and periods
MOST_SPEED = 0.1  # at the end of a pulse [m/s]
BEFORE = 0.04  # at rest before a pulse [s]
SPEED = 0.025  # of a coasting finger [m/s]
COAST, TRAVEL, LEAST = 0.35, 0.008, 20  # how long and how far it is let coast [s, m], for as many readings at least
LONGEST_START = 0.3  # to bring it to that speed [s]
NEAR, CALM = 2e-3, 0.02  # of home, and slower than that: a finger that is back [m, m/s]
RETURN = 12.0  # of the spring that leads it there, as a frequency [rad/s]
LONGEST_WAY = 1.0  # [s]
EXPLAINED = 0.9  # of the motion under pulses
MOST_DELAY = 0.02  # that is looked for [s], or three periods


@dataclass(frozen=True, eq=False)
class FingerFigures:
    """Figures of one finger.

    Attributes:
        delay, mass: of its response to pulses.
        friction: viscous [N s/m].
        mobility: W, (d, d) [1/kg].
        resolution: least step of a reading [m]; 0 where none was seen.
        pulses: how many.
        force: of a pulse [N].
    """

    delay: Estimate
    mass: Estimate
    friction: Estimate
    mobility: FloatArray
    resolution: float
    pulses: int
    force: float


def finger_figures(bench: Bench, channel: int, force: float, pulses: int) -> FingerFigures:
    """Push one finger to and fro along each axis, and let it coast.

    Args:
        bench: of its device.
        channel: of the finger.
        force: of a push [N].
        pulses: in all; ten along each axis at least.

    Raises:
        DeviceError: a finger that does not move, or a fault of the device.
    """
    d = bench.shape[1]
    own = bench.port.device.features.resolution
    step = own or UNTOLD
    accelerations = [_trial(bench, channel, axis, force, step) for axis in range(d)]
    coasts = [
        _coast(bench, channel, axis, sign * force, acceleration)
        for axis, acceleration in enumerate(accelerations)
        for sign in (1.0, -1.0) * max(1, min(2, pulses // (25 * d)))
    ]
    drag, others = drag_matrix(coasts)
    each = max(GROUPS, math.ceil(pulses / d))
    done = [
        _pulse(bench, channel, axis, force if k % 2 == 0 else -force, step, acceleration)
        for axis, acceleration in enumerate(accelerations)
        for k in range(each)
    ]
    answer: Response = response(done, max(float(np.trace(drag)) / d, 0.0), max(MOST_DELAY, 3.0 * bench.period))
    if answer.explained < EXPLAINED or not math.isfinite(answer.mass.value):
        raise DeviceError(
            f"{bench.port.name}: of its motion under pulses {answer.explained:.0%} is that of a mass that is pushed, "
            f"expected {EXPLAINED:.0%}; bring it to the middle of where it works, and let nothing touch it"
        )
    friction = friction_of(answer.mobility, drag, others)
    return FingerFigures(
        answer.delay, answer.mass, friction, answer.mobility, own or _least_step(bench, channel), len(done), force
    )


def _trial(bench: Bench, channel: int, axis: int, force: float, step: float) -> float:
    """Push until the finger has moved; give its acceleration [m/s^2]."""
    bench.rest(BEFORE)
    push = force * np.eye(bench.shape[1])[axis]
    first = last = bench.tick(channel, push)
    while last.start - first.end < LONGEST_TRIAL and _shift(first, last, channel, axis) <= 3.0 * SEEN * step:
        last = bench.tick(channel, push)
    took, shift = last.start - first.end, float((last.position - first.position)[channel, axis])
    _take_back(bench, channel, push, took)
    if abs(shift) <= SEEN * step:
        raise DeviceError(
            f"{bench.port.name} moved by {1e6 * abs(shift):.0f} um under {force:.3g} N in {1e3 * took:.0f} ms: let go "
            "of it, see that its motors are on, or take a larger force"
        )
    if shift < 0.0:
        raise DeviceError(f"{bench.port.name} goes against a force along axis {axis}: its motors turn the wrong way")
    _bring_home(bench, channel, force, force * took**2 / (2.0 * shift))
    return 2.0 * shift / took**2


def _take_back(bench: Bench, channel: int, push: FloatArray, duration: float) -> None:
    """Undo a push of so long: twice as long the other way, then once more as it was, so that it ends where it began."""
    began = bench.samples[-1].end
    while bench.samples[-1].end - began < 2.0 * duration:
        bench.tick(channel, -push)
    began = bench.samples[-1].end
    while bench.samples[-1].end - began < duration:
        bench.tick(channel, push)
    bench.tick()


def _shift(first: Sample, last: Sample, channel: int, axis: int) -> float:
    return abs(float((last.position - first.position)[channel, axis]))


def _pulse(bench: Bench, channel: int, axis: int, force: float, step: float, acceleration: float) -> Push:
    """Push, and take the motion back."""
    samples = bench.rest(BEFORE)
    duration = math.sqrt(2.0 * STEPS * step / acceleration)
    duration = min(max(duration, SHORTEST_PULSE * bench.period), LONGEST_PULSE, MOST_SPEED / acceleration)
    push = force * np.eye(bench.shape[1])[axis]
    first = bench.tick(channel, push)
    samples.append(first)
    while samples[-1].end - first.end < duration:
        samples.append(bench.tick(channel, push))
    samples.append(bench.tick(channel, -push))  # read before the push ends
    _take_back(bench, channel, push, samples[-1].end - first.end)
    _bring_home(bench, channel, abs(force), abs(force) / acceleration)
    fresh = [each for each in samples if each.is_fresh]
    time = np.array([each.start for each in fresh]) - first.end
    return Push(axis, force, time, np.array([each.position[channel] for each in fresh]))


def _bring_home(bench: Bench, channel: int, force: float, mass: float) -> None:
    """Lead a finger to where it was at first by a weak spring and damper of at most a force."""
    readings, home = bench.port.readings, bench.home[channel]
    began = bench.tick().start
    while bench.samples[-1].start - began < LONGEST_WAY:
        away, speed = readings.position[channel] - home, bench.velocity[channel]
        if np.linalg.norm(away) < NEAR and np.linalg.norm(speed) < CALM:
            break
        pull = -mass * RETURN * (RETURN * away + 2.0 * speed)
        size = float(np.linalg.norm(pull))
        bench.tick(channel, pull * min(1.0, force / max(size, SMALLEST)))
    bench.tick()


def _coast(
    bench: Bench, channel: int, axis: int, force: float, acceleration: float
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Bring a finger to speed and let go of it; times and positions without a force, (n,) and (n, d)."""
    duration = min(SPEED / acceleration, LONGEST_START)
    bench.rest(BEFORE)
    push = force * np.eye(bench.shape[1])[axis]
    first = bench.tick(channel, push)
    while bench.samples[-1].end - first.end < duration:
        bench.tick(channel, push)
    began = bench.tick()
    samples: list[Sample] = []
    while bench.samples[-1].start - began.start < COAST:
        last = bench.tick()
        if last.start - began.start > MOST_DELAY:
            samples.append(last)
        if float(np.linalg.norm((last.position - began.position)[channel])) > TRAVEL and len(samples) > LEAST:
            break
    _bring_home(bench, channel, abs(force), abs(force) / acceleration)
    fresh = [each for each in samples if each.is_fresh]
    return np.array([each.start for each in fresh]), np.array([each.position[channel] for each in fresh])


def _least_step(bench: Bench, channel: int) -> float:
    """Find the least step between two readings of a finger that were not the same."""
    positions = np.array([each.position[channel] for each in bench.samples])
    steps = [float(np.linalg.norm(b - a)) for a, b in pairwise(positions)]
    changes = [each for each in steps if each > 0.0]
    return min(changes, default=0.0)
