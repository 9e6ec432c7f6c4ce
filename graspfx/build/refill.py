"""Other numbers in the blocks of a servo: a variant of its scene is filled in, and nothing is built."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from graspfx.build.bodies import BODY
from graspfx.build.build import meet
from graspfx.build.numbers import fields_of, general, reaches
from graspfx.build.object_parts import GAINS, GRASP, RULES
from graspfx.build.plants import make_plants
from graspfx.errors import InputError
from graspfx.loop.device import fused
from graspfx.loop.plant import FusedHand
from graspfx.loop.plant import fused as fused_plant

if TYPE_CHECKING:
    from graspfx.build.resolve import Parts
    from graspfx.loop.servo import Servo

POSE = ("object.*.position", "object.*.orientation", "object.*.shape")
HANDS = ("hand", "finger.*.hand")
DEVICES = ("device", "finger.*.device")
TOUCH = (*POSE, "finger.*.start", "finger.*.radius")  # where fingers meet their objects
MET = ("position", "contact", "normal", "face", "gap", "contact_world", "touching", "frame", "displacement")
MEETING = ("walks", *(f"fingers.{name}" for name in MET))  # walks on a mesh stand behind the declared fields
WHOLE: Mapping[str, tuple[str, ...]] = {  # blocks that a function fills whole, and the keys that it reads
    "device": (*DEVICES, "dimensions", "period"),  # `connect` of its driver, then `open`
    "plant": (*DEVICES, *HANDS, *TOUCH, "dimensions", "period"),  # `plant` of its devices' class, then `hold`
    "hand": (*HANDS, *TOUCH, "dimensions"),  # `HandPart.hold`
}


def reach(key: str) -> dict[str, frozenset[str]]:
    """Name what a key of a scene reaches: fields of the grasps' blocks, and other blocks that it may reach anywhere.

    Returns:
        By the kind of a block, the names of its fields; "*" for any of them.
    """
    plain = general(key)
    fields = fields_of(GAINS, key) | fields_of(RULES, key) | fields_of(GRASP, key)
    fields |= {f"body.{field}" for field in fields_of(BODY, key)}
    if reaches(TOUCH, plain):
        fields |= set(MEETING)
    if reaches(POSE, plain):
        fields |= {"fingers.anchor"}
    if reaches((*HANDS, *TOUCH, "coupling.external.stiffness", "coupling.internal.stiffness"), plain):
        fields |= {"fade_start", "fade_end"}  # where the fade is automatic
    reached = {"grasp": fields} if fields else {}
    return reached | {kind: frozenset("*") for kind, keys in WHOLE.items() if reaches(keys, plain)}


def refill(servo: Servo, parts: Parts) -> None:
    """Fill the blocks of a servo that has not run with the numbers of other parts, bit by bit as if they were built.

    Args:
        servo: of a scene that differs in numbers alone, and in none that chooses what is computed.
        parts: of the other scene.

    Raises:
        InputError: another period, a ledger, or a part that is more than a block: build the scene then.
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


def _copy(new: object, old: object) -> None:
    old.state[:] = new.state  # type: ignore[attr-defined]


def _require_blocks(servo: Servo, parts: Parts) -> None:
    """Require that every part is a block and its kernels, and that no block holds what is not filled here."""
    others = [
        *(name for name, each in (("a ledger", servo.observers),) if each),
        *("a device" for station in servo.stations if fused(station.device) is None),
        *("a plant" for wiring in servo.plants if fused_plant(wiring.plant) is None),
        *("a hand" for wiring in servo.plants if not isinstance(wiring.hand, FusedHand)),
        *("a body that meets others" for mover in servo.movers if getattr(mover.body, "buffer", 0) is not None),
        *("another period" for _ in range(1) if parts.scene.period != servo.period),
    ]
    if others:
        raise InputError("scene", others[0], "parts that are blocks, of the same period", "build the scene")
