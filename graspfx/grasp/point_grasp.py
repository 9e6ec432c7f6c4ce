"""Block of point contacts on a free object: gains, points, displacements, rates and forces."""

from __future__ import annotations

from graspfx.compile.kernel import inline
from graspfx.compile.records import Floats, Record, floats
from graspfx.spatial import Vector

NOISE = 4.5e-16  # relative: contacts closer than two roundings of their coordinates coincide


class PointGrasp(Record):
    """Equally weighted contacts on an object that is free to move. Each array is ordered contact by contact."""

    count: int  # n
    dimensions: int  # d
    external_stiffness: float  # kep [N/m]
    external_damping: float  # ked [N s/m]
    internal_stiffness: float  # kip [N/m]
    internal_damping: float  # kid [N s/m]
    tolerance: float  # relative to the contacts' rms radius; contacts closer to a line do not rotate about it
    rank: int  # rank of G at the last call
    points: Floats = floats("count * dimensions")  # [m]
    displacement: Floats = floats("count * dimensions")  # e [m]
    rate: Floats = floats("count * dimensions")  # e' [m/s]
    force: Floats = floats("count * dimensions")  # f, on the object [N]

    @property
    def stiffness(self) -> float:
        """The difference kep - kip."""
        return self.external_stiffness - self.internal_stiffness

    @property
    def damping(self) -> float:
        """The difference ked - kid."""
        return self.external_damping - self.internal_damping


@inline
def vector_at(numbers: Floats, j: int) -> Vector:
    """Read the vector that starts at entry j."""
    return Vector(numbers[j], numbers[j + 1], numbers[j + 2])
