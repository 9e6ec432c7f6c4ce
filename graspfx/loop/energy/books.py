"""Memory of the ledger of one object's energy: accounts, forces of fingers, and energies for the recording."""

from __future__ import annotations

from graspfx.compile.records import Floats, Many, Record, Ref, Table, floats, many, table
from graspfx.grasp.rigid_modes import Contact
from graspfx.loop.energy.leak import Accounts, ModeSplit, Sum
from graspfx.objects.energy import SampleStart
from graspfx.spatial import Matrix, Vector, Vector4


class PartForce(Record):
    """Component of a finger's force in one kind of motion."""

    force: Vector4  # [N]


class ForceByMode(Record):
    """Components of a finger's force for internal motion, translation and rotation; the force is their sum."""

    parts: Many[PartForce] = many("3")


class FingerBooks(Contact):
    """Forces of a finger in the sample and steps of the finger, in the object's axes unless stated otherwise.

    The symbols are those of `graspfx.loop.energy.ledger`.
    """

    place: Vector  # position of the fingertip, world [m]
    arm: Vector  # vector from the object's centre to the point of application, world [m]
    twist: Vector  # direction of torsion times rho, world [m]
    push: Vector  # force held on the object, world [N]
    step: Vector4  # d, step of the finger relative to the object [m]
    tip: Vector4  # step of the fingertip [m]
    force: Vector4  # elastic force of this sample, then the whole force [N]
    brake: Vector4  # brake force fb of this sample [N]
    withheld: Vector4  # fw of this sample, negative of the force that the safety chain removed after the brake [N]
    held_stretch: Vector4  # h [m]
    stretch: Vector4  # h+ [m]
    held_force: ForceByMode  # f
    held_elastic: ForceByMode  # fe
    held_brake: ForceByMode  # fb
    held_withheld: ForceByMode  # fw
    elastic: ForceByMode  # fe of this sample


class ModeLosses(Record):
    """Energies of one kind of motion by cause [J], as in `graspfx.loop.energy.ledger`."""

    damped: Sum
    braked: Sum
    slipped: Sum
    reshaped: Sum
    leaked: Sum


class EnergyReport(Record):
    """Energies for a recording [J].

    Vectors contain one energy each for internal motion, translation and rotation. Floats belong to the whole object.
    """

    work: Vector
    stored: Vector
    damped: Vector
    slipped: Vector
    reshaped: Vector
    leaked: Vector
    balance: Vector
    braked: Vector
    damping: Vector  # damping added [N s/m]
    fingers: float
    wrench: float
    kinetic: float
    gravity: float
    contact: float
    viscous: float
    defect: float
    gap: float


class LedgerState(Record):
    """Ledger of one object."""

    count: int  # number of fingers n
    components: int  # number of force components if h = K^-1 fe is solved for, with matrix gains and cones; otherwise 0
    control: bool  # the passivity controller damps modes that generate energy (`watch`)
    guarded: bool  # a safety chain scales the stiffness to gamma K and may reduce forces after the brake
    gain: float  # gamma of this sample, if there is a safety chain
    foreign: bool  # another integrator moves the object, so the work of obstacles is the remainder
    elapsed: float  # longest of the fingers' last steps [periods], at least 1
    drag: float  # smallest friction b_i/w_i of the devices [N s/m]
    mobility: float  # largest w_i/m_i of the devices [1/kg]
    split: Ref[ModeSplit]
    split_entries: int
    curved: Vector  # a tenth of the elastic forces of pads times the depths of the pads, by mode [J]
    held_curved: Vector  # `curved` of the sample whose forces are held [J]
    started: bool
    scale: float  # largest energy so far [J]
    accounts: Accounts
    losses: Many[ModeLosses] = many("3")
    finger_work: Sum
    wrench_work: Sum
    gravity_work: Sum
    contact_work: Sum
    viscous_loss: Sum
    defect: Sum  # energy defect of the integrator
    start: SampleStart  # state of the body at the start of the sample
    frame: Matrix  # axes of the held forces
    first_energy: float  # kinetic energy at the start of the run [J]
    report: EnergyReport
    fingers: Many[FingerBooks] = many("count")
    square: Table = table("components", "components")  # stiffness K while h is solved for
    vector: Floats = floats("components")  # right-hand side fe, then the solution h
    split_room: Floats = floats("split_entries")
