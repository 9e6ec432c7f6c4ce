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

from graspfx.coupling.two_forces import (
    Samples,
    SplitRule,
    divide_in_rows,
    external_part,
    moment_of,
    torsion_over_patch,
)
from graspfx.errors import RecordingError
from graspfx.loop.recording.header import SPLIT, Header, KeyChange, RunFault
from graspfx.loop.recording.layout import Layout
from graspfx.loop.recording.row_store import BLOCK

FloatArray = NDArray[np.float64]
Split = Mapping[str, Mapping[str, Any]]  # of each object, its `SplitRule` as a table


class GraspRows(NamedTuple):
    """Rows in which a grasp's rule is the same: the rows, the rule, and the numbers of its fingers."""

    rows: slice
    rule: SplitRule
    fingers: list[int]
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
        if force is not None:
            for grasp in self.grasps():
                self._divide(grasp, whole, external, moment)
            return external, moment
        places = force_places(self.layout)
        for part in self._parts():
            wide, rows = part.widened(), slice(part.start - self.start, part.start - self.start + len(part.rows))
            external[rows] = wide[:, places["external_force"]].reshape(-1, *external.shape[1:])
            if moment is not None:
                moment[rows] = wide[:, places["external_moment"]].reshape(-1, *moment.shape[1:])
        return external, moment

    def _parts(self) -> Iterator[RowSplit]:
        """Give the rows in blocks of about 1 MB."""
        step = max(1, BLOCK // (8 * max(self.layout.width, 1)))
        for first in range(0, len(self.rows), step):
            yield RowSplit(self.rows[first : first + step], self.layout, self.splits, self.start + first)

    def _divide(
        self, grasp: GraspRows, whole: FloatArray, external: FloatArray, moment: FloatArray | None
    ) -> None:  # fmt: skip
        """Write a grasp's P f, and the moments with it, into arrays."""
        rows, rule, fingers, _ = grasp
        samples = self.samples(grasp)
        if moment is None or not rule.soft:
            external[rows, fingers], _ = external_part(rule, samples, whole[rows, fingers])
            return
        axis = self.column("torsion_axis" if self.layout.torsion_axes else "contact_normal")[rows, fingers]
        torsion = torsion_over_patch(rule, self.column("finger_moment")[rows, fingers], axis)
        external[rows, fingers], part = external_part(rule, samples, whole[rows, fingers], torsion)
        moment[rows, fingers] = moment_of(rule, part, axis)

    def widened(self, room: FloatArray | None = None) -> FloatArray:
        """Write behind the rows the forces that follow from them, `Layout.forces`, (r, `wide_width`).

        Args:
            room: for as many rows and more, or None for an array of its own.
        """
        layout, places = self.layout, force_places(self.layout)
        count = len(self.rows)
        width = layout.width + sum(prod(each.shape) for each in layout.forces)
        wide = np.empty((count, width)) if room is None else room[:count]
        wide[:, : layout.width] = self.rows
        external, internal = (places[name].start for name in ("external_force", "internal_force"))
        if layout.moments:
            self._widen_soft(wide, places)
            return wide
        for rows, rule, fingers, key in self.grasps():
            at = {name: layout.columns[name].where.start for name in ("contact_position", "finger_force")}
            more = {"centre": layout.columns[self._place_of(key[0])].where.start} if rule.is_local else {}
            if rule.fade is not None:
                more["gap"] = layout.columns["gap"].where.start
            divide_in_rows(
                rule, fingers, wide[rows], contact=at["contact_position"], whole=at["finger_force"],
                external=external, internal=internal, **more,
            )  # fmt: skip
        return wide

    def _widen_soft(self, wide: FloatArray, places: Mapping[str, slice]) -> None:
        """Write the forces behind rows in which some finger exerts a moment."""
        force, moment = self.column("finger_force"), self.column("finger_moment")
        external, turning = np.zeros(force.shape), np.zeros(moment.shape)
        for grasp in self.grasps():
            self._divide(grasp, force, external, turning)
        parts = {"internal_force": force - external, "external_force": external,
                 "internal_moment": moment - turning, "external_moment": turning}  # fmt: skip
        for name, values in parts.items():
            wide[:, places[name]] = values.reshape(len(wide), -1)

    def external_displacements(self) -> FloatArray:
        """Compute P' e of e = p - c, (r, n, d) [m]."""
        e = self.column("finger_position") - self.column("contact_position")
        external = np.zeros(e.shape)
        for grasp in self.grasps():
            rows, rule, fingers, _ = grasp
            torsion = self.column("torsion_displacement")[rows, fingers] if rule.soft else None
            samples = self.samples(grasp)
            external[rows, fingers], _ = external_part(rule, samples, e[rows, fingers], torsion, dual=True)
        return external

    def forces(self) -> dict[str, FloatArray]:
        """Compute the variables that a file has of the two forces, by the names in `Layout.forces`."""
        wide, places = self.widened(), force_places(self.layout)
        return {
            column.name: wide[:, places[column.name]].reshape(len(wide), *column.shape) for column in self.layout.forces
        }

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
            yield GraspRows(rows, _rule_of(split, name), fingers, (k, number))

    def samples(self, grasp: GraspRows) -> Samples:
        """Give the contacts of a grasp in its rows."""
        rows, rule, fingers, key = grasp
        contact = self.column("contact_position")[rows, fingers]
        if rule.is_local:
            contact = contact - self.column(self._place_of(key[0]))[rows, None]
        gap = None if rule.fade is None else self.column("gap")[rows, fingers]
        normal = self.column("contact_normal")[rows, fingers] if rule.soft else None
        return Samples(contact, gap, normal)

    def _place_of(self, k: int) -> str:
        """Name the column of an object's place that its split needs."""
        return f"objects/{self.layout.objects[k]}/{'centre' if k in self.layout.predicted else 'position'}"


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
    rows: FloatArray,
    layout: Layout,
    header: Header,
    changes: Sequence[KeyChange],
    start: int,
    room: FloatArray | None = None,
) -> FloatArray:
    """Write behind rows (r, width) of a recording, of which `start` is the first, the forces that follow from them.

    Args:
        rows: (r, width).
        layout, header: of the recording.
        changes: of keys so far.
        start: number of the first row.
        room: for as many wide rows and more, or None for an array of its own.
    """
    if header.split and layout.forces and len(rows):
        return RowSplit(rows, layout, splits_of(header, changes), start).widened(room)
    wide = np.empty((len(rows), wide_width(layout, header))) if room is None else room[: len(rows)]
    wide[:, : layout.width] = rows
    return wide


def force_places(layout: Layout) -> dict[str, slice]:
    """List where the forces that follow from a row stand behind it, by their names in `Layout.forces`."""
    places, start = {}, layout.width
    for column in layout.forces:
        places[column.name] = slice(start, start + prod(column.shape))
        start += prod(column.shape)
    return places


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
