"""Rows of a plan about devices: safety chain, servo loop, delayed forces, and moments that are not displayed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.build import build
from graspfx.assembly.device_limits import chain_table
from graspfx.assembly.process.quenching import quenchers
from graspfx.assembly.resolve import Parts, late_wires
from graspfx.errors import InputError
from graspfx.loop.device import SimulatedDevice
from graspfx.loop.realtime.lifecycle import loop_text, why_python
from graspfx.loop.safety.chain import SafetyLimits
from graspfx.loop.safety.trust import DECAY
from graspfx.loop.servo_parts import DeviceWiring
from graspfx.scene.model import Scene
from graspfx.system.child_process import is_possible

Row = tuple[str, bool, str]
FloatArray = NDArray[np.float64]

BACK = "; a limited force generates energy, which passivity = 'control' removes"


def safety_rows(parts: Parts) -> Iterator[Row]:
    """Yield the steps of the safety chain in order."""
    limits, table = parts.safety, chain_table(parts.scene, parts.wires)
    if limits is None or table is None:
        yield "safety", False, "no [safety]: only the law and the devices' own limits bound the forces"
        return
    usual = "default values, because hardware and hosts always have a chain; " if parts.scene.safety is None else ""
    why = "a non-finite force becomes zero, with a fault; the object receives the limited forces"
    yield "safety", True, f"{usual}{why}"
    yield _soft_start(limits)
    fused = parts.simulated
    decay = f"forces decay in {1e3 * DECAY:g} ms, then a fault"
    why = f"after {limits.hold} consecutive samples without a new reading {decay}"
    yield "stale readings", True, f"{why}{'; simulated readings are always new' if fused else ''}"
    yield "tank", True, "energy budget of a soft start under load, and of stiffer gains during a session"
    yield _each(
        "rate", limits.rate, "N/s of growth; decrease is not limited", BACK, "growth is not limited: no safety.rate"
    )
    yield _workspace(limits)
    yield _each("over speed", limits.speed, f"m/s, beyond which {decay}", "", "speed is not limited: no safety.speed")
    yield _each("clamp", limits.force, "N, applied last, after limits and passivity", "", "")
    if fused:
        yield "watchdog", False, "simulated time is never late"
    else:
        late = 5.0 * parts.scene.period if table.watchdog is None else table.watchdog
        yield "watchdog", True, f"of a loop in real time: {1e3 * late:g} ms late, then forces decay"


def _soft_start(limits: SafetyLimits) -> Row:
    if limits.soft_start == 0.0:
        return "soft start", False, "soft_start = 0: stiffness and damping have their values from the first tick"
    why = "so that the first force on fingers and objects is zero"
    return "soft start", True, f"stiffness and damping grow over {limits.soft_start:g} s, {why}"


def _each(step: str, values: FloatArray, unit: str, more: str, none: str) -> Row:
    """Return the row of a step that limits a quantity of each finger to a value; `none` is the text without limits."""
    if not np.isfinite(values).any():
        return step, False, none
    low, high = float(values.min()), float(values.max())
    text = f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
    return step, True, f"{text} {unit}{more}"


def _workspace(limits: SafetyLimits) -> Row:
    count = int((np.isfinite(limits.lower) | np.isfinite(limits.upper)).any(axis=1).sum())
    if not count:
        return "workspace", False, "no box: no device states one, and safety.workspace sets none"
    return "workspace", True, f"{count} of {len(limits.force)} fingers: no force pushes one out of its box"


def loop_rows(parts: Parts) -> Iterator[Row]:
    """Yield rows about the servo loop, its process, and how forces are removed if the process ends unexpectedly."""
    if not parts.hardware:
        return
    yield "loop", True, _loop(parts)
    if is_possible():
        yield "process", True, "with --real-time the servo has its own process; the recording process guards it"
    else:
        yield (
            "process",
            False,
            "this system has no processes with shared memory: the servo runs in the recording process",
        )
    try:
        devices = quenchers(parts)
    except InputError as error:
        yield "guard", False, f"refused with --real-time: {error}"
        return
    for each in devices:
        own = "" if each.watchdog is None else f"its watchdog removes the force within {each.watchdog:g} s"
        ours = "" if each.quench is None else "its driver's quench removes the force"
        yield "guard", True, f"{each.name}: if the process dies {' and '.join(text for text in (ours, own) if text)}"


def _loop(parts: Parts) -> str:
    """Return a description of the servo loop: which code and which thread run it, and why."""
    scene = parts.scene
    stations = [DeviceWiring(wire.device, wire.fingers, wire.fitting) for wire in parts.wires]
    why = why_python(stations, scene.finger_names, scene.engine, scene.period, None)
    if not why:
        with build(scene, real_time=True) as servo:
            why = servo.why_python
    return loop_text(why, stations)


def lateness_rows(parts: Parts) -> Iterator[Row]:
    """Yield a row for each device with delayed forces. The delay is the time from a motion to its force."""
    for wire, late in late_wires(parts):
        names = ", ".join(parts.scene.finger_names[i] for i in wire.used)
        share = late / parts.scene.period
        text = f"{names}: {1e3 * late:.3g} ms from a motion to the force, {share:.3g} samples, in the certificate"
        if isinstance(wire.device, SimulatedDevice):
            yield "lateness", False, f"{text}; a run refuses it, because simulated forces change only at samples"
        else:
            yield "lateness", True, f"{text}; half a sample of hold is added"


def moment_rows(scene: Scene) -> Iterator[Row]:
    """Yield a row about the torsion of soft fingers. Operators do not feel it, because devices display only forces."""
    soft = [finger for finger in scene.finger if finger.model == "soft"]
    if not soft:
        return
    coefficients = [mu for mu, finger in zip(scene.coefficients, scene.finger, strict=True) if finger.model == "soft"]
    levers = [1e3 * mu * (finger.patch or 0.0) for mu, finger in zip(coefficients, soft, strict=True)]
    low, high = float(np.min(levers)), float(np.max(levers))
    size = f"{high:.3g}" if low == high else f"{low:.3g} to {high:.3g}"
    bound = f", up to mu rho = {size} N mm per newton of normal force" if high > 0.0 else ", without a bound"
    text = f"torsion of {len(soft)} soft fingers{bound}: it acts on the object and is not displayed"
    yield "displayed moments", False, f"{text}; the column finger_moment records it"
