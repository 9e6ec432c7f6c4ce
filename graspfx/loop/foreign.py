"""Which parts of a servo are no kernels, or wait for other software between two calls."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from graspfx.loop import plant as plants
from graspfx.loop.device import fused
from graspfx.loop.servo import Servo
from graspfx.loop.tick.script import Tick


def foreign(servo: Servo, tick: Tick | None = None) -> list[str]:
    """List devices, plants and bodies that run by their own methods, between the calls of each tick.

    Args:
        servo: that runs.
        tick: its parts' tick where it is written already; else the servo writes it.
    """
    return list(_foreign(servo, tick or servo.script))


def guests(servo: Servo, tick: Tick | None = None) -> list[str]:
    """List bodies that other software moves after the call of each tick; `tick` as for `foreign`."""
    return [_body(servo, i) for i in (tick or servo.script).guests]


def looked_ahead(servo: Servo, tick: Tick | None = None) -> list[str]:
    """List hands that are no kernels: they are asked for many ticks at once; `tick` as for `foreign`."""
    wirings = [servo.plants[table.plant] for table in (tick or servo.script).tables]
    return [_described("hand", m.hand, _fingers(servo, m.fingers)) for m in wirings]


def _foreign(servo: Servo, tick: Tick) -> Iterator[str]:
    for port in tick.ports:
        station = servo.stations[port.station]
        if fused(station.device) is None:
            yield _described("device", station.device, _fingers(servo, station.fingers))
    for j in tick.plants:
        m = servo.plants[j]
        if plants.fused(m.plant) is None:
            yield _described("plant", m.plant, _fingers(servo, m.fingers))
    for i in tick.bodies:
        yield _body(servo, i)


def _body(servo: Servo, i: int) -> str:
    mover = servo.movers[i]
    return _described("body", mover.body, (servo.objects[o].name for o in mover.objects))


def _fingers(servo: Servo, numbers: Iterable[int]) -> Iterator[str]:
    return (servo.layout.fingers[f] for f in numbers if f >= 0)


def _described(kind: str, part: object, names: Iterable[str]) -> str:
    return f"the {kind} of {', '.join(names)} ({type(part).__qualname__})"
