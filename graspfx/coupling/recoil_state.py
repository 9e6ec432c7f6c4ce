"""State, in a block, of an object's motion within a sample (`coupling.recoil`, `coupling.flexibility`)."""

from __future__ import annotations

from graspfx.compile.records import Floats, Record, Table, floats, size_for, table


class RecoilState(Record):
    """Levers, linear systems and columns of the law, if its forces move the object within the sample.

    Directions are the object's free directions, translations first. Columns are the columns V of a law
    K = W^1/2 (A - V E V') W^1/2.
    """

    most: int  # largest number of columns
    twisted: bool  # torsion acts along axes other than the normals, so elastic levers are not sums of modes
    distant: bool  # rates and damping levers refer to the fingertips, not the contacts
    current: bool  # elastic levers belong to the present modes
    stuck: bool  # all forces of the last sample were inside their cones
    elastic_share: Table = table("6", "6")  # T = Q'sqrt(W) G', one row per mode
    elastic_weight: Table = table("6", "6")  # G W G' of rotations
    damping_share: Table = table("6", "6")  # T with H, the levers of damping, in place of G
    damping_weight: Table = table("6", "6")
    system: Table = table("6", "6")  # C^-1 + G K G' + H D H' / T
    motion: Floats = floats("6")  # u, along the free directions [m], [rad]
    stretch: Floats = floats("most")  # V'e
    rate: Floats = floats("most")  # V'e'
    near: Table = table("most", "most")  # V'V of the elastic columns
    far: Table = table("most", "most")  # V'R^-1 V of the damping columns
    gram: Table = table("most", "most")  # V'A^-1 V
    elastic_part: Table = table("most", "most")  # k_i E of stiffness; then of damping
    damping_part: Table = table("most", "most")
    whole: Table = table("most", "most")  # E of stiffness and damping, with the object's motion eliminated
    levers: Table = table("most", "6")  # coefficients of K G' + D H' / T on the columns
    products: Table = table("most", "6")  # work
    turned: Table = table("6", "6")  # work
    work: Table = table("most", "most")
    signs: Floats = floats("most")
    row: Floats = floats("most")


def recoil_size(most: int) -> int:
    """Count the entries for `most` columns."""
    return size_for(RecoilState, most=most)
