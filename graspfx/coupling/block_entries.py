"""Entries of a grasp's block by field name: constants of a run, gains and their switches, and recorded values."""

from __future__ import annotations

from collections.abc import Collection
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.records import Record, entries_of, start_of
from graspfx.cones.problem import FrictionProblem, choices
from graspfx.coupling.grasp_state import FingerState, GraspState, RecoilState
from graspfx.grasp.rigid_modes import Freedom
from graspfx.objects.body_state import BodyState, Motion
from graspfx.surfaces.closed_form.proxy import MESH
from graspfx.surfaces.triangles import mesh_tree

Index = NDArray[np.intp]

CHOICES = (
    "count", "dimensions", "coordinates", "width", "unknowns", "components", "matrix_entries", "object_freedoms",
    "equal", "dense", "damped", "singular", "attached", "stick", "fade", "at_contact", "implicit", "shape", "mixed",
    "friction", "rays", "observed", "problem", "damping_problem", "gradual", "limited", "guarded",
    "stiffness_rule", "damping_rule", "axes_of_gains", "kep", "ked", "kip", "kid", "padded", "padded_count",
    "recoils", "recoil_entries",
)  # fmt: skip
GAINS = ("external_stiffness", "external_damping", "internal_stiffness", "internal_damping")
LACKING = ("coefficient", "patch", "radius", "pad")
NAMES = (*GAINS, "dense", "equal", "damped", "singular")
READ = itemgetter(*(start_of(GraspState, name) for name in NAMES))  # ten times faster than reading a record's fields


def structure_entries(grasp: GraspState, live: Collection[str] = ()) -> Index:
    """List the indices of entries that select what is computed and are constant in a run: counts, switches, offsets.

    The entry of a gain, or of a finger's coefficient of friction, patch, radius or pad, is listed only if its value is
    zero. The entry of a finger's weight is listed only if its value is one and weights do not fade.

    Args:
        grasp: Block of the grasp.
        live: Names of fields of `GraspState` that may change during a run.
    """
    S, fingers = grasp.buffer, grasp.fingers
    fixed = entries_of(GraspState, *(name for name in CHOICES if name not in live))
    fixed += entries_of(Freedom, "shifts", "turns", at=start_of(GraspState, "freedom"))
    fixed += entries_of(
        BodyState, "dimensions", "integrator", "free_translation", "free_rotation", at=start_of(GraspState, "body")
    )
    if grasp.recoils:
        fixed += entries_of(RecoilState, "most", "twisted", "distant", at=grasp.recoil.offset)
    lacking = entries_of(GraspState, *(name for name in GAINS if name not in live))
    for finger in fingers:
        lacking += entries_of(FingerState, *LACKING, at=finger.offset)
    fixed += [entry for entry in lacking if S[entry] == 0.0]
    if not grasp.fade:
        weights = [entry for finger in fingers for entry in entries_of(FingerState, "weight", at=finger.offset)]
        fixed += [entry for entry in weights if S[entry] == 1.0]
    if has_problems(grasp):
        for problem in (grasp.problem, grasp.damping_problem):
            fixed += [problem.offset, *choices(problem.offset)]  # including the count of contacts
        if "gradual" in live:
            fixed.remove(compliant_entry(grasp.damping_problem))
    if grasp.shape == MESH:
        fixed += entries_of(GraspState, "mesh")
        fixed += [entry for finger in fingers for entry in entries_of(FingerState, "walk", at=finger.offset)]
        fixed += mesh_tree.choices(grasp.mesh.offset)
    return np.array(sorted(fixed), dtype=np.intp)


def gain_entries() -> list[int]:
    """List the indices of scalar gains and of the switches that depend on them."""
    return entries_of(GraspState, *NAMES)


def matrix_entries(grasp: GraspState) -> list[int]:
    """List the indices of the entries of matrix gains; the list is empty for scalar gains."""
    first = grasp.matrices.offset
    return list(range(first, first + grasp.matrix_entries))


def split_entries(grasp: GraspState) -> list[int]:
    """List the indices of the entries that determine the projector P (`SplitRule`), except contact points and gaps."""
    entries = entries_of(GraspState, "fade", "fade_start", "fade_end", "arm_low", "arm_high", "at_contact")
    entries += entries_of(BodyState, "free_translation", "free_rotation", at=start_of(GraspState, "body"))
    for finger in grasp.fingers:
        entries += entries_of(FingerState, "share", "patch", at=finger.offset)
    return entries


def compliant_entry(problem: FrictionProblem) -> int:
    """Return the index of the switch for compliances in series with a problem's contacts."""
    return problem.offset + start_of(FrictionProblem, "compliant")


def has_problems(grasp: GraspState) -> bool:
    """Return whether the block has friction problems; without them, both offsets are the same entry."""
    return grasp.problem.offset != grasp.damping_problem.offset


def recorded_entries(grasp: GraspState) -> dict[str, Index]:
    """Map the name of each recorded value to the indices of the value's entries in the block."""
    d = grasp.dimensions
    turns = {1: [], 2: [2], 3: [0, 1, 2]}[d]
    motion = start_of(GraspState, "body") + start_of(BodyState, "motion")

    def of(record: type[Record], name: str, at: int) -> Index:
        return np.array(entries_of(record, name, at=at), dtype=np.intp)

    def of_fingers(name: str) -> Index:
        width = len(entries_of(FingerState, name))  # an empty array needs the width explicitly
        entries = [entries_of(FingerState, name, at=finger.offset) for finger in grasp.fingers]
        return np.array(entries, dtype=np.intp).reshape(len(entries), width)

    body = start_of(GraspState, "body")
    orientation = {1: of(Motion, "angle", motion)[:0], 2: of(Motion, "angle", motion)}
    limits = {}
    if grasp.limited:
        limits = {"saturated": of_fingers("saturated")[:, 0], "law_force": of_fingers("law_force")[:, :d]}
    return limits | {
        "finger_position": of_fingers("position")[:, :d],
        "finger_velocity": of_fingers("velocity")[:, :d],
        "contact_position": of_fingers("contact_world")[:, :d],
        "finger_force": of_fingers("force")[:, :d],
        "finger_moment": of_fingers("moment"),
        "contact_normal": of_fingers("normal_world"),
        "torsion_axis": of_fingers("twist_axis_world"),
        "torsion_displacement": of_fingers("displacement")[:, 3],
        "touching": of_fingers("touching")[:, 0],
        "status": of_fingers("status")[:, 0],
        "gap": of_fingers("gap")[:, 0],
        "position": of(Motion, "position", motion)[:d],
        "velocity": of(Motion, "velocity", motion)[:d],
        "centre": of(GraspState, "centre", 0)[:d],
        "orientation": orientation.get(d, of(Motion, "quaternion", motion)),
        "angular_velocity": of(Motion, "angular_velocity", motion)[turns],
        "law": of(GraspState, "law", 0),
        "residual": of(GraspState, "residual", 0),
        "wrench": np.concatenate([of(BodyState, "force", body)[:d], of(BodyState, "moment", body)[turns]]),
    }


def contradiction(block: Any) -> str:
    """Return the name of a switch that contradicts the scalar gains in a block, or "" if no switch does.

    The result is also "" for matrix gains.

    Writing a gain directly into a block does not update the switches, and the forces would be wrong.

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
