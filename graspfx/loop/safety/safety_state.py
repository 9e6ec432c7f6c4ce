"""Memory of the safety chain: one record for the scene, and one for each object."""

from __future__ import annotations

from graspfx.compile.records import Floats, Many, Record, floats, many
from graspfx.spatial import Vector, Vector4


class Pace(Record):
    """State of the scene's chain: soft start, and trust in the readings."""

    devices: int
    ramp: float  # length of the soft start [ticks]
    hold: float  # number of successive samples without a new reading that are tolerated
    fading: float  # decrease of the trust per sample
    soft: float  # factor of the soft start, which rises from 0 to 1
    trust: float  # 1, or less while forces decay
    cause: int  # cause of the decay, 0 without one
    host: int  # 1 + reason why the forces of another program fade, 0 if they do not fade
    resting: bool  # forces decay because the run ends, which is no fault
    elapsed: float  # periods since the last tick, 1 unless ticks were skipped
    misses: Floats = floats("devices")  # successive samples without a new reading


class Tank(Record):
    """Energy available to increase stiffness; without it, stiffening a loaded spring would generate energy."""

    level: float  # energy E [J]
    most: float  # capacity [J]
    booked: float  # energy dissipated by damping and brakes so far, from the ledger [J]


class Goal(Record):
    """Target values of scalar gains."""

    external_stiffness: float  # kep [N/m]
    external_damping: float  # ked [N s/m]
    internal_stiffness: float  # kip [N/m]
    internal_damping: float  # kid [N s/m]


class Scale(Record):
    """Factors by which a sample scales the law's force."""

    soft: float  # soft start, limited by the energy in the tank
    trust: float  # trust in the readings
    squeeze: float  # lambda, on the internal force only
    outer: float  # smallest factor on the whole force of a finger


class PastReading(Record):
    """A finger's past position and the time of its reading."""

    position: Vector  # [m]
    time: float  # [periods]


class FingerLimits(Record):
    """A finger's limits and its last force."""

    number: int  # index of the finger in the scene
    force: float  # largest force [N]
    growth: float  # largest growth of a force in one sample [N]
    speed: float  # largest speed [m/s]
    stride: float  # distance covered at that speed in one period [m]
    lower: Vector  # corners of the box out of which no force pushes the finger, infinite without a box [m]
    upper: Vector
    largest: float  # largest force in this sample, including the device's limit [N]
    last: Vector  # force on the object in the last sample, W [N]
    withheld: Vector4  # negative of the force removed after the brake, O [N]
    time: float  # time so far [periods]
    elapsed: float  # duration of the last step [periods], 0 without a step
    track: Many[PastReading] = many("4")  # its most recent new readings, latest first


class SafetyState(Record):
    """State of one object's chain, stored next to its block."""

    count: int  # n
    posed: bool  # the block contains friction problems
    apart: bool  # frictionless fingers can only push: unequal gains give forces along rays
    kep_moves: bool  # kep may change during a run
    ked_moves: bool
    kip_moves: bool
    kid_moves: bool
    changing: bool  # gains are changing to `goal`
    gain: float  # gamma, factor of stiffness and damping in this sample
    elapsed: float  # longest of the fingers' last steps, at least 1 [periods]
    tank: Tank
    goal: Goal
    scale: Scale
    fingers: Many[FingerLimits] = many("count")
