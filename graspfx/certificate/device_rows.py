"""Rows of a plan that only some devices ask for: forces that come late, moments that are not displayed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from graspfx.build.late_simulations import late_wires
from graspfx.build.resolve import Parts
from graspfx.loop.device import SimulatedDevice
from graspfx.scene.model import Scene

Row = tuple[str, bool, str]


def lateness_rows(parts: Parts) -> Iterator[Row]:
    """List the devices whose forces come late by a time that is no count of samples."""
    for wire, late in late_wires(parts):
        names = ", ".join(parts.scene.finger_names[i] for i in wire.used)
        share = late / parts.scene.period
        text = f"{names}: {1e3 * late:.3g} ms from a motion to the force, {share:.3g} samples, in the certificate"
        if isinstance(wire.device, SimulatedDevice):
            yield "lateness", False, f"{text}; a run refuses it, as simulated forces begin with a sample"
        else:
            yield "lateness", True, f"{text}; half a hold comes to it by itself"


def moment_rows(scene: Scene) -> Iterator[Row]:
    """Say what of soft fingers' torsion their operators do not feel: devices are told forces alone."""
    soft = [finger for finger in scene.finger if finger.model == "soft"]
    if not soft:
        return
    coefficients = [mu for mu, finger in zip(scene.coefficients, scene.finger, strict=True) if finger.model == "soft"]
    levers = [1e3 * mu * (finger.patch or 0.0) for mu, finger in zip(coefficients, soft, strict=True)]
    low, high = float(np.min(levers)), float(np.max(levers))
    size = f"{high:.3g}" if low == high else f"{low:.3g} to {high:.3g}"
    bound = f", up to mu rho = {size} N mm for each newton that presses" if high > 0.0 else ", without a bound"
    text = f"torsion of {len(soft)} soft fingers{bound}: the object feels it, the operators do not"
    yield "displayed moments", False, f"{text}; finger_moment records it"
