"""External and internal parts of recorded forces, moments, displacements and energies, and the friction margin.

All parts follow from the rows and from each grasp's split rule in the recording; ticks do not compute them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.coupling.two_forces import Samples, SplitRule, divide, moment_of, torsion_over_patch
from graspfx.errors import RecordingError
from graspfx.loop.columns import Layout, RunFault
from graspfx.recording.header import SPLIT, Header, KeyChange
from graspfx.recording.rows import MemoryRows, RowStore

ROUNDING = 4e-15  # relative to the largest force of a finger: a smaller friction margin is rounding

FloatArray = NDArray[np.float64]
Split = Mapping[str, Mapping[str, Any]]  # `SplitRule` of each object as a table


class GraspRows(NamedTuple):
    """Rows with the same split rule of a grasp: the rows, the rule, and the indices of its object and fingers."""

    rows: slice
    rule: SplitRule
    thing: int
    fingers: list[int]


class RowSplit:
    """Rows of a recording with their split rules; columns are read on demand.

    Args:
        rows: Rows, (r, width), or their source.
        layout: Columns of the rows.
        splits: Split rules, each with the row from which it holds; empty if no split is needed.
        start: Index of the first row in the recording.
        friction: Fingers' coefficients (n,), each with the row of the recording from which they hold, as listed by
            `coefficients`.
    """

    def __init__(
        self, rows: FloatArray | RowStore, layout: Layout, splits: Sequence[tuple[int, Split]], start: int = 0,
        friction: Sequence[tuple[int, FloatArray]] = (),
    ) -> None:  # fmt: skip
        self.layout, self._splits, self.start, self._friction = layout, splits, start, friction
        self._store = rows if isinstance(rows, RowStore) else MemoryRows(rows)
        self._count, self._columns = len(rows), dict[str, FloatArray]()

    def __len__(self) -> int:
        return self._count

    def column(self, name: str) -> FloatArray:
        """Return a column with the rows last, (..., r), which is faster to compute with."""
        if name not in self._columns:
            column = self.layout.columns[name]
            values = self._store.read(0, self._count, column.where)
            self._columns[name] = _rows_last(values).reshape(*column.shape, self._count)
        return self._columns[name]

    def external_forces(self, force: FloatArray | None = None) -> tuple[FloatArray, FloatArray | None]:
        """Compute the external part P f of forces f [N], (n, d, r), and its moments [N m], (n, 3, r).

        The moments are None if fingers exert none. Parts that the file contains are read instead of computed.

        Args:
            force: Forces to use instead of the fingers' forces on the object, (n, d, r) [N].
        """
        if force is None:
            stored = [self._store.beside(name, 0, self._count) for name in ("external_force", "external_moment")]
            if stored[0] is not None:
                first, second = (None if each is None else _rows_last(each) for each in stored)
                return np.asarray(first), second
        whole = self.column("finger_force") if force is None else force
        external = np.zeros(whole.shape)
        moment = np.zeros((len(whole), 3, self._count)) if self.layout.moments else None
        for grasp in self.grasps():
            rule, where = grasp.rule, (grasp.fingers, slice(None), grasp.rows)
            if moment is None or not rule.soft:
                external[where] = divide(rule, self._samples(grasp), whole[where])
                continue
            direction = "torsion_axis" if self.layout.torsion_axes else "contact_normal"
            axis = self.column(direction)[where].transpose(2, 0, 1)
            torsion = torsion_over_patch(rule, self.column("finger_moment")[where].transpose(2, 0, 1), axis)
            part = divide(rule, self._samples(grasp), whole[where], torsion.T)
            external[where] = part[:, :3]
            moment[where] = moment_of(rule, part[:, 3].T, axis).transpose(1, 2, 0)
        return external, moment

    def external_displacements(self) -> FloatArray:
        """Compute the external part P' e of the displacements e = p - c [m], (n, d, r)."""
        e = self.column("finger_position") - self.column("contact_position")
        external = np.zeros(e.shape)
        for grasp in self.grasps():
            rule, where = grasp.rule, (grasp.fingers, slice(None), grasp.rows)
            torsion = self.column("torsion_displacement")[grasp.fingers, grasp.rows] if rule.soft else None
            part = divide(rule, self._samples(grasp), e[where], torsion, dual=True)
            external[where] = part[:, : self.layout.dimensions]
        return external

    def derived(self, names: Collection[str]) -> dict[str, FloatArray]:
        """Compute variables that follow from the rows by their names in `Layout.derived`, (r, ...)."""
        variables: dict[str, FloatArray] = {}
        if "displayed_force" in names:
            variables["displayed_force"] = -self.column("finger_force")
        if any(column.name in names for column in self.layout.forces):
            external, moment = self.external_forces()
            variables |= {"internal_force": self.column("finger_force") - external, "external_force": external}
            if moment is not None:
                variables |= {"internal_moment": self.column("finger_moment") - moment, "external_moment": moment}
        if "internal_displacement" in names or "external_displacement" in names:
            external = self.external_displacements()
            internal = self.column("finger_position") - self.column("contact_position") - external
            variables |= {"internal_displacement": internal, "external_displacement": external}
        if "grip_margin" in names:
            variables["grip_margin"], _ = self.grip()
        return {name: np.moveaxis(values, -1, 0) for name, values in variables.items()}

    def grip(self, fingers: Sequence[int] | None = None) -> tuple[FloatArray, FloatArray]:
        """Compute the fingers' friction margin (r,) [N], and the coefficient |f_t| / f_n that each needs (n, r).

        The margin is the smallest mu_i f_n - |f_t| of the touching fingers, zero where it is below rounding, and NaN if
        none touches; fingers without a coefficient are left out.
        """
        own = slice(None) if fingers is None else list(fingers)
        at = np.searchsorted([row for row, _ in self._friction], self.start + np.arange(self._count), side="right") - 1
        mu = np.array([each for _, each in self._friction])[at].T[own]
        force = self.column("finger_force")[own]
        normal = self.column("contact_normal")[own, : force.shape[1]]
        push = (normal * force).sum(axis=1)
        tangent = np.sqrt(((force - push[:, None] * normal) ** 2).sum(axis=1))
        counts = np.not_equal(self.column("touching")[own], 0.0) & ~np.isnan(mu)
        margin = mu * push - tangent
        largest = (np.abs(push) + tangent).max(axis=0, initial=0.0)
        margin[np.abs(margin) <= ROUNDING * largest] = 0.0  # a sliding finger is on its cone
        margin = np.where(counts, margin, np.inf).min(axis=0, initial=np.inf)
        needed = np.divide(tangent, push, out=np.zeros(push.shape), where=counts & (push > 0.0))
        return np.where(np.isinf(margin), np.nan, margin), needed

    def grasps(self) -> Iterator[GraspRows]:
        """List the grasps, each with the rows in which its rule is the same."""
        ends = [*(row - self.start for row, _ in self._splits[1:]), self._count]
        first = 0
        for (_, split), end in zip(self._splits, ends, strict=True):
            last = min(max(first, end), self._count)
            for k, name in enumerate(self.layout.objects) if last > first else ():
                fingers = [i for i, number in enumerate(self.layout.finger_objects) if number == k]
                if fingers:
                    yield GraspRows(slice(first, last), _rule_of(split, name), k, fingers)
            first = last

    def _samples(self, grasp: GraspRows) -> Samples:
        """Return the contacts of a grasp in its rows."""
        rows, rule, thing, fingers = grasp
        contact = self.column("contact_position")[fingers, :, rows]
        if rule.is_local:
            place = "centre" if thing in self.layout.predicted else "position"
            contact = contact - self.column(f"objects/{self.layout.objects[thing]}/{place}")[:, rows]
        gap = None if rule.fade is None else self.column("gap")[fingers, rows]
        normal = self.column("contact_normal")[fingers, :, rows] if rule.soft else None
        return Samples(contact, gap, normal)


def _rows_last(values: FloatArray) -> FloatArray:
    return np.ascontiguousarray(np.moveaxis(values, 0, -1))


def _rule_of(split: Split, name: str) -> SplitRule:
    """Read an object's split rule.

    Raises:
        RecordingError: The rule is missing, incomplete, or has unknown entries.
    """
    if name not in split:
        raise RecordingError(
            f"the recording does not say how the forces of {name!r} divide; it has the rules of {sorted(split)} only"
        )
    table = split[name]
    names = {each.name for each in fields(SplitRule)}
    if set(table) != names:
        unknown, missing = sorted(set(table) - names), sorted(names - set(table))
        raise RecordingError(
            f"the rule by which the forces of {name!r} divide cannot be read: unknown entries {unknown}, missing "
            f"entries {missing}; another version of GraspFX may have made this recording"
        )
    return SplitRule.from_table(table)


def splits_of(header: Header, changes: Sequence[KeyChange]) -> list[tuple[int, Split]]:
    """List a run's split rules, each with the row from which it holds.

    Raises:
        RecordingError: The recording contains no split rules.
    """
    if not header.split:
        raise RecordingError(
            "this recording, made by an earlier version of GraspFX, does not say how its forces divide into external "
            "and internal parts: run its scene again"
        )
    changed = [(header.rows_before(change.tick), change.value) for change in changes if change.key == SPLIT]
    return [(0, header.split), *changed]


def coefficients(header: Header, changes: Sequence[KeyChange], fingers: int) -> list[tuple[int, FloatArray]]:
    """List the fingers' coefficients of friction (n,) with the row from which they hold; NaN for zero or "stick"."""
    table = header.scene_table
    common = _coefficient(table.get("coupling", {}).get("friction", 0.0))
    tables: Sequence[Mapping[str, Any]] = _listed(table.get("finger", ()))
    own = [each.get("friction") for each in tables] or [None] * fingers
    found = [(0, _of_fingers(common, own))]
    for change in changes:
        first, *rest = change.key.split(".")
        if change.key == "coupling.friction":
            common = _coefficient(change.value)
        elif first == "finger" and rest[-1:] == ["friction"] and len(rest) == 2:
            own = [change.value if rest[0] in ("*", str(i)) else mu for i, mu in enumerate(own)]
        else:
            continue
        found.append((header.rows_before(change.tick), _of_fingers(common, own)))
    return found


def _of_fingers(common: float, own: Sequence[Any]) -> FloatArray:
    values = np.array([common if mu is None else _coefficient(mu) for mu in own])
    return np.where(values > 0.0, values, np.nan)


def _coefficient(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else np.nan


def _listed(tables: Any) -> Sequence[Mapping[str, Any]]:
    return [tables] if isinstance(tables, Mapping) else list(tables)


def work(
    force: FloatArray,
    tip: FloatArray,
    device_energy: FloatArray,
    faults: Sequence[RunFault],
    first: int = 0,
    start: FloatArray | None = None,
) -> FloatArray:
    """Compute the work done so far on each fingertip by a displayed force, (N, n) [J], as a tick does.

    The work of a sample is its force times the fingertip's motion up to the next sample. No work is added after a
    fault. The sample of the fault adds no work either if the fault occurred before its tick added the work; then
    `device_energy` does not change.

    Args:
        force: Displayed forces, (N, n, d) [N].
        tip: Fingertip positions, (N, n, d) [m].
        device_energy: Recorded device energy, (N, n) [J].
        faults: Faults of the run.
        first: Tick of the first row.
        start: Work before the first row, (1, n) [J]; zero if not given.
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
