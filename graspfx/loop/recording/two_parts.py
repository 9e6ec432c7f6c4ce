"""External and internal parts of what a recording holds: forces, moments, displacements and energies.

All follow from the rows and from what the header says of each grasp's split; nothing of them is computed in a tick.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.coupling.two_forces import Samples, SplitRule, external_part, moment_of, torsion_over_patch
from graspfx.errors import RecordingError
from graspfx.loop.recording.header import RunFault
from graspfx.loop.recording.layout import Layout

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class RowSplit:
    """Rows of a recording, (N, width), and how they divide.

    Args:
        rows: of the recording.
        layout: their columns.
        split: by object, its `SplitRule` as a table.

    Raises:
        RecordingError: there is none.
    """

    rows: FloatArray
    layout: Layout
    split: Mapping[str, Mapping[str, Any]]

    def __post_init__(self) -> None:
        if not self.split:
            raise RecordingError(
                "this recording does not say how its forces divide into external and internal ones, as an earlier "
                "GraspFX made it: run its scene again"
            )

    def column(self, name: str) -> FloatArray:
        """View a column, (N, ...)."""
        column = self.layout.columns[name]
        return self.rows[:, column.where].reshape(len(self.rows), *column.shape)

    def external_forces(self, force: FloatArray | None = None) -> tuple[FloatArray, FloatArray | None]:
        """Compute P f, (N, n, d) [N], and the moments with it, (N, n, 3) [N m]; None for fingers that exert none.

        Args:
            force: (N, n, d) [N], instead of the fingers' on the object.
        """
        whole = self.column("finger_force") if force is None else force
        external = np.zeros(whole.shape)
        moment = np.zeros((*whole.shape[:2], 3)) if self.layout.moments else None
        for rule, fingers, samples in self._grasps():
            if moment is None or not rule.soft:
                external[:, fingers], _ = external_part(rule, samples, whole[:, fingers])
                continue
            axis = self.column("torsion_axis" if self.layout.torsion_axes else "contact_normal")[:, fingers]
            torsion = torsion_over_patch(rule, self.column("finger_moment")[:, fingers], axis)
            external[:, fingers], part = external_part(rule, samples, whole[:, fingers], torsion)
            moment[:, fingers] = moment_of(rule, part, axis)
        return external, moment

    def external_displacements(self) -> FloatArray:
        """Compute P' e of e = p - c, (N, n, d) [m]."""
        e = self.column("finger_position") - self.column("contact_position")
        external = np.zeros(e.shape)
        for rule, fingers, samples in self._grasps():
            torsion = self.column("torsion_displacement")[:, fingers] if rule.soft else None
            external[:, fingers], _ = external_part(rule, samples, e[:, fingers], torsion, dual=True)
        return external

    def _grasps(self) -> Iterator[tuple[SplitRule, list[int], Samples]]:
        """List each object's rule, the numbers of its fingers, and its contacts in every row."""
        for k, name in enumerate(self.layout.objects):
            fingers = [i for i, number in enumerate(self.layout.finger_objects) if number == k]
            if not fingers:
                continue
            rule = SplitRule.from_table(self.split[name])
            contact = self.column("contact_position")[:, fingers]
            if rule.is_local:
                place = "centre" if k in self.layout.predicted else "position"
                contact = contact - self.column(f"objects/{name}/{place}")[:, None]
            gap = None if rule.fade is None else self.column("gap")[:, fingers]
            normal = self.column("contact_normal")[:, fingers] if rule.soft else None
            yield rule, fingers, Samples(contact, gap, normal)


def work(force: FloatArray, tip: FloatArray, device_energy: FloatArray, faults: Sequence[RunFault]) -> FloatArray:
    """Compute the work done so far on each fingertip by a displayed force, (N, n) [J], as a tick does.

    A sample's force times the fingertip's motion up to the next sample. None is booked after a fault, and none in the
    sample of the fault if it came before the books, which shows where `device_energy` is what it was.

    Args:
        force: (N, n, d) [N].
        tip: where the fingertips are, (N, n, d) [m].
        device_energy: (N, n) [J].
        faults: of the run.
    """
    steps = np.zeros(device_energy.shape)
    steps[1:] = (force[:-1] * np.diff(tip, axis=0)).sum(axis=2)
    for fault in faults[:1]:
        k = fault.tick
        if 0 < k < len(steps):
            steps[k, device_energy[k] == device_energy[k - 1]] = 0.0
        steps[k + 1 :] = 0.0
    return np.cumsum(steps, axis=0)
