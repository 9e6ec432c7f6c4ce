"""Replay of a recording: forces and motions of objects are recomputed from the recorded motion of the fingers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import groupby
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from graspfx.assembly.hardware import meet_hardware
from graspfx.assembly.live import numbered
from graspfx.assembly.provenance import header_of
from graspfx.assembly.resolve import require_no_host, resolve
from graspfx.assembly.session import Session
from graspfx.environment import granted
from graspfx.errors import GraspFXError, InputError, RecordingError, SceneError, message
from graspfx.loop.columns import REST
from graspfx.loop.played import PHASES, Playback
from graspfx.progress import waiting
from graspfx.recording.files import NAME, make_folder, recording_path, require_vacancy_of
from graspfx.recording.header import OF_THE_RUN, Header, KeyChange
from graspfx.recording.record import Difference, Recording, compared, differences
from graspfx.scene.overrides import by_key
from graspfx.scene.source import Source

if TYPE_CHECKING:
    from graspfx.assembly.resolve import Parts
    from graspfx.scene.model import Scene

OWN = "engine"  # key of a scene that does not affect results
NEEDS = ("finger_position", "finger_velocity")


def replay(
    recording: Recording | str | PathLike[str],
    overrides: Mapping[str, Any] | None = None,
    *,
    out: str | PathLike[str] | None = None,
    overwrite: bool = False,
    trust: bool = False,
) -> Recording:
    """Replay a recording: recompute forces and motions of objects from the recorded motion of the fingers.

    Without overrides, the results are bit-identical to the recording, also after held samples, skipped periods, changes
    of keys and device faults. With overrides, the results are those of the changed scene for the same motion of the
    fingers. Such a replay is open-loop, because the fingers do not respond to the changed forces.

    Args:
        recording: Recording of every tick, or path of such a recording.
        overrides: Values by dotted key that replace values of the recorded scene; none if None.
        out: Folder in which the replay is saved as recording.h5; not saved if None.
        overwrite: Whether to replace an existing recording in `out`.
        trust: Whether Python files that the recording names (drivers, hands, dynamics) may run, and files outside the
            scene's folder may be used, as with `graspfx replay --trust`. Read these files first.

    Returns:
        Recording of the replay, with the columns that follow from the motion of the fingers.

    Raises:
        InputError, UnknownNameError, SceneError: If an override is unknown or not allowed in the scene, or `trust` is
            neither True nor False.
        RecordingError: If the recording lacks data that a replay needs, its scene cannot be restored, one of its meshes
            has changed, it names Python files without `trust` or GRASPFX_TRUST=1, or `out` already has a recording.
    """
    if not isinstance(trust, bool):
        raise InputError("trust", trust, "True or False")
    changes = by_key(overrides)
    folder = None if out is None else recording_path(out, "out")
    if folder is not None and not overwrite:
        require_vacancy_of(folder / NAME)
    original = recording if isinstance(recording, Recording) else Recording.load(recording)
    with granted(trust):
        replayed = replayed_with(original, changes).recording
    if folder is not None:
        replayed.save(make_folder(folder) / NAME, overwrite=overwrite)
    return replayed


@dataclass(frozen=True)
class Replay:
    """A replay and its original recording.

    Attributes:
        original: Original recording.
        recording: Recording of the replay.
        is_open_loop: Whether values of the scene other than the engine were replaced.
        differences: Differences between the two recordings, one for each column that differs.
    """

    original: Recording
    recording: Recording
    is_open_loop: bool
    differences: Sequence[Difference]

    @property
    def columns(self) -> list[str]:
        """Names of the compared columns."""
        return compared(self.original, self.recording)


def replayed_with(original: Recording, overrides: Mapping[str, Any]) -> Replay:
    """Replay a recording with overrides, and compare the two recordings; errors are those of `replay`."""
    _require(original)
    is_open = any(key != OWN for key in overrides)
    scene = _scene_of(original, overrides)
    require_no_host(scene, "a replay")
    parts = resolve(scene)
    _require_meshes(original, parts)
    largest = _largest_forces(original, scene, overrides) if _lacks_largest(original, parts) else None
    best: Replay | None = None
    for phase in PHASES if original.faults else PHASES[:1]:
        with Replaying(original, scene, Playback(original, largest, phase)) as session:
            session.follow()
        recording = session.recording
        each = Replay(original, recording, is_open, differences(original, recording))
        if best is None or len(each.differences) < len(best.differences):
            best = each
        if is_open or not each.differences:
            break
    assert best is not None
    return best


def _require(recording: Recording) -> None:
    """Check that a recording has all data that a replay needs."""
    header, layout = recording.header, recording.layout
    if header.every > 1:
        raise RecordingError(
            f"a replay needs every tick, but this recording has only one in {header.every}: run again with "
            "record.every = 1"
        )
    needs = [*NEEDS, *(("fresh",) if layout.timed else ()), *(("largest_force",) if layout.timed else ())]
    missing = [name for name in needs if name in layout.omitted]
    if missing:
        raise RecordingError(
            f"a replay needs {', '.join(missing)}, which the scene's record.columns omit: add the names, or leave "
            "record.columns empty, and run again"
        )
    if not header.scene_table:
        raise RecordingError("a replay needs the scene, which this recording, of an earlier format, does not contain")
    if recording.outcome.lost:
        raise RecordingError(
            f"a replay needs every tick, but {recording.outcome.lost} rows of this recording were lost"
        )
    if not len(recording):
        raise RecordingError("a replay needs at least one tick, but this recording has none")


def _scene_of(original: Recording, overrides: Mapping[str, Any]) -> Scene:
    """Restore the scene of a recording with overrides; relative paths refer to the folder of the original scene."""
    from graspfx.scene.model import make_scene

    header = original.header
    table = {key: value for key, value in header.scene_table.items() if key != "record"}
    if table.get("engine") == "compiled":
        table["engine"] = "auto"  # compiling a program takes longer than it saves in one replay
    folder = Path(header.scene_folder) if header.scene_folder else Path.cwd()
    path = folder / f"{header.scene or 'scene'}.toml"
    source = Source(header.scene or "scene", header.scene_text, path, dict(overrides), is_recorded=True)
    try:
        scene = make_scene(table, overrides, source)
    except GraspFXError as error:
        if overrides and isinstance(error, SceneError) and _is_sound(table, source):
            raise
        version = header.versions.get("graspfx", "an earlier version")
        raise RecordingError(
            f"the scene of this recording, made with GraspFX {version}, cannot be restored; its paths are relative "
            f"to {folder}; {message(error)}"
        ) from error
    layout = original.layout
    if (scene.finger_names, scene.dimensions, scene.period) != (layout.fingers, layout.dimensions, header.period):
        raise InputError(
            "overrides", dict(overrides), "values that do not change the recorded fingers, dimensions and period"
        )
    return scene


def _is_sound(table: Mapping[str, Any], source: Source) -> bool:
    """Return whether the table of a recorded scene is valid without overrides."""
    from graspfx.scene.model import make_scene

    try:
        make_scene(table, {}, replace(source, overrides={}))
    except GraspFXError:
        return False
    return True


def _require_meshes(original: Recording, parts: Parts) -> None:
    """Check that the centres of mass and principal axes of a recording's meshes have not changed."""
    for name, frame in original.header.frames.items():
        now = parts.mesh_frames.get(name)
        if now is not None and any(list(frame[key]) != list(now[key]) for key in frame):
            raise RecordingError(
                f"the mesh of {name} has changed since the recording: its centre of mass or its principal axes differ; "
                "restore the original file"
            )


def _lacks_largest(original: Recording, parts: Parts) -> bool:
    """Return whether the largest force of a device may change during the run and is not recorded."""
    from graspfx.assembly.device_limits import changes

    return any(changes(wire) for wire in parts.wires) and "largest_force" not in original.layout.columns


def _largest_forces(original: Recording, scene: Scene, overrides: Mapping[str, Any]) -> Recording:
    """Repeat the simulation of a recording, and return a recording with the largest forces that devices report."""
    if overrides:
        scene = _scene_of(original, {key: value for key, value in overrides.items() if key == OWN})
    if not resolve(scene).simulated:
        raise RecordingError(
            "a replay needs the column largest_force, which this recording does not have: run the scene again"
        )
    with Replaying(original, scene, None) as session:
        session.follow()
    return session.recording


class Replaying(Session):
    """A run with recorded readings, or a repeated simulation, in which keys change at the recorded ticks.

    Args:
        original: Original recording.
        scene: Scene to run.
        playback: Playback of the readings in the recording; None to simulate the scene's devices again.
    """

    def __init__(self, original: Recording, scene: Scene, playback: Playback | None) -> None:
        self._original, self._playback = original, playback
        keys = dict.fromkeys(numbered(scene, change.key) for change in original.changes)
        super().__init__(scene, live=keys, ticks=len(original), playback=playback, varying=playback is None)

    def _start(self, stack: ExitStack, parts: Parts, keys: Sequence[str]) -> Header:
        header, servo, playback = self._original.header, self.servo, self._playback
        if playback is None:
            return super()._start(stack, parts, keys)
        if header.settled:
            names = {name: f for f, name in enumerate(servo.layout.fingers)}
            positions = {names[name]: np.array(each["position"], dtype=float) for name, each in header.settled.items()}
            meet_hardware(servo, parts, positions)
        playback.attach(servo.arena.ports, servo.stations)
        servo._io = playback
        return replace(
            header_of(parts, servo.objects), settled=header.settled, round_trip=header.round_trip,
            replays=f"{header.scene}, recorded {header.created}",
        )  # fmt: skip

    def follow(self) -> None:
        """Run as many ticks as the recording has, with the recorded changes of keys."""
        original, count = self._original, len(self._original)
        events = sorted(original.outcome.changes, key=lambda change: change.tick)
        with waiting(f"replaying {original.header.scene or 'a recording'}", count, "ticks", lambda: self.tick):
            for tick, each in groupby(events, lambda change: change.tick):
                if tick >= count:
                    break
                if tick > self.tick:
                    self.step(tick - self.tick)
                self._change(list(each))
            if self.tick < count:
                self.step(count - self.tick)

    def _change(self, changes: Sequence[KeyChange]) -> None:
        """Apply recorded changes of keys before the next tick."""
        self.set({change.key: change.value for change in changes if change.key not in OF_THE_RUN})
        for change in changes:
            if change.key == REST and self.servo.safety is not None:
                self.servo.safety.rest()
                self._recorder.change(self.tick, {REST: change.value})

    def _outcome(self, complete: bool) -> dict[str, Any]:
        first, faults = self._original.faults[:1], self._recorder.faults
        if self._playback is not None and first and faults and faults[0][1] == first[0][1]:
            faults[:1] = first
        return super()._outcome(complete) | {"wall_time": None, "complete": self._original.outcome.complete}
