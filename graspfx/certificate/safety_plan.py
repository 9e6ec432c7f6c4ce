"""The safety chain in a scene's plan: what it does between law and devices, and what it skips."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from graspfx.build.resolve import Parts
from graspfx.build.safety_limits import chain_table
from graspfx.loop.safety.chain import SafetyLimits
from graspfx.loop.safety.trust import DECAY

Row = tuple[str, bool, str]
FloatArray = NDArray[np.float64]

BACK = "; makes energy where it bites, which passivity = 'control' takes back"


def safety_rows(parts: Parts) -> Iterator[Row]:
    """List the steps of the chain in their order."""
    limits, table = parts.safety, chain_table(parts.scene, parts.wires)
    if limits is None or table is None:
        yield "safety", False, "no [safety]: devices are told what the law and their own limits leave"
        return
    usual = "by the usual values, as hardware is never without; " if parts.scene.safety is None else ""
    why = "what is not finite gives no force and a fault; the object receives what comes out of this"
    yield "safety", True, f"{usual}{why}"
    yield _soft_start(limits)
    fused = parts.simulated
    decay = f"forces decay in {1e3 * DECAY:g} ms, then a fault"
    why = f"after {limits.hold} samples in a row without a new one {decay}"
    yield "stale readings", True, f"{why}{'; simulated ones are always new' if fused else ''}"
    yield "tank", True, "a soft start under load, and stiffer gains of a session, as far as its energy goes"
    yield _each("rate", limits.rate, "N/s of growth, towards zero unlimited", BACK, "any growth: no safety.rate")
    yield _workspace(limits)
    yield _each("over speed", limits.speed, f"m/s, beyond which {decay}", "", "any speed: no safety.speed")
    yield _each("clamp", limits.force, "N, last: what limits, brake and all before have left is no longer", "", "")
    if fused:
        yield "watchdog", False, "simulated time is never late"
    else:
        late = 5.0 * parts.scene.period if table.watchdog is None else table.watchdog
        yield "watchdog", True, f"of a loop in real time: {1e3 * late:g} ms late, then forces decay"


def _soft_start(limits: SafetyLimits) -> Row:
    if limits.soft_start == 0.0:
        return "soft start", False, "soft_start = 0: stiffness and damping are whole from the first tick on"
    why = "so that the first force is zero, on both sides"
    return "soft start", True, f"stiffness and damping grow over {limits.soft_start:g} s, {why}"


def _each(step: str, values: FloatArray, unit: str, more: str, none: str) -> Row:
    """Write a limit that fingers have, each its own, or why there is none."""
    if not np.isfinite(values).any():
        return step, False, none
    low, high = float(values.min()), float(values.max())
    text = f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
    return step, True, f"{text} {unit}{more}"


def _workspace(limits: SafetyLimits) -> Row:
    count = int((np.isfinite(limits.lower) | np.isfinite(limits.upper)).any(axis=1).sum())
    if not count:
        return "workspace", False, "no box: no device tells its own, and safety.workspace has none"
    return "workspace", True, f"{count} of {len(limits.force)} fingers: no force pushes one out of its box"
