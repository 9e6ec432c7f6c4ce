"""Memory layout of a scene: records that list the scene's parts and where in memory the data of each part begin.

All memory of a scene is one float64 array, the arena. `World` lists the parts. The records contain *places*: a place is
the index of the arena's entry at which a block of data, or a quantity in a block, begins. Place 0, `NONE`, is unused.
"""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats, Many, Record, Table, floats, many, table

NONE = 0  # place of a missing block
CHUNK = 1024  # number of ticks for which the targets of a hand in plain Python are computed in advance

# kinds of parts that may have a fault; FOREIGN is plain Python, NATIVE is a device with C functions
STATION, OBJECT_, MOVER, PLANT, FOREIGN, SAFETY, NATIVE = range(7)

BEGIN, WRITE = 0, 1  # phases of a tick: the tick begins, or its devices are written
STILL, KERNEL, TABLE = 0, 1, 2  # kinds of hands: constant, a kernel, or plain Python with a table of targets


class ServoState(Record):
    """State of the loop: the first fault, the parts that have failed, and each finger's force, position and energy."""

    faulted: bool
    tick: int  # tick of the first fault
    kind: int  # kind of the part that failed
    index: int  # index of that part among the parts of its kind
    code: int  # fault code of that part
    period: float  # sampling period T [s]
    table_start: int  # first tick of the target tables of hands in plain Python
    bodies: int
    plants: int
    fingers: int  # n
    dimensions: int  # d
    stuck_bodies: Floats = floats("bodies")  # 1 for a body that cannot continue
    stuck_plants: Floats = floats("plants")
    displayed: Table = table("fingers", "dimensions")  # force on each operator [N]
    before: Table = table("fingers", "dimensions")  # position of each fingertip one sample ago [m]
    energy: Floats = floats("fingers")  # work done by each device [J]


@kernel
def latch(servo: ServoState, k: int, kind: int, index: int, code: int) -> None:
    """Store the fault of a part in tick k, if no earlier fault is stored; after a fault all forces are zero."""
    if not servo.faulted:
        servo.faulted = True
        servo.tick = k
        servo.kind = kind
        servo.index = index
        servo.code = code


class Wire(Record):
    """A number of entries (`count`) that are copied from place `source` to place `to`."""

    to: int
    source: int
    count: int


class Finger(Record):
    """Places of the quantities of one finger; each vector has d entries, one per dimension."""

    position: int  # position read from the device, in the object's block [m]
    velocity: int  # [m/s]
    force: int  # force on the object [N]
    limit: int  # largest force that the device displays at this position [N]
    displayed: int  # force on the operator [N]
    tip: int  # true position of the fingertip, or its reading if that is unknown [m]
    before: int  # position one sample ago [m]
    energy: int  # work done by the device on the finger so far [J]


class Channel(Record):
    """One channel of a device: places of its readings and of the force that it displays."""

    finger: int  # index of the finger
    position: int
    velocity: int
    limit: int
    command: int


class Device(Record):
    """A device. The caller of `steps` reads and writes devices in plain Python."""

    plain: bool  # in plain Python
    state: int  # place of its block; for a plain device, an entry that tells whether the device could be read
    first: int  # index of its first record in `channels`
    count: int
    first_sensed: int  # index of its first record in `wires`, which copy the sensed state of its plant
    sensed: int
    reading: int  # kernels, by number or address
    writing: int
    stopping: int


class Grasp(Record):
    """Places of the data of an object and its coupling, and settings of the coupling."""

    state: int
    ledger: int
    safety: int
    host: int  # place of the host's block, if another program simulates the object
    stuck: int  # place of the entry in `stuck_bodies` for the object's body
    limited: bool
    steered: bool  # a gain may change during a run
    met: Wire  # wrench of planes on the body, for the ledger


class Body(Record):
    """A body, moved by kernels in the tick or by other software between two ticks."""

    index: int
    stuck: int
    state: int
    beside: int  # block of a floor, or a guest's part of its buffer
    guest: bool
    stepping: int  # kernel that moves the body; for a guest, the kernel that passes on its wrench
    predicting: int  # kernel for the implicit integrator, else NONE
    taking: int  # kernel that takes the motion of a guest


class Exchange(Record):
    """An exchange with other software that machine code performs."""

    stuck: int
    address: int
    plan: int  # place of its plan


class Plant(Record):
    """A plant moved by a kernel, and the hand that holds the plant."""

    index: int
    stuck: int
    state: int
    kernel: int
    first: int  # index of its first record in `wires`, which copy the efforts of its devices
    count: int
    width: int  # n d
    hand_kind: int
    hand: int  # place of the hand's block or of its table
    hand_kernel: int
    target_position: int  # place in the hand's block
    target_velocity: int
    middle_position: int  # place in the plant's block, NONE if the plant needs no targets in the middle of a sample
    middle_velocity: int
    end_position: int
    end_velocity: int


class World(Record):
    """Records of all parts of a scene, over which a tick iterates."""

    phase: int  # BEGIN or WRITE
    pauses: bool  # return after each tick to the caller, which runs devices, bodies or plants in plain Python
    ports: int  # number of devices in plain Python
    exchanging: bool  # machine code exchanges with other software after each tick
    failed: bool  # an exchange raised an exception
    done: int  # number of ticks completed before that exception
    dimensions: int  # d
    width: int  # width of a row
    every: int  # ticks from one recorded row to the next
    recorded: int  # values per recorded row, 0 without recording
    servo: int
    pace: int  # place of the safety chain's memory
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
    columns: Floats = floats("column_count")  # place of each value of a row
