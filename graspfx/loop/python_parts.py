"""Parts of a servo that run as Python code, or wait for other software, between the engine's calls."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from graspfx.loop import plant as plants
from graspfx.loop.device import fused
from graspfx.loop.device_exchange import part_name
from graspfx.loop.servo import Servo


def foreign(servo: Servo) -> list[str]:
    """List devices, plants and bodies whose Python methods run between the engine's calls in each tick."""
    return list(_foreign(servo))


def guests(servo: Servo) -> list[str]:
    """List bodies that other software moves after the engine's call in each tick."""
    return [_body(servo, i) for i in servo.arena.guests]


def looked_ahead(servo: Servo) -> list[str]:
    """List hands in plain Python, whose targets are computed for many ticks at once."""
    wirings = [table.wiring for table in servo.arena.tables]
    return [part_name("hand", m.hand, _fingers(servo, m.fingers)) for m in wirings]


def _foreign(servo: Servo) -> Iterator[str]:
    for port in servo.arena.ports:
        station = servo.stations[port.station]
        if fused(station.device) is None:
            yield part_name("device", station.device, _fingers(servo, station.fingers))
    for j in servo.arena.plants:
        m = servo.plants[j]
        if plants.fused(m.plant) is None:
            yield part_name("plant", m.plant, _fingers(servo, m.fingers))
    for i in servo.arena.bodies:
        yield _body(servo, i)


def _body(servo: Servo, i: int) -> str:
    mover = servo.movers[i]
    return part_name("body", mover.body, (servo.objects[o].name for o in mover.objects))


def _fingers(servo: Servo, numbers: Iterable[int]) -> Iterator[str]:
    return (servo.layout.fingers[f] for f in numbers if f >= 0)
