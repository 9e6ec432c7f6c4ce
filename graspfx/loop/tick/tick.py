"""The tick of a scene, as code: read, couple, limit, watch, display; record, move.

A tick is `begin`, then `end`; where a device is plain Python it is read before the one and written between the two.
Every function here runs as it stands over a scene's parts, and is unfolded over them into the program that a run
executes (`graspfx.compile.unfold`): `graspfx check SCENE --tick` prints it.
"""

from __future__ import annotations

from collections.abc import Sequence

from graspfx.compile.unfold.stage import stage
from graspfx.coupling.contacts import LOST
from graspfx.coupling.grasp_state import GraspState
from graspfx.coupling.limit import limit
from graspfx.coupling.sample import conclude, couple, let_go, sample
from graspfx.loop.energy.watch import watch
from graspfx.loop.safety.accounts import close_books, open_books
from graspfx.loop.safety.restrain import restrain
from graspfx.loop.safety.soften import apply_gain, soften
from graspfx.loop.safety.tank import adjust
from graspfx.loop.safety.trust import keep_pace
from graspfx.loop.tick.memory import MOVER, OBJECT_, PLANT, SAFETY, STATION, latch
from graspfx.loop.tick.wires import (
    BodyWires,
    Channel,
    DeviceWires,
    FloatArray,
    GraspWires,
    GuestWires,
    HandWires,
    LedgerWires,
    PlantWires,
    PortWires,
    SafetyWires,
    TableWires,
    Target,
    Wiring,
)


@stage
def begin(scene: Wiring, k: int) -> None:
    """Run tick k up to the forces that devices display."""
    take(scene, k)
    read(scene, k)
    predict(scene)
    couple_objects(scene, k)
    add_work(scene, k)
    if scene.faulted[0] != 0.0:
        release(scene)
    display(scene, k)


@stage
def end(scene: Wiring, k: int, r: int, rows: FloatArray) -> None:
    """Run the rest of tick k, recorded in row r."""
    if scene.faulted[0] != 0.0:
        stop(scene)
    record(scene, k, r, rows)
    move(scene, k)
    advance(scene, k)


@stage
def copy(to: FloatArray, source: FloatArray) -> None:
    """Copy entries one by one."""
    for a in range(len(to)):
        to[a] = source[a]


# Read -----------------------------------------------------------------------------------------------------------------


@stage
def take(scene: Wiring, k: int) -> None:
    """Take the motion that other software gave its bodies after the last tick."""
    for body in scene.bodies:
        if isinstance(body, GuestWires):
            for part in body.parts:
                if body.stuck[0] == 0.0:
                    code = body.taking(part.body, part.guest, scene.period[0])
                    if code != 0:
                        latch(scene.servo, k, MOVER, body.index, code)
                        body.stuck[0] = 1.0


@stage
def read(scene: Wiring, k: int) -> None:
    """Read each device: its fingers' positions and velocities."""
    for device in scene.devices:
        if isinstance(device, PortWires):
            if device.readable[0] != 0.0:
                take_reading(device.channels)
        else:
            for a, entry in enumerate(device.sensed_entries):
                device.sensed[a] = device.plant[entry]
            code = device.reading(device.state, 0)
            if code != 0:
                latch(scene.servo, k, STATION, device.index, code)
            else:
                take_reading(device.channels)


@stage
def take_reading(channels: Sequence[Channel]) -> None:
    """Hand a device's reading to its fingers."""
    for channel in channels:
        finger = channel.finger
        copy(finger.position, channel.position)
        copy(finger.velocity, channel.velocity)
        if channel.limit is not None and finger.limit is not None:
            copy(finger.limit, channel.limit)


# Couple ---------------------------------------------------------------------------------------------------------------


@stage
def predict(scene: Wiring) -> None:
    """Tell couplings under the implicit integrator where their bodies would be without them."""
    for body in scene.bodies:
        if isinstance(body, BodyWires) and body.predicting is not None:
            body.predicting(body.state, body.floor, scene.period[0])


@stage
def couple_objects(scene: Wiring, k: int) -> None:
    """Couple the fingers to the objects: forces, limits on them, and the energies that a ledger watches."""
    if scene.pace is not None and scene.faulted[0] == 0.0:
        code = keep_pace(scene.pace, k)
        if code != 0:
            latch(scene.servo, k, SAFETY, 0, code)
    for grasp in scene.grasps:
        if scene.faulted[0] == 0.0:
            if grasp.safety is not None:
                code = couple_safely(grasp.state, grasp.safety)
            elif grasp.limited:  # what the object receives is what is displayed
                code = couple(grasp.state)
                code = limit(grasp.state, code)
                code = conclude(grasp.state, code)
            else:
                code = sample(grasp.state)
            if code != 0:
                latch(scene.servo, k, OBJECT_, grasp.index, code)
                if code == LOST:
                    grasp.stuck[0] = 1.0
            if grasp.safety is not None:
                if scene.faulted[0] == 0.0:
                    finish_safely(scene, grasp, grasp.safety, k)
            elif grasp.ledger is not None and scene.faulted[0] == 0.0:
                watch_energy(grasp.state, grasp.ledger, scene.period)


@stage
def couple_safely(grasp: GraspState, safety: SafetyWires) -> int:
    """Couple fingers to an object by stiffness and damping times gamma, and limit the forces: before any brake."""
    if safety.steered:
        adjust(grasp, safety.state)
    code = couple(grasp)
    code = soften(grasp, safety.state, safety.pace, code)
    code = limit(grasp, code)
    apply_gain(grasp, safety.state)
    return conclude(grasp, code)


@stage
def finish_safely(scene: Wiring, grasp: GraspWires, safety: SafetyWires, k: int) -> None:
    """Brake, then restrain the forces of an object; the ledger stores what is displayed."""
    if grasp.ledger is not None:
        show_contact(grasp.ledger)
        open_books(grasp.state, grasp.ledger.state, safety.state, scene.period[0])
    code = restrain(grasp.state, safety.state, safety.pace)
    if code != 0:
        latch(scene.servo, k, SAFETY, 0, code)
    elif grasp.ledger is not None:
        close_books(grasp.state, grasp.ledger.state, safety.state)


@stage
def watch_energy(grasp: GraspState, ledger: LedgerWires, period: FloatArray) -> None:
    """Watch the energies of a grasp."""
    show_contact(ledger)
    watch(grasp, ledger.state, period[0])


@stage
def show_contact(ledger: LedgerWires) -> None:
    """Show a ledger the wrench of planes on the body."""
    if ledger.met is not None and ledger.contact_wrench is not None:
        copy(ledger.met, ledger.contact_wrench)


@stage
def add_work(scene: Wiring, k: int) -> None:
    """Add the work of the last sample's forces at the fingertips; keep where these are now."""
    if k > 0 and scene.faulted[0] == 0.0:
        for finger in scene.fingers:
            step = finger.displayed[0] * (finger.tip[0] - finger.before[0])
            for a in range(1, scene.dimensions):
                step += finger.displayed[a] * (finger.tip[a] - finger.before[a])
            finger.energy[0] += step
    for finger in scene.fingers:
        copy(finger.before, finger.tip)


@stage
def release(scene: Wiring) -> None:
    """Let go of every object."""
    for grasp in scene.grasps:
        let_go(grasp.state)


# Display --------------------------------------------------------------------------------------------------------------


@stage
def display(scene: Wiring, k: int) -> None:
    """Hand each device the forces on its operator."""
    for finger in scene.fingers:
        for a in range(scene.dimensions):
            finger.displayed[a] = -finger.force[a]
    for device in scene.devices:
        for channel in device.channels:
            copy(channel.command, channel.finger.displayed)
        if isinstance(device, DeviceWires):
            code = device.writing(device.state, 0)
            if code != 0:
                latch(scene.servo, k, STATION, device.index, code)


@stage
def stop(scene: Wiring) -> None:
    """Zero every force after a fault."""
    release(scene)
    for finger in scene.fingers:
        for a in range(scene.dimensions):
            finger.displayed[a] = 0.0
    for device in scene.devices:
        if isinstance(device, DeviceWires):
            device.stopping(device.state, 0)


# Record ---------------------------------------------------------------------------------------------------------------


@stage
def record(scene: Wiring, k: int, r: int, rows: FloatArray) -> None:
    """Write a row, if this tick has one."""
    if scene.columns is not None:
        if scene.every == 1:
            row = r * scene.width
            for column, memory, entry in scene.columns:
                rows[row + column] = memory[entry]
        elif k % scene.every == 0:
            row = r // scene.every * scene.width
            for column, memory, entry in scene.columns:
                rows[row + column] = memory[entry]


# Move -----------------------------------------------------------------------------------------------------------------


@stage
def move(scene: Wiring, k: int) -> None:
    """Move the bodies; tell other software the wrenches on those that it moves.

    The force of tick k is displayed and recorded by now: a body that cannot go on is a fault of tick k + 1, the first
    one without force, and so is a plant.
    """
    for body in scene.bodies:
        if body.stuck[0] == 0.0:
            if isinstance(body, GuestWires):
                for part in body.parts:
                    body.handing(part.body, part.guest, scene.period[0])
            else:
                code = body.stepping(body.state, body.floor, scene.period[0])
                if code != 0:
                    latch(scene.servo, k + 1, MOVER, body.index, code)
                    body.stuck[0] = 1.0


@stage
def advance(scene: Wiring, k: int) -> None:
    """Move the plants under the devices' efforts and their hands."""
    for plant in scene.plants:
        if plant.stuck[0] == 0.0:
            for to, effort in plant.efforts:
                copy(to, effort)
            if isinstance(plant.hand, HandWires):
                ask(plant, plant.hand, k, scene.period)
            elif plant.hand is not None:
                look_up(plant, plant.hand, k)
            code = plant.kernel(plant.state, 0)
            if code != 0:
                latch(scene.servo, k + 1, PLANT, plant.index, code)
                plant.stuck[0] = 1.0


@stage
def ask(plant: PlantWires, hand: HandWires, k: int, period: FloatArray) -> None:
    """Ask a hand for its targets in the coming sample."""
    if plant.middle is not None:
        hand.kernel(hand.state, 0, 0.5 * (k * period[0] + (k + 1) * period[0]))
        aim(plant.middle, hand.target)
    hand.kernel(hand.state, 0, (k + 1) * period[0])
    aim(plant.end, hand.target)


@stage
def aim(to: Target, target: Target) -> None:
    """Hand targets to a plant."""
    copy(to.position, target.position)
    copy(to.velocity, target.velocity)


@stage
def look_up(plant: PlantWires, table: TableWires, k: int) -> None:
    """Look up the targets that a hand in plain Python gave beforehand."""
    row = (k - int(table.start[0])) * table.width
    if plant.middle is not None:
        look_up_target(plant.middle, table, row, table.width // 2)
    look_up_target(plant.end, table, row, 0)


@stage
def look_up_target(to: Target, table: TableWires, row: int, start: int) -> None:
    """Hand a plant one row of a table: r, then r'."""
    size = len(to.position)
    for a in range(size):
        to.position[a] = table.memory[row + (start + a)]
    for a in range(size):
        to.velocity[a] = table.memory[row + (start + size + a)]
