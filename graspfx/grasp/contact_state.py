"""Contacts, free directions and rigid modes as they stand in a block: what the split of a sample is made of."""

from __future__ import annotations

from graspfx.compile.kernel import inline
from graspfx.compile.records import Floats, Many, Record, many
from graspfx.spatial import Matrix, Vector


class Contact(Record):
    """A contact of a finger, in the object's axes."""

    contact: Vector  # c: on the surface, which for a ball fingertip is grown by its radius [m]
    normal: Vector  # into the object
    patch: float  # rho of a soft finger, 0 of a hard one [m]
    weight: float


class FramedContact(Contact):
    """A contact with axes of its own."""

    frame: Matrix  # normal and tangents as rows


class Direction(Record):
    """A direction of unit length."""

    vector: Vector


class Freedom(Record):
    """The directions in which an object is free: of translation first, then axes of rotation about its centre."""

    shifts: int  # free translations
    turns: int  # free rotations
    axes: Many[Direction] = many("6")  # in the object's axes


class ModeMotion(Record):
    """A finger's part of a rigid mode."""

    shift: Vector
    twist: float  # times the patch length; only where some finger is soft


@inline
def motion_of(mode: Floats, i: int, width: int) -> ModeMotion:
    """Give finger i's part of a mode, which is its blend, then `width` entries for each finger."""
    return ModeMotion(mode.buffer, mode.offset + (1 + width * i))
