"""External part P f of a grasp's forces, of which the rest is internal, and of the displacements dual to them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.compile.demand import KernelOnDemand
from graspfx.compile.records import size_for
from graspfx.coupling.division import NONE, SAMPLE, DividedContact, Division, RowPlaces, divide_rows
from graspfx.coupling.grasp_state import FingerState, GraspState
from graspfx.grasp.rigid_modes import NO_ARM
from graspfx.objects.body_state import BodyState

FloatArray = NDArray[np.float64]

ROWS = 1024  # divided at once: what they take in memory stays small
# in rows x fingers x (1 + rotations), some ten microseconds each where Python divides them
DIVIDE_ROWS = KernelOnDemand(divide_rows, few=500, load=5_000, make=40_000)


@dataclass(frozen=True)
class SplitRule:
    """All that a grasp's P is made of besides its contact points and gaps.

    Attributes:
        dimensions: d.
        translations, rotations: along and about which of the world's axes the object is free, three each.
        blend: rms arms between which a rotation joins the external space [m]; None where every arm counts whole.
        fade: gaps between which a free finger leaves the split [m]; None where none does.
        shares: of the metric, one for each finger.
        patches: the fingers' patch lengths, zero for hard ones [m].
        reaction: where the object feels a force, "fingertip" or "contact".
    """

    dimensions: int
    translations: tuple[bool, ...]
    rotations: tuple[bool, ...]
    blend: tuple[float, float] | None
    fade: tuple[float, float] | None
    shares: tuple[float, ...]
    patches: tuple[float, ...]
    reaction: str

    @classmethod
    def of(cls, grasp: GraspState) -> SplitRule:
        """Read the rule from a grasp's block."""
        body, arms = grasp.body, (grasp.arm_low, grasp.arm_high)
        return cls(
            dimensions=grasp.dimensions,
            translations=tuple((body.array(BodyState.free_translation) != 0.0).tolist()),
            rotations=tuple((body.array(BodyState.free_rotation) != 0.0).tolist()),
            blend=None if arms == (NO_ARM, NO_ARM) else arms,
            fade=(grasp.fade_start, grasp.fade_end) if grasp.fade else None,
            shares=tuple(grasp.fingers.array(FingerState.share).tolist()),
            patches=tuple(grasp.fingers.array(FingerState.patch).tolist()),
            reaction="contact" if grasp.at_contact else "fingertip",
        )

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> SplitRule:
        """Read the rule from a table of lists."""
        fields: dict[str, Any] = {k: tuple(value) if isinstance(value, list) else value for k, value in table.items()}
        return cls(**fields)

    def table(self) -> dict[str, Any]:
        """Write the rule as a table of lists, as JSON has them."""
        return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()}

    @property
    def soft(self) -> bool:
        """True where some finger exerts torsion."""
        return any(self.patches)

    @property
    def is_local(self) -> bool:
        """True where P depends on where the object's centre is: it turns, and not every translation is free."""
        return any(self.rotations) and not all(self.translations[: self.dimensions])

    @property
    def block(self) -> FloatArray:
        """A block for the kernel, with the rule in it."""
        return _block_of(self).copy()


@lru_cache(64)  # a run divides its rows by the same few rules, block after block
def _block_of(rule: SplitRule) -> FloatArray:
    """Write a rule into a block."""
    n, width = len(rule.shares), 4 if rule.soft else 3
    free = np.array([*rule.translations, *rule.rotations], dtype=bool)
    division = Division(np.zeros(size_for(Division, count=n, width=width)))
    division.count, division.dimensions, division.width = n, rule.dimensions, width
    division.arm_low, division.arm_high = rule.blend or (NO_ARM, NO_ARM)
    if rule.fade is not None:
        division.fade, (division.fade_start, division.fade_end) = True, rule.fade
    freedom = division.freedom
    freedom.shifts, freedom.turns = int(free[:3].sum()), int(free[3:].sum())
    for k, axis in enumerate(np.vstack([np.eye(3), np.eye(3)])[free]):
        division.buffer[freedom.axes[k].offset :][:3] = axis
    division.contacts.array(DividedContact.share)[:] = rule.shares
    division.contacts.array(DividedContact.patch)[:] = rule.patches
    return np.asarray(division.buffer)


class Samples(NamedTuple):
    """Contacts of one grasp over N samples.

    Attributes:
        contact: c, world axes, (N, n, d) [m]; from the object's centre if the rule `is_local`.
        gap: (N, n) [m]; None where nothing fades.
        normal: into the object, world axes, (N, n, 3); None without soft fingers.
    """

    contact: FloatArray
    gap: FloatArray | None = None
    normal: FloatArray | None = None


def divide_in_rows(
    rule: SplitRule, fingers: Sequence[int], rows: FloatArray, *, dual: bool = False, **places: int
) -> None:
    """Divide what stands in rows, and put the parts into them: `graspfx.coupling.division.divide_rows`.

    Interpreted and compiled give the same bits; few rows are divided by Python, and many where there is no LLVM.

    Args:
        rule: of the grasp.
        fingers: numbers of its fingers among those of a row.
        rows: (r, w), contiguous, which are written.
        dual: whether displacements are divided, not forces.
        places: entries of a row by their names in `RowPlaces`.
    """
    n = len(fingers)
    where = RowPlaces(np.zeros(size_for(RowPlaces, count=n)))
    for name in ("contact", "centre", "gap", "normal", "whole", "torsion", "external", "internal", "twist"):
        setattr(where, name, places.get(name, NONE))
    where.width, where.count = rows.shape[1], n
    for i, finger in enumerate(fingers):
        where.fingers[i] = finger
    divide = DIVIDE_ROWS.runner(len(rows) * n * (1 + sum(rule.rotations)))
    divide(rule.block, 0, where.buffer, 0, np.zeros(n * SAMPLE), 0, rows.reshape(-1), 0, len(rows), dual)


def external_part(
    rule: SplitRule, samples: Samples, whole: FloatArray, torsion: FloatArray | None = None, *, dual: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Compute the external part P f of forces, or P' e of displacements, as `divide_in_rows` does.

    Args:
        rule: of the grasp.
        samples: its contacts.
        whole: f [N], or e [m], world axes, (N, n, d).
        torsion: (N, n), of soft fingers, over their patch length [N], or times it [m].
        dual: whether displacements are divided, not forces.

    Returns:
        The part (N, n, d), and that of the torsion (N, n).
    """
    N, n, d = whole.shape
    external, twist = np.zeros((N, n, d)), np.zeros((N, n))
    entries = {"contact": samples.contact, "whole": whole, "gap": samples.gap, "normal": samples.normal,
               "torsion": torsion, "external": external, "twist": twist}  # fmt: skip
    columns = {name: values for name, values in entries.items() if values is not None}
    places, width = {}, 0
    for name, values in columns.items():
        places[name], width = width, width + math.prod(values.shape[1:])
    for start in range(0, N, ROWS):
        piece = slice(start, min(start + ROWS, N))
        count = piece.stop - start
        rows = np.concatenate([values[piece].reshape(count, -1) for values in columns.values()], axis=1)
        divide_in_rows(rule, range(n), rows, dual=dual, **places)
        external[piece] = rows[:, places["external"] :][:, : n * d].reshape(-1, n, d)
        twist[piece] = rows[:, places["twist"] :]
    return external, twist


def torsion_over_patch(rule: SplitRule, moment: FloatArray, axis: FloatArray) -> FloatArray:
    """Compute tau / rho of soft fingers [N], zero of hard ones, from moments rho (tau / rho) a (..., n, 3)."""
    square = (axis * axis).sum(axis=-1) * np.array(rule.patches)
    along = (moment * axis).sum(axis=-1)
    return np.asarray(np.divide(along, square, out=np.zeros_like(along), where=square > 0.0))


def moment_of(rule: SplitRule, torsion: FloatArray, axis: FloatArray) -> FloatArray:
    """Compute the moments rho (tau / rho) a of torsions over their patch lengths, (..., n, 3) [N m]."""
    return np.asarray((np.array(rule.patches) * torsion)[..., None] * axis)
