"""Checks on the bench that take a person, without any force: where a device has its zero, where its axes lead."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.calibration.calibration_bench import Bench
from graspfx.loop.device_frame import Frame

FloatArray = NDArray[np.float64]

PATIENCE = 20.0  # for a person [s]
PUSH = 0.01  # that is asked for [m]
CLEAR = 0.8  # of a motion that is along one axis
STILL = 5e-4  # within which a finger stands still [m]
LONG_ENOUGH = 1.0  # for so long [s]
AWAY = 2e-3  # that it was moved at all [m]
WAYS = {
    1: ("to the right",),
    2: ("to the right", "up, or away from you"),
    3: ("to the right", "away from you", "up"),
}  # of the axes of a scene, by its dimensions

Prompt = Callable[[str], None]


def axis_checks(bench: Bench, channel: int, finger: str, frame: Frame | None, prompt: Prompt) -> dict[str, str]:
    """Have a person push a finger along each axis of the scene; say of each axis what came of it."""
    answers = {}
    bench.watched = False
    for axis in range(bench.shape[1]):
        prompt(f"push {finger} {WAYS[bench.shape[1]][axis]}, by two centimetres: that is to be +{'xyz'[axis]}")
        start = _placed(bench, channel, frame)
        shift = np.zeros_like(start)
        for _ in range(round(PATIENCE / bench.period)):
            bench.tick()
            shift = _placed(bench, channel, frame) - start
            if float(np.linalg.norm(shift)) > PUSH:
                break
        answers["xyz"[axis]] = _answer(shift, axis)
        prompt(f"  {answers['xyz'[axis]]}")
    return answers


def _answer(shift: FloatArray, axis: int) -> str:
    size = float(np.linalg.norm(shift))
    if size <= PUSH:
        return "not checked: nobody pushed"
    most = int(np.argmax(np.abs(shift)))
    if abs(float(shift[most])) < CLEAR * size:
        return "not clear: it went between two axes; push again along one"
    sign = "+" if shift[most] > 0.0 else "-"
    if (most, sign) == (axis, "+"):
        return f"right: it went to +{'xyz'[axis]}"
    return f"WRONG: it went to {sign}{'xyz'[most]}; put that right with frame.axes"


def zero_check(bench: Bench, channel: int, finger: str, frame: Frame | None, prompt: Prompt) -> FloatArray | None:
    """Have a person put a finger at the scene's origin; give where it was read, (d,) [m], or None without anybody."""
    bench.watched = False
    prompt(f"put {finger} where the scene's origin is to be, and hold it there for {LONG_ENOUGH:g} s")
    start = _placed(bench, channel, frame)
    there, since, is_away = start, 0, False
    for _ in range(round(PATIENCE / bench.period)):
        bench.tick()
        now = _placed(bench, channel, frame)
        is_away = is_away or float(np.linalg.norm(now - start)) > AWAY
        if float(np.linalg.norm(now - there)) > STILL:
            there, since = now, 0
        since += 1
        if is_away and since * bench.period >= LONG_ENOUGH:
            prompt(f"  read at {np.round(1e3 * now, 2).tolist()} mm")
            return now
    prompt("  not checked: nobody moved it")
    return None


def _placed(bench: Bench, channel: int, frame: Frame | None) -> FloatArray:
    """Give where a finger is in the scene, (d,) [m]."""
    own = bench.port.readings.position
    placed: FloatArray = (own if frame is None else frame.place(own))[channel].copy()
    return placed
