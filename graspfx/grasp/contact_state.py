"""Records of contacts, free directions and rigid modes, which are the input and output of a sample's split."""

from __future__ import annotations

from graspfx.compile.kernel import inline
from graspfx.compile.records import Floats, Many, Record, many
from graspfx.spatial import Matrix, Vector


class Contact(Record):
    """A contact of a finger, in the object's axes."""

    contact: Vector  # c on the surface; for a ball fingertip, on the surface offset by the radius [m]
    normal: Vector  # unit normal into the object
    patch: float  # patch length rho of a soft finger, 0 for a hard one [m]
    weight: float


class FramedContact(Contact):
    """A contact with its frame."""

    frame: Matrix  # normal and tangents as rows


class Direction(Record):
    """A direction of unit length."""

    vector: Vector


class Freedom(Record):
    """The directions in which an object is free: translations first, then axes of rotation about its centre."""

    shifts: int  # number of free translations
    turns: int  # number of free rotations
    axes: Many[Direction] = many("6")  # in the object's axes


class ModeMotion(Record):
    """Motion of a finger in a rigid mode."""

    shift: Vector
    twist: float  # torsion times the patch length, if some finger is soft


@inline
def motion_of(mode: Floats, i: int, width: int) -> ModeMotion:
    """Return finger i's part of a mode. A mode's row contains the blend, then `width` entries per finger."""
    return ModeMotion(mode.buffer, mode.offset + (1 + width * i))
