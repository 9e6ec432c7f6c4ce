"""Memory of the safety chain: one record for the scene, and one for each object."""

from __future__ import annotations

from graspfx.compile.records import Floats, Many, Record, floats, many
from graspfx.spatial import Vector, Vector4


class Pace(Record):
    """State of the safety chain for a scene: soft start, and trust in the readings."""

    devices: int
    ramp: float  # duration of the soft start [ticks]
    hold: float  # largest number of successive samples without a new reading
    fading: float  # decrease of the trust per sample
    soft: float  # factor of the soft start, which increases from 0 to 1
    trust: float  # factor of the trust: 1, or less while forces decay
    cause: int  # cause of the decay of forces, 0 if there is none
    host: int  # 1 + reason why the forces of another program decay, 0 if they do not decay
    resting: bool  # forces decay because the run ends, which is not a fault
    elapsed: float  # periods since the last tick, 1 unless ticks were skipped
    misses: Floats = floats("devices")  # successive samples without a new reading


class Tank(Record):
    """Energy tank: the energy that is available for increases of stiffness."""

    level: float  # energy E [J]
    most: float  # capacity [J]
    booked: float  # total energy dissipated by damping and brakes when the tank was last filled, from the ledger [J]


class Goal(Record):
    """Target values of the scalar gains of an object."""

    external_stiffness: float  # kep [N/m]
    external_damping: float  # ked [N s/m]
    internal_stiffness: float  # kip [N/m]
    internal_damping: float  # kid [N s/m]


class Scale(Record):
    """Factors by which the safety chain multiplies the forces of the coupling law in one sample."""

    soft: float  # soft start, limited by the energy in the tank
    trust: float  # trust in the readings
    squeeze: float  # factor lambda of the internal force
    outer: float  # smallest factor of the whole force of a finger


class PastReading(Record):
    """Past position of a finger, and the time at which the position was read."""

    position: Vector  # [m]
    time: float  # [periods]


class FingerLimits(Record):
    """Limits and last force of a finger."""

    number: int  # index of the finger in the scene
    force: float  # largest force [N]
    growth: float  # largest growth of the force in one sample [N]
    speed: float  # largest speed [m/s]
    stride: float  # largest distance in one period, speed T [m]
    lower: Vector  # lower corner of the workspace, infinite without a limit [m]
    upper: Vector  # upper corner of the workspace, infinite without a limit [m]
    largest: float  # largest force in this sample, including the device's limit [N]
    last: Vector  # force on the object in the last sample, in world axes [N]
    withheld: Vector4  # negative of the force that the chain removed after the brake, in the object's axes [N]
    time: float  # time since the start [periods]
    elapsed: float  # time between the last two new readings [periods]; 0 if the last reading was not new
    track: Many[PastReading] = many("4")  # last four new readings, latest first


class SafetyState(Record):
    """State of the safety chain for one object."""

    count: int  # number of fingers n
    posed: bool  # the object's block contains friction problems
    apart: bool  # fingers are frictionless and can only push, so unequal gains give forces along rays
    kep_moves: bool  # kep may change during a run
    ked_moves: bool
    kip_moves: bool
    kid_moves: bool
    changing: bool  # gains are changing to `goal`
    gain: float  # gamma, factor of stiffness and damping in this sample
    elapsed: float  # largest `elapsed` of the fingers, at least 1 [periods]
    tank: Tank
    goal: Goal
    scale: Scale
    fingers: Many[FingerLimits] = many("count")
