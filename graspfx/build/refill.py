"""Other numbers in the blocks of a servo: a variant of its scene is filled in, and nothing is built."""

from __future__ import annotations

from typing import TYPE_CHECKING

from graspfx.build.build import meet
from graspfx.build.plants import make_plants
from graspfx.errors import InputError
from graspfx.loop.device import fused
from graspfx.loop.plant import FusedHand
from graspfx.loop.plant import fused as fused_plant

if TYPE_CHECKING:
    from graspfx.build.resolve import Parts
    from graspfx.loop.servo import Servo


def refill(servo: Servo, parts: Parts) -> None:
    """Fill the blocks of a servo that has not run with the numbers of other parts, bit by bit as if they were built.

    Args:
        servo: of a scene that differs in numbers alone, and in none that chooses what is computed.
        parts: of the other scene.

    Raises:
        InputError: another period, a ledger, a safety chain, or a part that is more than a block: build the scene then.
        SceneError, DeviceError: as of `build`.
    """
    _require_blocks(servo, parts)
    for grasped_part, part in zip(servo.objects, parts.objects, strict=True):
        part.fill(grasped_part.grasped, parts.limits)
    inward = meet(parts, servo.objects, servo.movers)
    wired = parts.own_wires()
    plants = list(make_plants(parts, wired, inward))
    for station, wire in zip(servo.stations, wired, strict=True):
        with wire.device:
            wire.device.open(servo.period)
            _copy(wire.device, station.device)
    for old, new in zip(servo.plants, plants, strict=True):
        new.plant.hold(new.hand, servo.period)  # type: ignore[attr-defined]
        _copy(new.plant, old.plant)
        _copy(new.hand, old.hand)
    servo.watch.note()


def _copy(new: object, old: object) -> None:
    old.state[:] = new.state  # type: ignore[attr-defined]


def _require_blocks(servo: Servo, parts: Parts) -> None:
    """Require that every part is a block and its kernels, and that no block holds what is not filled here."""
    others = [
        *(name for name, each in (("a ledger", servo.observers), ("a safety chain", servo.safety)) if each),
        *("a device" for station in servo.stations if fused(station.device) is None),
        *("a plant" for wiring in servo.plants if fused_plant(wiring.plant) is None),
        *("a hand" for wiring in servo.plants if not isinstance(wiring.hand, FusedHand)),
        *("a body that meets others" for mover in servo.movers if getattr(mover.body, "buffer", 0) is not None),
        *("another period" for _ in range(1) if parts.scene.period != servo.period),
    ]
    if others:
        raise InputError("scene", others[0], "parts that are blocks, of the same period", "build the scene")
