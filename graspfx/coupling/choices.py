"""Choices that follow from the gains of a grasp's block: do they still fit the numbers that stand there?"""

from __future__ import annotations

from operator import itemgetter
from typing import Any

from graspfx.compile.records import start_of
from graspfx.coupling.grasp_state import GraspState

NAMES = (
    "external_stiffness", "external_damping", "internal_stiffness", "internal_damping",
    "dense", "equal", "damped", "singular",
)  # fmt: skip
READ = itemgetter(*(start_of(GraspState, name) for name in NAMES))  # a tenth of what a record's fields take


def contradiction(block: Any) -> str:
    """Name a switch that does not follow from the gains in a block; nothing where all do, or gains are matrices.

    A gain that is written into a block by itself leaves the switches as they were: forces would be those of neither.

    Args:
        block: of a `GraspState`, or a memoryview of it.
    """
    kep, ked, kip, kid, dense, equal, damped, singular = READ(block)
    if dense:
        return ""
    if bool(equal) is not bool(kep == kip and ked == kid):
        return "equal"
    if bool(damped) is not bool(ked != 0.0 or kid != 0.0):
        return "damped"
    return "singular" if bool(singular) is not bool(ked == 0.0 or kid == 0.0) else ""
