"""External and internal parts of recorded forces, moments and displacements; their work, and the friction margin.

The parts are computed from the rows and from the split rule of each grasp, which the recording contains.
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
    """Range of rows in which the split rule of a grasp does not change.

    Attributes:
        rows: Range of rows.
        rule: Split rule.
        thing: Index of the object.
        fingers: Indices of the fingers that touch the object.
    """

    rows: slice
    rule: SplitRule
    thing: int
    fingers: list[int]


class RowSplit:
    """Rows of a recording with their split rules; columns are read on demand.

    Args:
        rows: Rows, (r, width), or the store from which they are read.
        layout: Layout of the columns.
        splits: Split rules, each with the first row of the recording in which it applies; empty if none is needed.
        start: Index in the recording of the first of the rows.
        friction: Coefficients of friction of the fingers (n,), each with the first row of the recording in which they
            apply; see `coefficients`.
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
        """Return a column with the row as its last dimension, (..., r)."""
        if name not in self._columns:
            column = self.layout.columns[name]
            values = self._store.read(0, self._count, column.where)
            self._columns[name] = _rows_last(values).reshape(*column.shape, self._count)
        return self._columns[name]

    def external_forces(self, force: FloatArray | None = None) -> tuple[FloatArray, FloatArray | None]:
        """Return the external part P f of forces f, (n, d, r) [N], and the external moments, (n, 3, r) [N m].

        The moments are None if the fingers exert no moments. If the file contains the results, they are read from it.

        Args:
            force: Forces f, (n, d, r) [N]; None for the fingers' forces on the object.
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
        """Return the external part P' e of the displacements e of fingertips from their contacts, (n, d, r) [m]."""
        e = self.column("finger_position") - self.column("contact_position")
        external = np.zeros(e.shape)
        for grasp in self.grasps():
            rule, where = grasp.rule, (grasp.fingers, slice(None), grasp.rows)
            torsion = self.column("torsion_displacement")[grasp.fingers, grasp.rows] if rule.soft else None
            part = divide(rule, self._samples(grasp), e[where], torsion, dual=True)
            external[where] = part[:, : self.layout.dimensions]
        return external

    def derived(self, names: Collection[str]) -> dict[str, FloatArray]:
        """Return the derived variables with these names in `Layout.derived`, (r, ...) each, by name."""
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
        """Return the friction margin (r,) [N], and the coefficient |f_t| / f_n that each finger needs (n, r).

        f_n and f_t are the normal and tangential force of a finger. The margin is the smallest mu_i f_n - |f_t| of the
        touching fingers i, zero if it is smaller than rounding errors, and NaN if no finger touches. Fingers without a
        coefficient mu_i are ignored.

        Args:
            fingers: Indices of the fingers to use; None for all.
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
        """Yield each grasp for each range of rows in which its split rule does not change."""
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
        """Return the contacts of a grasp in its range of rows."""
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
    """Read the split rule of an object.

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
    """Return the split rules of a run, each with the first row in which it applies.

    Raises:
        RecordingError: The recording has no split rules, because an earlier version of GraspFX made it.
    """
    if not header.split:
        raise RecordingError(
            "this recording, made by an earlier version of GraspFX, does not say how its forces divide into external "
            "and internal parts: run its scene again"
        )
    changed = [(header.rows_before(change.tick), change.value) for change in changes if change.key == SPLIT]
    return [(0, header.split), *changed]


def coefficients(header: Header, changes: Sequence[KeyChange], fingers: int) -> list[tuple[int, FloatArray]]:
    """Return the coefficients of friction of the fingers (n,), each set with the first row in which it applies.

    A coefficient is NaN for a finger whose friction is zero or "stick".
    """
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
    """Return the work that a displayed force has done on each fingertip so far, (N, n) [J], as the ticks compute it.

    The work in a sample is the force of the sample times the motion of the fingertip up to the next sample. After a
    fault no work is added. If `device_energy` shows that the tick of the fault added no work, none is added for this
    tick.

    Args:
        force: Displayed forces, (N, n, d) [N].
        tip: Fingertip positions, (N, n, d) [m].
        device_energy: Recorded device energy, (N, n) [J].
        faults: Faults of the run.
        first: Tick of the first row of the arrays.
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
