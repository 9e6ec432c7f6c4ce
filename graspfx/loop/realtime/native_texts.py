"""Faults of a loop without Python in words: those of `Readings` and of the pacer, by the figures in its memories."""

from __future__ import annotations

import numpy as np

from graspfx.loop.device_calls import FRESH, REPEAT, Calls
from graspfx.loop.device_exchange import ZERO, DevicePort
from graspfx.loop.realtime import native_port as at
from graspfx.loop.realtime.native_clock import ClockState
from graspfx.loop.realtime.native_port import PortState
from graspfx.loop.realtime.pacing import late_text
from graspfx.loop.realtime.readings import far_text, fast_text, number_text, stale_text, zeros_text

ACTIONS = {at.NO_ASK: "cannot be asked", at.NO_READ: "cannot be read", at.NO_WRITE: "cannot be written"}


def port_text(port: DevicePort, state: PortState, calls: Calls, why: int) -> str:
    """Say why a device is a fault."""
    if why in ACTIONS:
        return f"{port.name} {ACTIONS[why]}: {call_text(port, calls, state.code)}; {ZERO}"
    return f"{port.name} {_text(state, why)}; {ZERO}"


def stop_text(port: DevicePort, state: PortState, calls: Calls) -> str:
    """Say that a device cannot be stopped."""
    return (
        f"{port.name} cannot be stopped, and may keep its force: switch it off: "
        f"{call_text(port, calls, state.stop_code)}; {ZERO}"
    )


def call_text(port: DevicePort, calls: Calls, code: int) -> str:
    """Say what the code of a failure means: by the device's `fault_text`, by the adapter's, or as it is."""
    if code > 0:
        return f"its C function returned {code}, expected {FRESH} (new sample), {REPEAT} (none) or less than 0 (fault)"
    for owner in (port.device, calls.keep):
        text = getattr(owner, "fault_text", None)
        if callable(text):
            return str(text(code))
    return f"its C function returned {code}"


def clock_text(clock: ClockState) -> str:
    """Say that ticks came too late for hardware."""
    return late_text(clock.fatal, clock.period, clock.most)


def _text(state: PortState, why: int) -> str:
    if why == at.NOT_FINITE:
        raw = state.array(PortState.raw).reshape(2, state.fingers, state.dimensions)
        return f"gave {number_text(raw)}: numbers that are not finite"
    if why == at.FORCE:
        forces = state.array(PortState.forces).reshape(state.fingers, state.dimensions)
        return f"is to display {np.array(forces).tolist()} N, which is not finite"
    if why == at.STALE:
        return stale_text(state.code)
    if why == at.FAST:
        return fast_text(state.figure, state.bound)
    if why == at.ZEROS:
        return zeros_text(state.figure)
    return far_text(state.figure, state.bound, state.speed, state.code, state.period)
