"""Delays of part of a sample in a scene: who has them, and the refusal to simulate them."""

from __future__ import annotations

from collections.abc import Iterator

from graspfx.assembly.resolve import Parts
from graspfx.assembly.wiring import Wire
from graspfx.errors import InputError
from graspfx.loop.device import SimulatedDevice


def late_wires(parts: Parts) -> Iterator[tuple[Wire, float]]:
    """List devices whose forces come late by a time in seconds, the age of the sample included, each with it [s]."""
    for wire in parts.wires:
        late = (wire.features.lateness or 0.0) + (wire.features.latency or 0.0)
        if late > 0.0:
            yield wire, late


def require_prompt_simulations(parts: Parts) -> None:
    """Refuse to simulate devices whose forces are to come late by part of a sample: they begin with a sample.

    Raises:
        InputError: there is one; a certificate takes any delay.
    """
    for wire, late in late_wires(parts):
        if isinstance(wire.device, SimulatedDevice):
            names = ", ".join(parts.scene.finger_names[i] for i in wire.used)
            raise InputError(
                "measures.lateness", late, f"none in a simulation: forces of the simulated device of {names} begin "
                "with a sample",
                "`check` and `stability` take any delay; leave the measures out to run it, or give the driver whole "
                f"samples, delay = {round(late / parts.scene.period)}",
            )  # fmt: skip
