"""Consistency of a grasp block's switches with its gains."""

from __future__ import annotations

from operator import itemgetter
from typing import Any

from graspfx.compile.records import start_of
from graspfx.coupling.grasp_state import GraspState

NAMES = (
    "external_stiffness", "external_damping", "internal_stiffness", "internal_damping",
    "dense", "equal", "damped", "singular",
)  # fmt: skip
READ = itemgetter(*(start_of(GraspState, name) for name in NAMES))  # ten times faster than reading a record's fields


def contradiction(block: Any) -> str:
    """Return the name of a switch that contradicts the gains in a block; empty if there is none, or for matrix gains.

    A gain that is written directly into a block does not update the switches, so forces would be wrong.

    Args:
        block: Block of a `GraspState`, or a memoryview of it.
    """
    kep, ked, kip, kid, dense, equal, damped, singular = READ(block)
    if dense:
        return ""
    if bool(equal) is not bool(kep == kip and ked == kid):
        return "equal"
    if bool(damped) is not bool(ked != 0.0 or kid != 0.0):
        return "damped"
    return "singular" if bool(singular) is not bool(ked == 0.0 or kid == 0.0) else ""
