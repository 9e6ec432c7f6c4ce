"""The loop of a scene at the rest that a recording of it ends with."""

from __future__ import annotations

from os import PathLike

from graspfx.analysis.linearisation import Linearisation
from graspfx.certificate.linearise import linearise
from graspfx.certificate.rest.from_recording import recording_of
from graspfx.loop.recording.record import Recording
from graspfx.scene.model import Scene


def recorded_loop(scene: Scene, recording: Recording | str | PathLike[str]) -> Linearisation:
    """Linearise a scene where a recording of it ends, with the lateness that its forces had there.

    Raises:
        InputError: a recording of another scene, or without a row; a device that does not tell its mass or friction.
        RecordingError: a path that leads to no recording.
    """
    return linearise(scene, "recorded", recording=recording_of(scene, recording)).linear
