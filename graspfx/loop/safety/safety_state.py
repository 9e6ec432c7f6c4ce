"""The memories of the safety chain: one of the scene, and one beside each object's block."""

from __future__ import annotations

from graspfx.compile.records import Floats, Many, Record, floats, many
from graspfx.spatial import Vector, Vector4


class Pace(Record):
    """The chain of the whole scene: its soft start, and the trust in its readings."""

    devices: int
    ramp: float  # ticks of the soft start
    hold: float  # samples in a row without a new reading that are let pass
    fading: float  # of the trust, in one sample
    soft: float  # of the soft start: 0 at first, then 1
    trust: float  # 1, or less while forces decay
    cause: int  # why they do, 0 for no reason
    host: int  # 1 more than why another program's forces are to fade, 0 for no reason
    resting: bool  # they do as the run ends, which is no fault
    elapsed: float  # periods since the last tick, 1 unless some were left out
    misses: Floats = floats("devices")  # samples in a row without a new reading


class Tank(Record):
    """Energy that pays for stiffness: what stiffer springs store at once, nobody has put into them."""

    level: float  # E [J]
    most: float  # that it holds [J]
    booked: float  # taken by damping and brakes so far, as the ledger has it [J]


class Goal(Record):
    """Gains that are on their way, as numbers."""

    external_stiffness: float  # kep [N/m]
    external_damping: float  # ked [N s/m]
    internal_stiffness: float  # kip [N/m]
    internal_damping: float  # kid [N s/m]


class Scale(Record):
    """Shares of the law's force that a sample leaves."""

    soft: float  # soft start, as far as the tank has paid for it
    trust: float  # in the readings
    squeeze: float  # lambda, of what squeezes only
    outer: float  # of the whole force of a finger, the least


class PastReading(Record):
    """Where a finger was read, and when."""

    position: Vector  # [m]
    time: float  # in periods


class FingerLimits(Record):
    """A finger's limits, and its force in the last sample."""

    number: int  # in the scene
    force: float  # largest force [N]
    growth: float  # largest growth of a force in one sample [N]
    speed: float  # largest speed [m/s]
    stride: float  # the way at that speed in one period [m]
    lower: Vector  # corners of the box that no force pushes it out of, infinite where there is none [m]
    upper: Vector
    largest: float  # its force in this sample, by the device too [N]
    last: Vector  # force on the object in the last sample, W [N]
    withheld: Vector4  # minus what was taken from its force after the brake, O [N]
    time: float  # so far, in periods
    elapsed: float  # periods that its last step took, 0 without a step
    track: Many[PastReading] = many("4")  # its last new readings, the latest first


class SafetyState(Record):
    """The chain of one object, beside its block."""

    count: int  # n
    posed: bool  # friction problems stand in the block
    apart: bool  # fingers may only push, without friction: forces along rays where gains are not equal
    kep_moves: bool  # may change in mid-run
    ked_moves: bool
    kip_moves: bool
    kid_moves: bool
    changing: bool  # gains are on their way to `goal`
    gain: float  # gamma, of stiffness and damping in this sample
    elapsed: float  # periods that the fingers' last steps took, the most
    tank: Tank
    goal: Goal
    scale: Scale
    fingers: Many[FingerLimits] = many("count")
