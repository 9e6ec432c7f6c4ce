"""Blocks of memory of hands: motions, rotations, single hands, guided hands, and joined hands."""

from __future__ import annotations

from graspfx.compile.records import Floats, Record, Table, floats, room, table
from graspfx.spatial import Vector

SINE, REACH, PATH, LEVELS, OTHER, TREMOR = range(1, 7)  # kinds of parts


class Displacement(Record):
    """Displacement and rate of a motion at one time; a motion in d dimensions uses the first d components."""

    value: Vector  # x [m, rad]
    rate: Vector  # x' [m/s, rad/s]


class MotionPart(Record):
    """Term of a motion; the blocks of all kinds of terms begin with these fields."""

    kind: int
    entries: int  # size of its block
    count: int  # number of points or levels
    dimensions: int  # d


class SinePart(MotionPart):
    """Term a s((t - begin) / ramp) sin(w (t - begin)) u, with the minimum-jerk step s; zero before `begin`."""

    amplitude: float  # a [m, rad]
    angular_frequency: float  # w = 2 pi f [rad/s]
    begin: float  # [s]
    ramp: float  # [s]
    direction: Vector  # u


class ReachPart(MotionPart):
    """Term s((t - begin) / duration) displacement, with the minimum-jerk step s."""

    begin: float  # [s]
    duration: float  # [s]
    displacement: Vector  # [m, rad]


class PathPart(MotionPart):
    """Piecewise cubic path. Row k of `cubics` contains d coefficients of (t - times[k])^3, then ^2, ^1 and ^0."""

    times: Floats = floats("count")  # [s]
    cubics: Table = table("count - 1", "4 * dimensions")
    last: Floats = floats("dimensions")  # position after the last time


class LevelsPart(MotionPart):
    """One-dimensional term with steps between levels."""

    begins: Floats = floats("count")  # [s]
    durations: Floats = floats("count")  # [s]
    levels: Floats = floats("count + 1")  # [m, rad]; the first is zero


class TremorPart(MotionPart):
    """Sum of `count` sines on each axis, with random frequencies and phases."""

    amplitude: float  # amplitude of each sine [m]
    begin: float  # [s]
    ramp: float  # [s]
    frequency: Table = table("dimensions", "count")  # [rad/s]
    phase: Table = table("dimensions", "count")  # [rad]


class OtherPart(MotionPart):
    """Third-party motion, whose present value is written by Python."""

    now: Displacement


class Course(Record):
    """Motion as the sum of its terms."""

    count: int  # number of parts
    entries: int  # size of all parts
    parts: Floats = floats("entries")  # `MotionPart`, one after another


class Turning(Record):
    """Rotation of all targets about an axis through a point."""

    course_entries: int
    centre: Vector  # c [m]
    axis: Vector  # u, of length one
    now: Displacement  # present angle
    angle: Course = room("course_entries")  # angle as a function of time


class HandState(Record):
    """Hand with n fingers in d dimensions; arrays are (n, d), flattened finger by finger."""

    fingers: int  # n
    dimensions: int  # d
    squeeze_entries: int
    motion_entries: int
    turns: int  # number of turns
    turn_entries: int  # size of all turns
    closing: Displacement  # present squeeze
    shift: Displacement  # present motion
    position: Floats = floats("fingers * dimensions")  # r [m]
    velocity: Floats = floats("fingers * dimensions")  # r' [m/s]
    rest: Floats = floats("fingers * dimensions")  # [m]
    along: Floats = floats("fingers * dimensions")  # displacement of each finger per unit of the squeeze
    squeeze: Course = room("squeeze_entries")
    motion: Course = room("motion_entries")
    turning: Floats = floats("turn_entries")  # `Turning`, one after another


class GuidedHandState(Record):
    """Hand whose targets are displaced by goals, each smoothed by a follower."""

    fingers: int  # n
    dimensions: int  # d
    hand_entries: int
    lag: float  # time constant tau of the followers [s]
    time: float  # time of the followers [s]
    squeeze_goal: float  # [m]
    squeeze: float  # state of the follower of the squeeze [m]
    squeeze_rate: float  # [m/s]
    goal: Floats = floats("fingers * dimensions")  # goal of the offsets [m]
    lead: Floats = floats("fingers * dimensions")  # offsets, states of their followers [m]
    lead_rate: Floats = floats("fingers * dimensions")  # [m/s]
    hand: HandState = room("hand_entries")


class JoinedHandsState(Record):
    """Several hands as one hand; the blocks of the hands follow this record."""

    hands: int
    fingers: int  # total number n
    dimensions: int  # d
    starts: Floats = floats("hands")  # offset of each block, negative for a guided hand; 0 for targets from Python
    position: Floats = floats("fingers * dimensions")  # r [m]
    velocity: Floats = floats("fingers * dimensions")  # r' [m/s]
    sources: Table = table("fingers", "2")  # offsets of each finger's r and r' from this record
