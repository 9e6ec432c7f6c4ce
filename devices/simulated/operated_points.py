"""Point masses held by an operator model with more than a spring and a damper, integrated by Taylor series."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from graspfx.devices._plant import NOT_FINITE, HeldPlant, PlantState, unfit
from graspfx.protocols import (
    FingerOperator,
    Floats,
    Hand,
    InputError,
    Many,
    Operator,
    Record,
    Table,
    elementary,
    floats,
    kernel,
    layout,
    many,
    table,
)

FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]


WAVES = 24  # number of sines in a finger's noise, as in `FingerOperator`
SHORT = 2.0  # substeps per unit of T b/m and T (k/m)^1/2 for which `TERMS` terms reach rounding error
TERMS = 20  # number of terms of a series
MOST = 4096  # largest number of substeps per sample; no realistic hand needs as many

TOO_STIFF = 2  # code of the kernel for too many substeps


class OperatedFinger(Record):
    """State of the operator of one finger, and the operator's coefficients for a sample."""

    grip: float  # grip force G, the magnitude of the displayed force after a first-order lag [N]
    grip_share: float  # factor exp(-T/lag) of the grip force; 0 without a lag
    command_share: float  # factor exp(-T/lag) of the muscle force; 0 without a lag
    delay: int  # delay of the reaction [samples]
    now: FingerOperator


class Strand(Record):
    """Taylor series of one finger on one axis in one substep: two coefficients of each series, and sums.

    p is the position of the tip, y of the limb and r of the target; r_0 is r at the beginning of the sample.
    """

    tip: float  # series of p - r_0
    tip_next: float
    tip_sum: float
    tip_rate: float
    limb: float  # series of y - r_0
    limb_next: float
    limb_sum: float
    limb_rate: float
    stretch: float  # series of y - p
    stretch_rate: float
    first: float  # coefficients of r - r_0 in powers of the substep
    second: float
    third: float
    fourth: float


class OperatedPlantState(PlantState):  # type: ignore[misc] # mypy does not see devices from inside the package
    """Point masses, the gains of the hand that holds them, and the operator of each finger with its memory."""

    room: int  # number of samples in the line of reactions
    slot: int  # row of the line to fill next
    series: int  # number of substeps of the last sample
    strands: Many[Strand] = many("fingers")
    operators: Many[OperatedFinger] = many("fingers")
    mass: Floats = floats("fingers")  # [kg]
    friction: Floats = floats("fingers")  # [N s/m]
    stiffness: Floats = floats("fingers * fingers * dimensions")  # K, axis by axis [N/m]
    damping: Floats = floats("fingers * fingers * dimensions")  # B [N s/m]
    limb: Floats = floats("fingers * dimensions")  # y [m]
    limb_rate: Floats = floats("fingers * dimensions")  # [m/s]
    command: Floats = floats("fingers * dimensions")  # F_m, muscle force after its lag [N]
    pull: Floats = floats("fingers * dimensions")  # h, force of reaction and noise, held over the sample [N]
    line: Table = table("room", "fingers * dimensions")  # future reactions [N]


@kernel
def advance(plant: OperatedPlantState) -> int:
    """Advance the plant by one sample; targets at the end of the sample become targets at the beginning of the next.

    Gains, grip forces, and the force h of reaction and noise are held over the sample; tips and limbs then satisfy
    linear equations. Returns 0; if it returns NOT_FINITE or TOO_STIFF, the plant has not moved.
    """
    step = plant.fingers * plant.dimensions
    code: int = unfit(plant.effort, 5, step)
    if code != 0:
        return code
    grasp_force(plant)
    count = substeps(plant)
    if count < 1:
        return TOO_STIFF
    respond(plant)
    for axis in range(plant.dimensions):
        for k in range(count):
            move(plant, axis, k, count)
    r0, dr0, r1, dr1 = plant.start, plant.start_rate, plant.end, plant.end_rate
    for i, finger in enumerate(plant.operators):
        for c in range(i * plant.dimensions, (i + 1) * plant.dimensions):
            r0[c], dr0[c] = r1[c], dr1[c]
            if finger.now.limb_mass == 0.0:  # y equals r, so that a limb that is enabled during a run starts there
                plant.limb[c], plant.limb_rate[c] = r1[c], dr1[c]
    plant.series = count
    plant.ticks += 1.0
    return 0


@kernel
def grasp_force(plant: OperatedPlantState) -> None:
    """Update each finger's grip force from the force displayed to it."""
    d, u = plant.dimensions, plant.effort
    for i, finger in enumerate(plant.operators):
        if finger.now.rise != 0.0 or finger.now.damping_rise != 0.0:
            square = 0.0
            for a in range(d):
                square += u[i * d + a] * u[i * d + a]
            force = math.sqrt(square)
            finger.grip = force + finger.grip_share * (finger.grip - force)


@kernel
def substeps(plant: OperatedPlantState) -> int:
    """Return the number of substeps for which the series converge to rounding error; 0 if this number exceeds MOST."""
    n, d, T = plant.fingers, plant.dimensions, plant.period
    largest = 0.0
    for a in range(d):
        for i, finger in enumerate(plant.operators):
            K = finger.now.rise * finger.grip
            B = finger.now.damping_rise * finger.grip
            for j in range(n):
                K += abs(plant.stiffness[(a * n + i) * n + j])
                B += abs(plant.damping[(a * n + i) * n + j])
            m, M = plant.mass[i], finger.now.limb_mass
            largest = max(largest, T * (B + plant.friction[i]) / m, T * math.sqrt(K / m))
            if M > 0.0:
                K += finger.now.limb_stiffness[a]
                B += finger.now.limb_damping[a]
                largest = max(largest, T * B / M, T * math.sqrt(K / M))
    if not SHORT * largest < MOST:
        return 0
    return int(SHORT * largest) + 1


@kernel
def respond(plant: OperatedPlantState) -> None:
    """Compute the force h of reaction and noise on each finger, and store the present reaction in the delay line."""
    d = plant.dimensions
    now = plant.since + plant.ticks * plant.period
    slot, room = plant.slot, plant.room
    x, v, u, r, dr = plant.position, plant.velocity, plant.effort, plant.start, plant.start_rate
    for i, finger in enumerate(plant.operators):
        own = finger.now
        noise = 0.0
        if own.share != 0.0:
            for k in range(WAVES):
                noise += elementary.sin(own.frequency[k] * now + own.phase[k])
            noise *= own.share * math.sqrt(2.0 / WAVES)
        for a in range(d):
            c = i * d + a
            h = 0.0
            if room > 0:
                reaction = own.pull * (r[c] - x[c]) + own.pull_damping * (dr[c] - v[c]) - own.counter * u[c]
                plant.line[slot, c] = reaction
                past = slot - finger.delay
                if past < 0:
                    past += room
                h = plant.line[past, c]
            if own.share != 0.0:
                force = muscle(plant, i, a)
                plant.command[c] = force + finger.command_share * (plant.command[c] - force)
                h += noise * plant.command[c]
            plant.pull[c] = h
    if room > 0:
        plant.slot = slot + 1 if slot + 1 < room else 0


@kernel
def muscle(plant: OperatedPlantState, i: int, a: int) -> float:
    """Compute the force on axis a of the springs and dampers from the intended position to finger i or its limb [N]."""
    n, d = plant.fingers, plant.dimensions
    own = plant.operators[i]
    c = i * d + a
    if own.now.limb_mass > 0.0:
        e, de = plant.start[c] - plant.limb[c], plant.start_rate[c] - plant.limb_rate[c]
        pull: float = own.now.limb_stiffness[a] * e + own.now.limb_damping[a] * de
        return pull
    e, de = plant.start[c] - plant.position[c], plant.start_rate[c] - plant.velocity[c]
    force: float = own.grip * (own.now.rise * e + own.now.damping_rise * de)
    for j in range(n):
        b = j * d + a
        e, de = plant.start[b] - plant.position[b], plant.start_rate[b] - plant.velocity[b]
        force += plant.stiffness[(a * n + i) * n + j] * e + plant.damping[(a * n + i) * n + j] * de
    return force


@kernel
def move(plant: OperatedPlantState, axis: int, k: int, count: int) -> None:
    """Move all fingers on one axis over the k-th of `count` substeps, by the Taylor series of the motion.

        m (j + 1)(j + 2) p_(j+2) = h^2 (F_j + u_j) - h b (j + 1) p_(j+1)

    p_j are the coefficients of the motion of a tip with mass m and damping b in powers of s = t/h, for the time t in a
    substep of length h; F_j are those of the hand's force. u_0 is the sum of the forces held over the sample, and the
    other u_j are zero. The coefficients of a limb are computed in the same way.
    """
    d, T = plant.dimensions, plant.period
    h = T / count
    begin(plant, axis, k, count)
    for j in range(TERMS):
        for i, strand in enumerate(plant.strands):
            target = target_rate = 0.0
            if j < 4:
                target, target_rate = target_terms(strand, j)
            if plant.operators[i].now.limb_mass > 0.0:
                strand.stretch = strand.limb - strand.tip
                strand.stretch_rate = (j + 1) * (strand.limb_next - strand.tip_next) / h
            else:
                strand.stretch = target - strand.tip
                strand.stretch_rate = (target_rate - (j + 1) * strand.tip_next) / h
        for i, strand in enumerate(plant.strands):
            c = i * d + axis
            own = plant.operators[i]
            F = tip_force(plant, axis, i)
            scale = h * h / ((j + 1) * (j + 2))
            push = F - plant.friction[i] * (j + 1) * strand.tip_next / h
            if j == 0:
                push += plant.effort[c]
            if own.now.limb_mass > 0.0:
                target = target_rate = 0.0
                if j < 4:
                    target, target_rate = target_terms(strand, j)
                pull = own.now.limb_stiffness[axis] * (target - strand.limb) - F
                pull += own.now.limb_damping[axis] * (target_rate - (j + 1) * strand.limb_next) / h
                if j == 0:
                    pull += plant.pull[c]
                y = scale * pull / own.now.limb_mass
                strand.limb, strand.limb_next = strand.limb_next, y
                strand.limb_sum += y
                strand.limb_rate += (j + 2) * y
            elif j == 0:
                push += plant.pull[c]
            x = scale * push / plant.mass[i]
            strand.tip, strand.tip_next = strand.tip_next, x
            strand.tip_sum += x
            strand.tip_rate += (j + 2) * x
    for i, strand in enumerate(plant.strands):
        c = i * d + axis
        plant.position[c] += strand.tip_sum
        plant.velocity[c] = strand.tip_rate / h
        if plant.operators[i].now.limb_mass > 0.0:
            plant.limb[c] += strand.limb_sum
            plant.limb_rate[c] = strand.limb_rate / h


@kernel
def begin(plant: OperatedPlantState, axis: int, k: int, count: int) -> None:
    """Initialise the strands for substep k: the first two coefficients of each motion, and the cubic of each target."""
    d, T = plant.dimensions, plant.period
    h, e = T / count, 1.0 / count
    s = float(k) / float(count)
    for i, strand in enumerate(plant.strands):
        c = i * d + axis
        r0 = plant.start[c]
        away, begins, ends = plant.end[c] - r0, T * plant.start_rate[c], T * plant.end_rate[c]
        c2, c3 = 3.0 * away - 2.0 * begins - ends, begins + ends - 2.0 * away
        strand.first = ((c3 * s + c2) * s + begins) * s
        strand.second = e * (begins + s * (2.0 * c2 + 3.0 * c3 * s))
        strand.third = e * e * (c2 + 3.0 * c3 * s)
        strand.fourth = e * e * e * c3
        x, y = h * plant.velocity[c], h * plant.limb_rate[c]
        strand.tip, strand.tip_next, strand.tip_sum, strand.tip_rate = plant.position[c] - r0, x, x, x
        strand.limb, strand.limb_next, strand.limb_sum, strand.limb_rate = plant.limb[c] - r0, y, y, y


@kernel
def target_terms(strand: Strand, j: int) -> tuple[float, float]:
    """Return the coefficients of s^j in the cubic of a target, and in the derivative of the cubic with respect to s."""
    if j == 0:
        return strand.first, strand.second
    if j == 1:
        return strand.second, 2.0 * strand.third
    if j == 2:
        return strand.third, 3.0 * strand.fourth
    return strand.fourth, 0.0


@kernel
def tip_force(plant: OperatedPlantState, axis: int, i: int) -> float:
    """Compute a coefficient of the hand's force on finger i from the coefficients of the extensions of all springs."""
    n, own, strand = plant.fingers, plant.operators[i], plant.strands[i]
    force: float = own.grip * (own.now.rise * strand.stretch + own.now.damping_rise * strand.stretch_rate)
    for j, other in enumerate(plant.strands):
        at = (axis * n + i) * n + j
        force += plant.stiffness[at] * other.stretch + plant.damping[at] * other.stretch_rate
    return force


class OperatedPlant(HeldPlant):  # type: ignore[misc] # mypy does not see devices from inside the package
    """Point masses held by an operator; for the equations see `graspfx.loop.operator.Operator`.

    Efforts, grip forces and the forces of reaction and noise are held over a sample. Each target follows the cubic
    through the target's values and velocities at both ends of the sample, as for `PointPlant`. Tips and limbs then
    satisfy linear equations. The Taylor series of the motion are summed to rounding error, in as many substeps as
    necessary.

    Args:
        mass: Masses of the n fingertips (n,) [kg].
        damping: Viscous damping of the fingertips (n,) [N s/m].
        dimensions: Number of dimensions d.
        room: Number of samples of reactions in the delay line; 0 without a reaction.
        operator: Initial operator, which `hold` replaces by the operator of the hand; None for a default `Operator`.

    Attributes:
        live: Whether mechanics and hand may change during a run; always true.
    """

    kernel = staticmethod(advance)
    live = True

    def __init__(
        self,
        mass: Sequence[float],
        damping: Sequence[float],
        dimensions: int,
        room: int = 0,
        operator: Operator | None = None,
    ) -> None:
        super().__init__(OperatedPlantState, len(mass), dimensions, room=room)
        self._block = OperatedPlantState(self.state)
        self._block.room = room
        self._array("mass")[:], self._array("friction")[:] = mass, damping
        self._operator = Operator(len(mass)) if operator is None else operator

    def _array(self, name: str) -> FloatArray:
        values: FloatArray = self._block.array(getattr(OperatedPlantState, name))
        return values

    @property
    def structure(self) -> Index:
        """Indices of the entries `fingers`, `dimensions` and `room` in the block."""
        return np.array(
            [layout(OperatedPlantState)[name].place(self._block) for name in ("fingers", "dimensions", "room")]
        )

    def hold(self, hand: Hand, T: float) -> None:
        """Write the gains, the operator and the targets of the hand, and the period T [s], into the block."""
        operator = getattr(hand, "operator", None)
        self._operator = Operator(len(self.position)) if operator is None else operator
        super().hold(hand, T)

    def adopt(self, other: OperatedPlant) -> None:
        """Copy `mechanics` from another plant of the same structure; call `hold` afterwards."""
        self.mechanics = other.mechanics

    @property
    def mechanics(self) -> FloatArray:
        """Masses [kg], the operator's numbers, and dampings [N s/m], in two rows; call `hold` after a change."""
        own = [self._array("mass"), self._operator.numbers.ravel(), self._array("friction")]
        flat = np.concatenate(own)
        return np.asarray(np.append(flat, np.zeros(len(flat) % 2)).reshape(2, -1))

    @mechanics.setter
    def mechanics(self, values: FloatArray) -> None:
        n, flat = len(self.position), values.ravel()
        own = self._operator.numbers
        self._array("mass")[:], own[:] = flat[:n], flat[n : n + own.size].reshape(own.shape)
        self._array("friction")[:] = flat[n + own.size : 2 * n + own.size]

    def _put(self, position: FloatArray) -> None:
        """Place the limbs at the fingertips with zero velocity, and clear the operators' memory."""
        self._array("limb")[:] = position.ravel()
        for name in ("limb_rate", "command", "pull"):
            self._array(name)[:] = 0.0
        self._block.slot = 0
        self._line()[:] = 0.0
        for finger in self._block.operators:
            finger.grip = 0.0

    def _line(self) -> FloatArray:
        start = self._block.line.offset
        line: FloatArray = self.state[start : start + self._block.room * self.position.size]
        return line

    def _grip(self, K: FloatArray, B: FloatArray, T: float) -> None:
        self._array("stiffness")[:], self._array("damping")[:] = K.ravel(), B.ravel()
        for i, finger in enumerate(self._block.operators):
            own = self._operator.finger(i)
            start = finger.now.offset
            self.state[start : start + self._operator.numbers.shape[1]] = self._operator.numbers[i]
            finger.grip_share = elementary.exp(-T / own.grip_lag) if own.grip_lag > 0.0 else 0.0
            finger.command_share = elementary.exp(-T / own.command_lag) if own.command_lag > 0.0 else 0.0
            finger.delay = samples_of(own.delay, T)
            if self._block.room and finger.delay >= self._block.room:
                raise InputError(
                    "delay", own.delay, f"a delay of less than {self._block.room} samples, the delay line's size"
                )

    def fault_text(self, code: int) -> str:
        """Return the error message for a code of the kernel."""
        if code == TOO_STIFF:
            return (
                f"the operator's gains need more than {MOST} substeps per sample: a hand is too stiff or too strongly "
                "damped for the masses that it holds"
            )
        text: str = super().fault_text(NOT_FINITE)
        return text


def samples_of(delay: float, T: float) -> int:
    """Return a delay [s] as the nearest integer number of samples of T [s]; at least one if the delay is positive."""
    return max(1, round(delay / T)) if delay > 0.0 else 0


def room_for(delay: float, T: float) -> int:
    """Return the number of samples in the line for a delay [s]: 0 without a delay, otherwise a power of two.

    With powers of two, plants with similar delays have the same layout.
    """
    return 0 if delay <= 0.0 else 1 << samples_of(delay, T).bit_length()
