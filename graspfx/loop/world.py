"""Memory layout of a scene: records of its fingers, devices, objects, bodies and plants, and the places of blocks.

All memory of a scene is one float64 array, the arena. `World` lists the parts. Its records hold *places*: the
entries of the arena where a part's block, or a quantity in it, begins. Place 0, `NONE`, is unused.
"""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats, Many, Record, Table, floats, many, table

NONE = 0  # a place that a part does not have
CHUNK = 1024  # ticks for which the targets of a hand in plain Python are known ahead

# kinds of what cannot go on; FOREIGN is plain Python, NATIVE a device by C functions
STATION, OBJECT_, MOVER, PLANT, FOREIGN, SAFETY, NATIVE = range(7)

BEGIN, WRITE = 0, 1  # phases of a tick: it is to begin, or its devices are to be written
STILL, KERNEL, TABLE = 0, 1, 2  # hands: one that keeps still, a kernel, one in plain Python that was asked beforehand


class ServoState(Record):
    """The memory of a tick: the first fault, the failed part, and each finger's force, position and energy."""

    faulted: bool
    tick: int  # of the first fault
    kind: int  # what could not go on,
    index: int  # which of its kind,
    code: int  # and why
    period: float  # T [s]
    table_start: int  # the tick that the targets of hands in plain Python begin with
    bodies: int
    plants: int
    fingers: int  # n
    dimensions: int  # d
    stuck_bodies: Floats = floats("bodies")  # 1 for one that cannot go on
    stuck_plants: Floats = floats("plants")
    displayed: Table = table("fingers", "dimensions")  # force on each operator [N]
    before: Table = table("fingers", "dimensions")  # position of each fingertip one sample ago [m]
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


class Wire(Record):
    """Entries that are copied."""

    to: int
    source: int
    count: int


class Finger(Record):
    """Places of one finger's quantities, d entries each."""

    position: int  # as its device read it, in its object's block [m]
    velocity: int  # [m/s]
    force: int  # on the object [N]
    limit: int  # the largest force that its device displays where it is [N]
    displayed: int  # force on the operator [N]
    tip: int  # where the fingertip truly is, or where it was read if that is not known [m]
    before: int  # where it was one sample ago [m]
    energy: int  # work that the device did on it so far [J]


class Channel(Record):
    """One channel of a device: places of a finger's readings and of the force to display."""

    finger: int  # its number
    position: int
    velocity: int
    limit: int
    command: int


class Device(Record):
    """A device; one in plain Python is read and written by the caller of `steps`."""

    plain: bool  # Python
    state: int  # its block; of a plain one an entry, whether it could be read
    first: int  # of `channels`
    count: int
    first_sensed: int  # of `wires`: what its sensors see of its plant
    sensed: int
    reading: int  # kernels, by number or address
    writing: int
    stopping: int


class Grasp(Record):
    """An object and its coupling."""

    state: int
    ledger: int
    safety: int
    host: int  # of a scene whose object another program has
    stuck: int  # entry of its body
    limited: bool
    steered: bool  # a gain may change in mid-run
    met: Wire  # the wrench of planes on the body, for the ledger


class Body(Record):
    """A body that kernels move, or one that other software moves between two ticks."""

    index: int
    stuck: int
    state: int
    beside: int  # block of a floor, or a guest's part of its buffer
    guest: bool
    stepping: int  # kernels; of a guest the one that hands its wrench over
    predicting: int  # under the implicit integrator; NONE else
    taking: int  # of a guest


class Exchange(Record):
    """An exchange with other software by machine code."""

    stuck: int
    address: int
    plan: int  # place of its plan


class Plant(Record):
    """A plant that a kernel moves, and its hand."""

    index: int
    stuck: int
    state: int
    kernel: int
    first: int  # of `wires`: efforts of its devices
    count: int
    width: int  # n d
    hand_kind: int
    hand: int  # its block, or its table
    hand_kernel: int
    target_position: int  # in the hand's block
    target_velocity: int
    middle_position: int  # in the plant's block, NONE where it does not ask for the middle of a sample
    middle_velocity: int
    end_position: int
    end_velocity: int


class World(Record):
    """What a tick runs over."""

    phase: int  # BEGIN or WRITE
    pauses: bool  # the caller is wanted after each tick: it reads devices, moves bodies or plants in plain Python
    ports: int  # devices in plain Python
    exchanging: bool  # machine code exchanges with other software after each tick
    failed: bool  # such an exchange has raised an exception,
    done: int  # ticks of its call that were done before
    dimensions: int  # d
    width: int  # of a row
    every: int  # ticks from one recorded row to the next
    recorded: int  # numbers of a row, 0 without recording
    servo: int
    pace: int  # of the safety chain
    finger_count: int
    channel_count: int
    device_count: int
    grasp_count: int
    body_count: int
    exchange_count: int
    plant_count: int
    wire_count: int
    column_count: int
    fingers: Many[Finger] = many("finger_count")
    channels: Many[Channel] = many("channel_count")
    devices: Many[Device] = many("device_count")
    grasps: Many[Grasp] = many("grasp_count")
    bodies: Many[Body] = many("body_count")
    exchanges: Many[Exchange] = many("exchange_count")
    plants: Many[Plant] = many("plant_count")
    wires: Many[Wire] = many("wire_count")
    columns: Floats = floats("column_count")  # where each number of a row stands
