"""The servo's own memory: the first fault, what cannot go on, and each finger's force, place and energy."""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats, Record, Table, floats, table

# kinds of what cannot go on; FOREIGN is code that is no kernel, NATIVE a device by C functions
STATION, OBJECT_, MOVER, PLANT, FOREIGN, SAFETY, NATIVE = range(7)

CHUNK = 1024  # ticks for which the targets of a hand without a kernel are known ahead


class ServoState(Record):
    """The memory of a tick."""

    faulted: bool
    tick: int  # of the first fault
    kind: int  # what could not go on,
    index: int  # which of its kind,
    code: int  # and why
    period: float  # T [s]
    table_start: int  # the tick that the targets of hands without kernels begin with
    bodies: int
    plants: int
    fingers: int  # n
    dimensions: int  # d
    stuck_bodies: Floats = floats("bodies")  # 1 for one that cannot go on
    stuck_plants: Floats = floats("plants")
    displayed: Table = table("fingers", "dimensions")  # force on each operator [N]
    before: Table = table("fingers", "dimensions")  # where each fingertip was one sample ago [m]
    energy: Floats = floats("fingers")  # work that each device did [J]


@kernel
def latch(servo: ServoState, k: int, kind: int, index: int, code: int) -> None:
    """Keep the first fault; from then on every force is zero."""
    if not servo.faulted:
        servo.faulted = True
        servo.tick = k
        servo.kind = kind
        servo.index = index
        servo.code = code
