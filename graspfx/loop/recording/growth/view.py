"""One grasp of a recording: an object and its fingers, as rows of displacements, and what hands mean to do with it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.drive import Drive, drive
from graspfx.loop.recording.growth.mode import mode_name
from graspfx.loop.recording.history import History
from graspfx.loop.recording.layout import WIDTHS

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GraspView:
    """One object's part of a recording, with its fingers.

    Attributes:
        name: of the object.
        fingers: theirs.
        rows: how many count: up to a fault.
    """

    recording: History
    name: str
    number: int
    fingers: NDArray[np.intp]
    rows: int

    def displacement(self, first: int, stop: int) -> FloatArray:
        """Compute e = p - c of the fingers that touch, zero of the others, (r, n d) [m]."""
        e = self._position(first, stop) - self._read("contact_position", first, stop)
        e *= np.not_equal(self._read("touching", first, stop), 0.0)[:, :, None]
        return e.reshape(len(e), -1)

    def arms(self, first: int, stop: int) -> FloatArray:
        """Compute the mean arms of the fingers about the object, (n, d) [m]."""
        centre = self.recording.read(f"objects/{self.name}/position", first, stop)[:, None]
        return np.asarray((self._position(first, stop) - centre).mean(axis=0))

    def touching(self, first: int, stop: int) -> NDArray[np.bool_]:
        """Tell which fingers touch most of the time, (n,)."""
        return np.asarray(np.not_equal(self._read("touching", first, stop), 0.0).mean(axis=0) > 0.5)

    def depth(self, first: int, stop: int) -> float:
        """Find the largest of the fingers' mean displacements [m]."""
        mean = self.displacement(first, stop).mean(axis=0).reshape(len(self.fingers), -1)
        return float(np.linalg.norm(mean, axis=1).max())

    def noise(self, first: int, stop: int) -> float:
        """Estimate the RMS noise of the measured positions [m]; zero where nothing is known of it."""
        if "true_position" not in self.recording.layout.columns:
            return 0.0
        off = self._read("finger_position", first, stop) - self._read("true_position", first, stop)
        return float(np.sqrt((off**2).mean()))

    def drive(self) -> Drive:
        """Read what hands mean to do with the object."""
        header = self.recording.header
        centre = self.recording.read(f"objects/{self.name}/position", 0, 1)[0]
        return drive(header.scene_table, self.fingers.tolist(), header.scene_folder, self._position(0, 1)[0], centre)

    def mode(self, swing: NDArray[np.complex128], first: int, stop: int) -> str:
        """Name a swing (n d,) in these rows."""
        layout, table = self.recording.layout, self.recording.header.scene_table
        things = table.get("object") or [{}]
        free = (things[self.number] if self.number < len(things) else {}).get("free")
        width = WIDTHS[layout.dimensions]
        coupling = table.get("coupling") or {}
        gains = [(coupling.get(part) or {}).get("stiffness", 0.0) for part in ("external", "internal")]
        plain = all(isinstance(each, int | float) and each > 0.0 for each in gains)
        return mode_name(
            swing.reshape(len(self.fingers), -1),
            self.arms(first, stop),
            free or [True] * width,
            self.touching(first, stop),
            [layout.fingers[i] for i in self.fingers],
            (float(gains[0]), float(gains[1])) if plain else (1.0, 1.0),
        )

    def _position(self, first: int, stop: int) -> FloatArray:
        is_true = "true_position" in self.recording.layout.columns
        return self._read("true_position" if is_true else "finger_position", first, stop)

    def _read(self, column: str, first: int, stop: int) -> FloatArray:
        values = self.recording.read(column, first, stop)
        return values if len(self.fingers) == values.shape[1] else values[:, self.fingers]  # all, as they stand


def grasps(recording: History) -> Iterator[GraspView]:
    """List each object with its fingers, up to a fault."""
    layout = recording.layout
    rows = min([len(recording), *(recording.header.rows_before(fault.tick) for fault in recording.faults)])
    for number, name in enumerate(layout.objects):
        fingers = np.flatnonzero(np.array(layout.finger_objects) == number)
        if fingers.size and rows:
            yield GraspView(recording, name, number, fingers, rows)
