"""The ledger of one object's energy in a block: accounts, the fingers' forces and the report."""

from __future__ import annotations

from graspfx.compile.records import Floats, Many, Record, Ref, Table, floats, many, table
from graspfx.grasp.contact_state import Contact
from graspfx.loop.energy.leak import Accounts, ModeSplit, Sum
from graspfx.objects.energy import SampleStart
from graspfx.spatial import Matrix, Vector, Vector4


class PartForce(Record):
    """A force of one mode."""

    force: Vector4  # [N]


class ForceByMode(Record):
    """The parts Q_j'f of a force: internal, translation, rotation; they sum to it."""

    parts: Many[PartForce] = many("3")


class FingerBooks(Contact):
    """A finger: its forces over the sample and its steps, in the object's axes unless stated."""

    place: Vector  # of the fingertip, world [m]
    arm: Vector  # from the object's centre to where its force acts, world [m]
    twist: Vector  # direction of torsion times rho, world [m]
    push: Vector  # the held force on the object, world [N]
    step: Vector4  # d, of the finger against the object [m]
    tip: Vector4  # the fingertip's own step [m]
    force: Vector4  # the elastic force now; then the whole one [N]
    brake: Vector4  # fb now [N]
    withheld: Vector4  # fw now, minus what the safety chain has taken from the force after the brake [N]
    held_stretch: Vector4  # h [m]
    stretch: Vector4  # h+ [m]
    held_force: ForceByMode  # f
    held_elastic: ForceByMode  # fe
    held_brake: ForceByMode  # fb
    held_withheld: ForceByMode  # fw
    elastic: ForceByMode  # fe now


class ModeLosses(Record):
    """Losses of one mode by their causes [J]."""

    damped: Sum
    braked: Sum
    slipped: Sum
    reshaped: Sum
    leaked: Sum


class EnergyReport(Record):
    """Energies for a recording [J]: by mode (internal, translation, rotation), then of the object."""

    work: Vector
    stored: Vector
    damped: Vector
    slipped: Vector
    reshaped: Vector
    leaked: Vector
    balance: Vector
    braked: Vector
    damping: Vector  # as added [N s/m]
    fingers: float
    wrench: float
    kinetic: float
    gravity: float
    contact: float
    viscous: float
    defect: float
    gap: float


class LedgerState(Record):
    """The ledger of one object, beside its block."""

    count: int  # n
    components: int  # of the forces where gains are matrices with cones: then h = K^-1 fe; else 0
    control: bool  # modes that leak are braked (`watch`)
    guarded: bool  # forces pass a safety chain: stiffness is gamma K, and a part may be withheld after the brake
    gain: float  # gamma of this sample, where there is a chain
    foreign: bool  # not our integrator: the work of obstacles is the remainder
    elapsed: float  # periods that the fingers' last steps took, the most: 1 where none is left out or without a reading
    drag: float  # least friction b_i/w_i of the devices [N s/m]
    mobility: float  # largest w_i/m_i of the devices [1/kg]
    split: Ref[ModeSplit]
    split_entries: int
    curved: Vector  # a tenth of what the elastic forces of pads make with their depths now, by mode [J]
    held_curved: Vector  # of the held forces
    started: bool
    scale: float  # the largest energy so far [J]
    accounts: Accounts
    losses: Many[ModeLosses] = many("3")
    finger_work: Sum
    wrench_work: Sum
    gravity_work: Sum
    contact_work: Sum
    viscous_loss: Sum
    defect: Sum  # of the integrator
    start: SampleStart  # of the body
    frame: Matrix  # axes that the held forces are in
    first_energy: float  # kinetic, at the start of the run [J]
    report: EnergyReport
    fingers: Many[FingerBooks] = many("count")
    square: Table = table("components", "components")  # K, while h is solved for
    vector: Floats = floats("components")  # fe, then h
    split_room: Floats = floats("split_entries")
