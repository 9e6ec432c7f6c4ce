"""A recording: what happened in a run, its summary, and its way to a file and back."""

from __future__ import annotations

from os import PathLike
from typing import Any

from graspfx.loop.recording.history import History


class Recording(History):
    """A run, tick by tick: row k of each array holds what was read at the time k T and what was computed from that.

    Args:
        rows: (N, width), read-only from here on.
        layout: its columns.
        header: what was known before the run.
        outcome: how it went.
    """

    def summary(self) -> dict[str, Any]:
        """Summarise the run in SI units; the keys are those of `graspfx.loop.recording.summary.summarise`."""
        from graspfx.loop.recording.growth.growth import losses
        from graspfx.loop.recording.summary import summarise

        return summarise(
            period=self.period,
            finger_position=self.finger_position,
            contact_position=self.contact_position,
            finger_force=self.finger_force,
            displayed_force=self.displayed_force,
            saturated=self.saturated,
            touching=self.touching,
            gap=self.gap,
            device_energy=self.device_energy,
            object_position=[motion.position for motion in self.objects.values()],
            finger_objects=self.layout.finger_objects,
            wall_time=self.wall_time,
            engine=self.outcome.engine,
            fade_shortfall=self.outcome.fade_shortfall,
            blended=self.outcome.blended,
            true_position=self.true_position,
            faults=len(self.faults),
            law=[motion.law for motion in self.objects.values() if motion.law is not None],
            residual=[motion.residual for motion in self.objects.values() if motion.residual is not None],
            energy=list(self.energy.values()),
            growth=losses(self),
            changes=len(self.changes),
        )

    def save(self, path: str | PathLike[str], *, overwrite: bool = False) -> None:
        """Write the recording as HDF5; the file appears when it is whole.

        Args:
            path: of the file.
            overwrite: whether a file that is there already is replaced.

        Raises:
            RecordingError: the file is there already, or cannot be written.
        """
        from graspfx.loop.recording.sink import save

        save(path, self.rows, self.layout, self.header, self.outcome, overwrite=overwrite)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Recording:
        """Load a recording from a file; also of a run that goes on or was killed, as far as it was written.

        Args:
            path: of the file, or of the folder in which it is recording.h5. Where there is only the part that a run
                writes until it ends, recording.h5.part, it is read: its outcome is not `complete`.

        Raises:
            RecordingError: there is no recording in the file, or its bytes were changed since it was written.
        """
        from graspfx.loop.recording.file import read

        return cls(*read(path))
