"""Messages for faults of a tick's kernels."""

from __future__ import annotations

from graspfx.coupling.grasped import fault_text
from graspfx.loop.device_exchange import device_name
from graspfx.loop.servo_parts import Parts
from graspfx.loop.world import MOVER, OBJECT_, SAFETY, STATION


def kernel_fault(parts: Parts, kind: int, index: int, code: int) -> str:
    """Return the message for the fault code of a kernel.

    Args:
        parts: Parts of the scene.
        kind: Kind of the part that failed, as latched by the tick.
        index: Index of the part among the parts of this kind.
        code: Fault code of the part's kernel.
    """
    fingers = parts.layout.fingers
    if kind == SAFETY and parts.safety is not None:
        devices = [device_name(each, fingers) for each in parts.stations]
        return parts.safety.fault_text(code, fingers, devices)
    if kind == STATION:
        return parts.stations[index].device.fault_text(code)  # type: ignore[attr-defined,no-any-return]
    if kind == OBJECT_:
        part = parts.objects[index]
        return fault_text(code, [fingers[f] for f in part.fingers], part.grasped)
    if kind == MOVER:
        return f"{object_names(parts, index)}: {parts.movers[index].body.fault_text(code)}"
    return f"{finger_names(parts, index)}: {parts.plants[index].plant.fault_text(code)}"  # type: ignore[attr-defined]


def object_names(parts: Parts, mover: int) -> str:
    """Return the names of the objects that a body group moves."""
    return ", ".join(parts.objects[number].name for number in parts.movers[mover].objects)


def finger_names(parts: Parts, plant: int) -> str:
    """Return the names of a plant's fingers."""
    return ", ".join(parts.layout.fingers[f] for f in parts.plants[plant].fingers)
