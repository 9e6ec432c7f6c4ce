"""Tick of a scene, in stages: take, read, predict, couple, add work, display, stop, record, move and advance.

`steps` runs the ticks of any scene: it loops over the records of the scene's `World`. The same source runs interpreted
or compiled. `graspfx check SCENE --tick` lists the kernels that run in one scene.
"""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.compile.records import Floats
from graspfx.coupling.contacts import LOST
from graspfx.coupling.grasp_state import GraspState
from graspfx.coupling.limit import limit
from graspfx.coupling.sample import conclude, couple, let_go, sample
from graspfx.feedback.bridge import HostState, host_forces, tell_fault
from graspfx.loop.energy.books import LedgerState
from graspfx.loop.energy.brake import watch
from graspfx.loop.kernels import call, invoke, invoke_at, invoke_beside
from graspfx.loop.safety.restrain import restrain
from graspfx.loop.safety.safety_state import Pace, SafetyState
from graspfx.loop.safety.soften import apply_gain, soften
from graspfx.loop.safety.tank import adjust, close_books, open_books
from graspfx.loop.safety.trust import CAUSES, HOST, keep_pace, soft_share
from graspfx.loop.world import (
    BEGIN,
    KERNEL,
    MOVER,
    NONE,
    OBJECT_,
    PLANT,
    SAFETY,
    STATION,
    STILL,
    TABLE,
    WRITE,
    Grasp,
    Plant,
    ServoState,
    Wire,
    World,
    latch,
)


@kernel
def steps(world: World, k: int, count: int, r: int, rows: Floats) -> int:
    """Run ticks k, ..., k + count - 1, and return the number of completed ticks.

    If one of every m ticks is recorded, tick k + i is written to row (r + i) // m of `rows`, provided that m divides
    k + i. A call ends after the tick of the first fault. If bodies or plants are in Python, a call ends after each
    tick. If devices are in Python, the caller reads them before each tick, and `steps` returns twice per tick: when the
    devices must be written (`world.phase` is then WRITE), and at the end of the tick.
    """
    servo = ServoState(world.buffer, world.servo)
    i = 0
    while i < count:
        if world.phase == BEGIN:
            begin(world, servo, k)
            if world.ports > 0:
                world.phase = WRITE
                return i
        world.phase = BEGIN
        end(world, servo, k, r, rows)
        i += 1
        if servo.faulted and servo.tick == k:  # the caller handles an exchange with other software
            return i
        if world.exchanging:
            exchange(world)
            if world.failed:
                world.done = i - 1
                return i - 1
        if world.pauses:
            return i
        k += 1
        r += 1
    return i


@kernel
def begin(world: World, servo: ServoState, k: int) -> None:
    """Run the stages of tick k up to and including the display of forces."""
    take(world, servo, k)
    read(world, servo, k)
    predict(world, servo)
    couple_objects(world, servo, k)
    add_work(world, servo, k)
    if servo.faulted:
        release(world)
    display(world, servo, k)


@kernel
def end(world: World, servo: ServoState, k: int, r: int, rows: Floats) -> None:
    """Run the stages of tick k after the display of forces; `r` and `rows` are those of `steps`."""
    if servo.faulted:
        stop(world)
    record(world, k, r, rows)
    move(world, servo, k)
    advance(world, servo, k)


@kernel
def copy(memory: Floats, to: int, source: int, count: int) -> None:
    """Copy `count` entries from index `source` of the memory to index `to`."""
    for a in range(count):
        memory[to + a] = memory[source + a]


@kernel
def carry(memory: Floats, wire: Wire) -> None:
    """Copy the entries that a wire connects."""
    copy(memory, wire.to, wire.source, wire.count)


# Read -----------------------------------------------------------------------------------------------------------------


@kernel
def take(world: World, servo: ServoState, k: int) -> None:
    """Copy the motion of the bodies that other software has moved since the last tick."""
    memory = Floats(world.buffer, 0)
    for body in world.bodies:
        if body.guest and memory[body.stuck] == 0.0:
            code = invoke_beside(world.buffer, body.taking, body.state, body.beside, servo.period)
            if code != 0:
                latch(servo, k, MOVER, body.index, code)
                memory[body.stuck] = 1.0


@kernel
def read(world: World, servo: ServoState, k: int) -> None:
    """Read the positions and velocities of each device's fingers."""
    memory, wires, channels, fingers = Floats(world.buffer, 0), world.wires, world.channels, world.fingers
    d = world.dimensions
    for i, device in enumerate(world.devices):
        code, told = 0, True
        if device.plain:
            told = memory[device.state] != 0.0
        else:
            for w in range(device.first_sensed, device.first_sensed + device.sensed):
                carry(memory, wires[w])
            code = invoke(world.buffer, device.reading, device.state)
        if code != 0:
            latch(servo, k, STATION, i, code)
        elif told:
            for c in range(device.first, device.first + device.count):
                channel = channels[c]
                finger = fingers[channel.finger]
                copy(memory, finger.position, channel.position, d)
                copy(memory, finger.velocity, channel.velocity, d)
                if channel.limit != NONE:
                    memory[finger.limit] = memory[channel.limit]


# Couple ---------------------------------------------------------------------------------------------------------------


@kernel
def predict(world: World, servo: ServoState) -> None:
    """Predict the motion of each body without coupling forces, where a coupling uses the implicit integrator."""
    for body in world.bodies:
        if body.predicting != NONE:
            invoke_beside(world.buffer, body.predicting, body.state, body.beside, servo.period)


@kernel
def couple_objects(world: World, servo: ServoState, k: int) -> None:
    """Compute and limit the forces between fingers and objects, and update the energy ledgers."""
    memory = Floats(world.buffer, 0)
    if world.pace != NONE and not servo.faulted:
        code = keep_pace(Pace(world.buffer, world.pace), k)
        if code != 0:
            latch(servo, k, SAFETY, 0, code)
    for i, grasp in enumerate(world.grasps):
        if servo.faulted and grasp.host != NONE:
            tell_fault(HostState(world.buffer, grasp.host), servo.code)
        if not servo.faulted:
            state = GraspState(world.buffer, grasp.state)
            if grasp.host != NONE:
                code = couple_to_host(world, servo, grasp, k)
            elif grasp.safety != NONE:
                code = couple_safely(world, grasp)
            elif grasp.limited:  # the object receives the displayed force
                code = conclude(state, limit(state, couple(state)))
            else:
                code = sample(state)
            if code != 0 and not servo.faulted:
                latch(servo, k, OBJECT_, i, code)
                if code == LOST:
                    memory[grasp.stuck] = 1.0
            if not servo.faulted:
                if grasp.safety != NONE:
                    finish_safely(world, servo, grasp, k)
                elif grasp.ledger != NONE:
                    carry(memory, grasp.met)
                    watch(state, LedgerState(world.buffer, grasp.ledger), servo.period)


@kernel
def couple_safely(world: World, grasp: Grasp) -> int:
    """Compute an object's coupling forces, scale stiffness and damping by the gain gamma, and limit the forces."""
    state, safety = GraspState(world.buffer, grasp.state), SafetyState(world.buffer, grasp.safety)
    if grasp.steered:
        adjust(state, safety)
    code = couple(state)
    code = soften(state, safety, Pace(world.buffer, world.pace), code)
    code = limit(state, code)
    apply_gain(state, safety)
    return conclude(state, code)


@kernel
def couple_to_host(world: World, servo: ServoState, grasp: Grasp, k: int) -> int:
    """Apply the forces that another program sent, if any, scaled by the gain gamma of soft start and trust."""
    state, safety = GraspState(world.buffer, grasp.state), SafetyState(world.buffer, grasp.safety)
    host, pace = HostState(world.buffer, grasp.host), Pace(world.buffer, world.pace)
    code = host_forces(state, host)
    pace.host = host.quiet
    pace.soft = soft_share(host.begun, pace)  # counted from the host's first sample
    soften(state, safety, pace, code)
    apply_gain(state, safety)
    if code != 0:
        latch(servo, k, SAFETY, 0, HOST + CAUSES * code)
    return conclude(state, code)


@kernel
def finish_safely(world: World, servo: ServoState, grasp: Grasp, k: int) -> None:
    """Apply the passivity controller, limit an object's forces, and store the displayed forces in the energy ledger."""
    state, safety = GraspState(world.buffer, grasp.state), SafetyState(world.buffer, grasp.safety)
    ledger = LedgerState(world.buffer, grasp.ledger)
    if grasp.ledger != NONE:
        carry(Floats(world.buffer, 0), grasp.met)
        open_books(state, ledger, safety, servo.period)
    code = restrain(state, safety, Pace(world.buffer, world.pace))
    if code != 0:
        latch(servo, k, SAFETY, 0, code)
    elif grasp.ledger != NONE:
        close_books(state, ledger, safety)


@kernel
def add_work(world: World, servo: ServoState, k: int) -> None:
    """Add the work that the last sample's displayed forces did on each fingertip, and store the fingertip positions."""
    memory, d = Floats(world.buffer, 0), world.dimensions
    working = k > 0 and not servo.faulted
    for finger in world.fingers:
        shown, tip, before = finger.displayed, finger.tip, finger.before
        if working:
            step = memory[shown] * (memory[tip] - memory[before])
            for a in range(1, d):
                step += memory[shown + a] * (memory[tip + a] - memory[before + a])
            memory[finger.energy] += step
        copy(memory, before, tip, d)


@kernel
def release(world: World) -> None:
    """Set the forces on all fingers and all objects to zero."""
    for grasp in world.grasps:
        let_go(GraspState(world.buffer, grasp.state))


# Display --------------------------------------------------------------------------------------------------------------


@kernel
def display(world: World, servo: ServoState, k: int) -> None:
    """Write to each device the forces that it displays to its operator."""
    memory, channels, fingers = Floats(world.buffer, 0), world.channels, world.fingers
    d = world.dimensions
    for finger in fingers:
        for a in range(d):
            memory[finger.displayed + a] = -memory[finger.force + a]
    for i, device in enumerate(world.devices):
        for c in range(device.first, device.first + device.count):
            channel = channels[c]
            copy(memory, channel.command, fingers[channel.finger].displayed, d)
        if not device.plain:
            code = invoke(world.buffer, device.writing, device.state)
            if code != 0:
                latch(servo, k, STATION, i, code)


@kernel
def stop(world: World) -> None:
    """Set all forces to zero and stop the devices, after a fault."""
    memory = Floats(world.buffer, 0)
    release(world)
    for finger in world.fingers:
        for a in range(world.dimensions):
            memory[finger.displayed + a] = 0.0
    for device in world.devices:
        if not device.plain:
            invoke(world.buffer, device.stopping, device.state)


# Record ---------------------------------------------------------------------------------------------------------------


@kernel
def record(world: World, k: int, r: int, rows: Floats) -> None:
    """Write the row of tick k, if this tick is recorded."""
    if world.recorded > 0 and k % world.every == 0:
        memory, columns = Floats(world.buffer, 0), world.columns
        row = r // world.every * world.width
        for c in range(world.recorded):
            rows[row + c] = memory[int(columns[c])]


# Move -----------------------------------------------------------------------------------------------------------------


@kernel
def move(world: World, servo: ServoState, k: int) -> None:
    """Move the bodies that kernels move, and send the wrenches of the others to the software that moves them.

    The forces of tick k have already been displayed and recorded. A fault of a body is therefore stored as a fault of
    tick k + 1, which is the first tick with zero forces.
    """
    memory = Floats(world.buffer, 0)
    for body in world.bodies:
        if memory[body.stuck] == 0.0:
            code = invoke_beside(world.buffer, body.stepping, body.state, body.beside, servo.period)
            if code != 0 and not body.guest:
                latch(servo, k + 1, MOVER, body.index, code)
                memory[body.stuck] = 1.0


@kernel
def exchange(world: World) -> None:
    """Exchange data with other software, which applies the wrenches, steps its bodies, and returns their motion."""
    memory = Floats(world.buffer, 0)
    for each in world.exchanges:
        if memory[each.stuck] == 0.0 and not world.failed:
            world.failed = call(world.buffer, each.address, each.plan) != 0


@kernel
def advance(world: World, servo: ServoState, k: int) -> None:
    """Move each plant by one sample, under the efforts of the plant's devices and the targets of the plant's hand."""
    memory, wires = Floats(world.buffer, 0), world.wires
    for plant in world.plants:
        if memory[plant.stuck] == 0.0:
            for w in range(plant.first, plant.first + plant.count):
                carry(memory, wires[w])
            if plant.hand_kind != STILL:
                ask(world, plant, servo, k)
            code = invoke(world.buffer, plant.kernel, plant.state)
            if code != 0:
                latch(servo, k + 1, PLANT, plant.index, code)
                memory[plant.stuck] = 1.0


@kernel
def ask(world: World, plant: Plant, servo: ServoState, k: int) -> None:
    """Compute a hand's targets at the end of the next sample and, if the plant needs them, at its middle."""
    memory, n, T = Floats(world.buffer, 0), plant.width, servo.period
    position, velocity = plant.target_position, plant.target_velocity
    if plant.middle_position != NONE:
        if plant.hand_kind == TABLE:
            position = plant.hand + (k - servo.table_start) * 4 * n + 2 * n
            velocity = position + n
        elif plant.hand_kind == KERNEL:
            invoke_at(world.buffer, plant.hand_kernel, plant.hand, 0.5 * (k * T + (k + 1) * T))
        copy(memory, plant.middle_position, position, n)
        copy(memory, plant.middle_velocity, velocity, n)
    if plant.hand_kind == TABLE:
        position = plant.hand + (k - servo.table_start) * (4 * n if plant.middle_position != NONE else 2 * n)
        velocity = position + n
    elif plant.hand_kind == KERNEL:
        invoke_at(world.buffer, plant.hand_kernel, plant.hand, (k + 1) * T)
    copy(memory, plant.end_position, position, n)
    copy(memory, plant.end_velocity, velocity, n)
