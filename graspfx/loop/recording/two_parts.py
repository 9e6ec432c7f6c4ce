"""External and internal parts of what a recording holds: forces, moments, displacements and energies.

All follow from the rows and from what the recording says of each grasp's split; nothing of them is computed in a tick.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.coupling.two_forces import Samples, SplitRule, external_part, moment_of, torsion_over_patch
from graspfx.errors import RecordingError
from graspfx.loop.recording.header import SPLIT, Header, KeyChange, RunFault
from graspfx.loop.recording.layout import Layout

FloatArray = NDArray[np.float64]
Split = Mapping[str, Mapping[str, Any]]  # of each object, its `SplitRule` as a table


class GraspRows(NamedTuple):
    """Rows in which a grasp's rule is the same: the rows, the rule, the numbers of its fingers, and its contacts."""

    rows: slice
    rule: SplitRule
    fingers: list[int]
    samples: Samples
    key: tuple[int, int]  # numbers of the object and of the rule, of those in the run


@dataclass(frozen=True)
class RowSplit:
    """Rows of a recording, and how they divide.

    Args:
        rows: (r, width).
        layout: their columns.
        splits: how forces divide, each from a row of the recording on.
        start: number of the first row in it.
    """

    rows: FloatArray
    layout: Layout
    splits: Sequence[tuple[int, Split]]
    start: int = 0

    def column(self, name: str) -> FloatArray:
        """View a column, (r, ...)."""
        column = self.layout.columns[name]
        return self.rows[:, column.where].reshape(len(self.rows), *column.shape)

    def external_forces(self, force: FloatArray | None = None) -> tuple[FloatArray, FloatArray | None]:
        """Compute P f, (r, n, d) [N], and the moments with it, (r, n, 3) [N m]; None for fingers that exert none.

        Args:
            force: (r, n, d) [N], instead of the fingers' on the object.
        """
        whole = self.column("finger_force") if force is None else force
        external = np.zeros(whole.shape)
        moment = np.zeros((*whole.shape[:2], 3)) if self.layout.moments else None
        for rows, rule, fingers, samples, _ in self.grasps():
            if moment is None or not rule.soft:
                external[rows, fingers], _ = external_part(rule, samples, whole[rows, fingers])
                continue
            axis = self.column("torsion_axis" if self.layout.torsion_axes else "contact_normal")[rows, fingers]
            torsion = torsion_over_patch(rule, self.column("finger_moment")[rows, fingers], axis)
            external[rows, fingers], part = external_part(rule, samples, whole[rows, fingers], torsion)
            moment[rows, fingers] = moment_of(rule, part, axis)
        return external, moment

    def external_displacements(self) -> FloatArray:
        """Compute P' e of e = p - c, (r, n, d) [m]."""
        e = self.column("finger_position") - self.column("contact_position")
        external = np.zeros(e.shape)
        for rows, rule, fingers, samples, _ in self.grasps():
            torsion = self.column("torsion_displacement")[rows, fingers] if rule.soft else None
            external[rows, fingers], _ = external_part(rule, samples, e[rows, fingers], torsion, dual=True)
        return external

    def forces(self) -> dict[str, FloatArray]:
        """Compute the variables that a file has of the two forces, by the names in `Layout.forces`."""
        external, moment = self.external_forces()
        variables = {"internal_force": self.column("finger_force") - external, "external_force": external}
        if moment is not None:
            variables |= {"internal_moment": self.column("finger_moment") - moment, "external_moment": moment}
        return variables

    def derived(self, names: Collection[str]) -> dict[str, FloatArray]:
        """Compute variables that follow from the rows, by their names in `Layout.derived`."""
        variables: dict[str, FloatArray] = {}
        if "displayed_force" in names:
            variables["displayed_force"] = -self.column("finger_force")
        if any(column.name in names for column in self.layout.forces):
            variables |= self.forces()
        if "internal_displacement" in names or "external_displacement" in names:
            external = self.external_displacements()
            internal = self.column("finger_position") - self.column("contact_position") - external
            variables |= {"internal_displacement": internal, "external_displacement": external}
        return variables

    def moments(self, internal: FloatArray) -> Iterator[tuple[tuple[int, int], float, float]]:
        """Compute the peaks of |sum e_i x f_i| and of |f| r, f the internal forces, of each object and rule.

        The fingers act on the object at their tips, so that internal forces, which have no moment about the contact
        points, turn it by that moment. It is taken along free rotations; |f|^2 = sum |f_i|^2, and r^2 is the mean
        square of the contacts' distances from their centroid.

        Args:
            internal: (r, n, d) [N].

        Yields:
            The numbers of object and rule, and the peaks [N m]; none where the reaction is at the contact points, and
            where nothing turns.
        """
        e = self.column("finger_position") - self.column("contact_position")
        for rows, rule, fingers, samples, key in self.grasps():
            if rule.reaction == "contact" or not any(rule.rotations):
                continue
            f = internal[rows, fingers]
            moment = np.cross(_in_space(e[rows, fingers]), _in_space(f)).sum(axis=1)[:, np.array(rule.rotations)]
            arm = samples.contact - samples.contact.mean(axis=1, keepdims=True)
            whole = np.sqrt((f**2).sum(axis=(1, 2)) * (arm**2).sum(axis=(1, 2)) / len(fingers))
            yield key, float(np.sqrt((moment**2).sum(axis=1).max(initial=0.0))), float(whole.max(initial=0.0))

    def grasps(self) -> Iterator[GraspRows]:
        """List the grasps, each with the rows in which its rule is the same."""
        ends = [*(row - self.start for row, _ in self.splits[1:]), len(self.rows)]
        first = 0
        for number, ((_, split), end) in enumerate(zip(self.splits, ends, strict=True)):
            last = min(max(first, end), len(self.rows))
            if last > first:
                yield from self._grasps_in(slice(first, last), split, number)
            first = last

    def _grasps_in(self, rows: slice, split: Split, number: int) -> Iterator[GraspRows]:
        for k, name in enumerate(self.layout.objects):
            fingers = [i for i, number in enumerate(self.layout.finger_objects) if number == k]
            if not fingers:
                continue
            rule = _rule_of(split, name)
            contact = self.column("contact_position")[rows, fingers]
            if rule.is_local:
                place = "centre" if k in self.layout.predicted else "position"
                contact = contact - self.column(f"objects/{name}/{place}")[rows, None]
            gap = None if rule.fade is None else self.column("gap")[rows, fingers]
            normal = self.column("contact_normal")[rows, fingers] if rule.soft else None
            yield GraspRows(rows, rule, fingers, Samples(contact, gap, normal), (k, number))


def _rule_of(split: Split, name: str) -> SplitRule:
    """Read an object's rule.

    Raises:
        RecordingError: there is none, or not all of it, or more.
    """
    if name not in split:
        raise RecordingError(f"the recording does not say how the forces of {name!r} divide, only of {sorted(split)}")
    table = split[name]
    names = {each.name for each in fields(SplitRule)}
    if set(table) != names:
        unknown, missing = sorted(set(table) - names), sorted(names - set(table))
        raise RecordingError(
            f"how the forces of {name!r} divide is not to be read from this recording: unknown are {unknown}, missing "
            f"are {missing}; another version of GraspFX may have made it"
        )
    return SplitRule.from_table(table)


def splits_of(header: Header, changes: Sequence[KeyChange]) -> list[tuple[int, Split]]:
    """List how a run's forces divide, each from a row on.

    Raises:
        RecordingError: the recording does not say it.
    """
    if not header.split:
        raise RecordingError(
            "this recording does not say how its forces divide into external and internal ones, as an earlier GraspFX "
            "made it: run its scene again"
        )
    changed = [(header.rows_before(change.tick), change.value) for change in changes if change.key == SPLIT]
    return [(0, header.split), *changed]


def wide_width(layout: Layout, header: Header) -> int:
    """Count the numbers of a row in a file: those of the layout, and the forces that follow from them."""
    return layout.width + (sum(prod(column.shape) for column in layout.forces) if header.split else 0)


def wide_rows(
    rows: FloatArray, layout: Layout, header: Header, changes: Sequence[KeyChange], start: int
) -> FloatArray:  # fmt: skip
    """Write behind rows (r, width) of a recording, of which `start` is the first, the forces that follow from them."""
    wide = np.empty((len(rows), wide_width(layout, header)))
    wide[:, : layout.width] = rows
    if wide.shape[1] > layout.width and len(rows):
        parts, place = RowSplit(rows, layout, splits_of(header, changes), start).forces(), layout.width
        for column in layout.forces:
            size = prod(column.shape)
            wide[:, place : place + size] = parts[column.name].reshape(len(rows), size)
            place += size
    return wide


def work(
    force: FloatArray,
    tip: FloatArray,
    device_energy: FloatArray,
    faults: Sequence[RunFault],
    first: int = 0,
    start: FloatArray | None = None,
) -> FloatArray:
    """Compute the work done so far on each fingertip by a displayed force, (N, n) [J], as a tick does.

    A sample's force times the fingertip's motion up to the next sample. None is booked after a fault, and none in the
    sample of the fault if it came before the books, which shows where `device_energy` is what it was.

    Args:
        force: (N, n, d) [N].
        tip: where the fingertips are, (N, n, d) [m].
        device_energy: (N, n) [J].
        faults: of the run.
        first: tick of the first row.
        start: work up to it, (1, n) [J]; zero if not given.
    """
    steps = np.zeros(device_energy.shape)
    steps[1:] = (force[:-1] * np.diff(tip, axis=0)).sum(axis=2)
    if start is not None:
        steps[:1] = start
    for fault in faults[:1]:
        k = fault.tick - first
        if 0 < k < len(steps):
            steps[k, device_energy[k] == device_energy[k - 1]] = 0.0
        steps[max(k + 1, 1 if start is not None else 0) :] = 0.0
    return np.cumsum(steps, axis=0)


def _in_space(vectors: FloatArray) -> FloatArray:
    """Give vectors (..., d) in space."""
    return np.concatenate([vectors, np.zeros((*vectors.shape[:-1], 3 - vectors.shape[-1]))], axis=-1)
