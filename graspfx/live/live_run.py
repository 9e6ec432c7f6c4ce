"""A scene that runs while it is looked at and steered: rows of now, values, goals of hands, pauses and recordings."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.real_time_session import LiveSession
from graspfx.errors import InputError, message
from graspfx.live.conductor import Conductor
from graspfx.live.guides import Guide, guided_scene, guides_of
from graspfx.live.letting_go import Release
from graspfx.loop.columns import Layout, RunFault
from graspfx.loop.realtime.ring import SLOTS, Phase, Word
from graspfx.recording.files import NAME, recording_path, require_vacancy_of
from graspfx.recording.header import Header
from graspfx.recording.split import Split
from graspfx.resource import Resource

if TYPE_CHECKING:
    from graspfx.loop.servo import Servo
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]
State = Literal["running", "paused", "ended"]

MARGIN = 64  # rows that may be written over while others are read
SHORTEST, LONGEST = 0.0005, 0.002  # between two looks whether a row has come [s]


class LiveRun(Resource):
    """A run of a scene on the wall's clock, in a process of its own, that any thread may look at and steer.

    Nothing here waits for the servo unless its text says so. The end of the `with` block closes it.

    Args:
        scene: what is run.
        live: keys that `set` may change; None for none.
        out: a folder in which recording.h5 is written; None for a run that nobody records.
        guide: "hands" gives each hand of simulated fingers a guide, "fingers" each of these fingers; None for none.
        paused: whether it waits before the first tick.

    Attributes:
        guides: one per hand, or per finger.
        run_number: counts resets.

    Raises:
        InputError, SceneError, DeviceError, RecordingError: as of `graspfx.open`.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        live: Sequence[str] | None = None,
        out: str | PathLike[str] | None = None,
        guide: Literal["hands", "fingers"] | None = None,
        paused: bool = False,
    ) -> None:
        if guide not in ("hands", "fingers", None):
            raise InputError("guide", guide, "'hands', 'fingers' or None")
        self._live, self._guide = tuple(live or ()), guide
        self._scene = guided_scene(scene) if guide is not None else scene
        self.run_number, self._has_ended = 0, False
        self._releases: dict[int, Release] = {}
        self._session: LiveSession
        self._out: Path | None = None
        self._conductor = Conductor(self._apply, self._look)
        try:
            self._conductor.do(lambda: self._open(out, paused=paused)).result()
        except BaseException:
            self._has_ended = True
            self._conductor.end(self._close)
            raise
        self.guides: Sequence[Guide] = guides_of(self._session, guide)

    def _open(self, out: str | PathLike[str] | None, *, paused: bool) -> None:
        self._session = LiveSession(self._scene, live=self._live, out=out, paused=paused)
        self._out, self._has_ended = None if out is None else Path(out) / NAME, False

    # Looking at it ------------------------------------------------------------------------------------------------

    @property
    def scene(self) -> Scene:
        """The scene with the values of now; goals of guides are no part of it."""
        return self._session.scene

    @property
    def layout(self) -> Layout:
        """Columns of a row."""
        return self._session.servo.layout

    @property
    def servo(self) -> Servo:
        """A copy of the servo that runs, whose devices tell their features and reach; its state is not the run's."""
        return self._session.servo

    @property
    def header(self) -> Header:
        """Header that a recording of this run has."""
        return self._session.header

    @property
    def period(self) -> float:
        """T [s]."""
        return self._session.servo.period

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys that `set` may change."""
        return self._session.live

    @property
    def has_hardware(self) -> bool:
        """Whether a device is no simulation."""
        return bool(self._session.servo.hardware)

    @property
    def ticks(self) -> int:
        """Count of ticks whose rows are there."""
        return int(self._session.ring.words[Word.HEAD])

    @property
    def tick(self) -> int:
        """Tick of the newest row; -1 before the first."""
        return self.ticks - 1

    @property
    def time(self) -> float:
        """Time of the newest row, tick x period [s]; zero before the first."""
        return max(self.tick, 0) * self.period

    @property
    def state(self) -> State:
        """Whether it runs, waits or has ended."""
        session = self._session
        if self._has_ended or int(session.ring.words[Word.PHASE]) >= Phase.RESTED:
            return "ended"
        return "paused" if session.is_paused else "running"

    @property
    def fault(self) -> RunFault | None:
        """The first fault; from it on every force is zero. None so far."""
        return self._session.fault

    @property
    def splits(self) -> Sequence[tuple[int, Split]]:
        """Rules by which forces divide into internal and external ones, each from a tick on."""
        return self._session.splits

    @property
    def cause(self) -> str:
        """Why it ended; empty as long as it goes on, and where it was closed."""
        if self.state != "ended":
            return ""
        return str(self._session.outcome["cause"]) or ("" if self.error is None else message(self.error))

    @property
    def error(self) -> BaseException | None:
        """Error that the run ended in; None without."""
        return self._session.error

    def row(self) -> FloatArray | None:
        """Copy the newest row; None before the first."""
        ring = self._session.ring
        while True:  # a row may be written over 16384 ticks later
            head = int(ring.words[Word.HEAD])
            if not head:
                return None
            row: FloatArray = ring.rows[(head - 1) % SLOTS].copy()
            if int(ring.words[Word.HEAD]) - head < SLOTS - 1:
                return row

    def rows(self, since: int) -> tuple[int, FloatArray]:
        """Copy the rows of the ticks from `since` on that are still there, (r, width); give the tick of the first."""
        ring = self._session.ring
        head = int(ring.words[Word.HEAD])
        first = min(max(int(since), head - SLOTS + MARGIN, 0), head)
        at, end = first % SLOTS, first % SLOTS + head - first
        rows: FloatArray = np.concatenate([ring.rows[at : min(end, SLOTS)], ring.rows[: max(end - SLOTS, 0)]])
        late = max(int(ring.words[Word.HEAD]) - SLOTS + 1 - first, 0)  # rows that may have been written over meanwhile
        return first + late, rows[late:]

    def await_row(self, after: int, seconds: float) -> bool:
        """Wait until a row is there that is newer than that of tick `after`; return whether one is."""
        words, end = self._session.ring.words, time.monotonic() + seconds
        pause = min(max(0.25 * self.period, SHORTEST), LONGEST)
        while int(words[Word.HEAD]) - 1 <= after:
            left = end - time.monotonic()
            if left <= 0.0 or self.state == "ended":
                return int(words[Word.HEAD]) - 1 > after
            time.sleep(min(pause, left))
            words = self._session.ring.words  # of a new run, maybe
        return True

    # Steering -----------------------------------------------------------------------------------------------------

    def set(self, values: Mapping[str, Any]) -> Future[None]:
        """Change live keys; of several values of a key that wait the newest holds.

        Returns:
            The future of the change: done when the servo has taken it; it raises what `Session.set` raises.
        """
        return self._conductor.set(values)

    def guide(self, number: int, offset: Any, squeeze: float | None = None) -> None:
        """Set the goals of a guide; the servo takes them before its next tick, the newest of several.

        Args:
            number: of the guide.
            offset: by which its fingers go aside, (d,) [m]; None leaves it.
            squeeze: that is added to its hand's [m]; None leaves it.

        Raises:
            InputError: no such guide; goals that are not finite, of another shape or too far away.
        """
        guide = self._guide_of(number)
        self._end_release(number)
        self._session.goals.send(guide.hand, offset, squeeze, guide.place)

    def goal(self, number: int) -> tuple[FloatArray, float]:
        """Give the last goals of a guide: its fingers' mean offset (d,) [m], and what is added to a squeeze [m].

        Raises:
            InputError: no such guide.
        """
        guide = self._guide_of(number)
        offsets, squeeze = self._session.goals.values(guide.hand)
        return (offsets.mean(axis=0) if guide.place is None else offsets[guide.place]), squeeze

    def let_go(self, number: int) -> None:
        """Withdraw a guide's fingers along their forces until they are free; they stay there until they are guided.

        Raises:
            InputError: no such guide.
        """
        guide = self._guide_of(number)
        self._end_release(number)
        release = self._releases[number] = Release(self, self._session, guide, guide.lag)
        release.begin()

    def _end_release(self, number: int) -> None:
        release = self._releases.pop(number, None)
        if release is not None:
            release.end()

    def _guide_of(self, number: int) -> Guide:
        if not (type(number) is int and 0 <= number < len(self.guides)):
            raise InputError("number", number, f"a guide, 0 to {len(self.guides) - 1}" if self.guides else "no guide")
        return self.guides[number]

    # Going on -----------------------------------------------------------------------------------------------------

    def pause(self) -> None:
        """Let the coming tick wait; values and goals are taken all the same.

        Raises:
            InputError: a scene with hardware.
        """
        self._session.require_no_hardware("pause")
        self._conductor.do(lambda: self._session.pause())

    def resume(self) -> None:
        """Go on after a pause: its time is not late, and no burst of ticks follows.

        Raises:
            InputError: a scene with hardware.
        """
        self._session.require_no_hardware("resume")
        self._conductor.do(lambda: self._session.resume())

    def step(self, ticks: int = 1) -> None:
        """Run that many ticks, at their pace, and pause.

        Raises:
            InputError: a scene with hardware, or no whole number above zero.
        """
        self._session.require_no_hardware("step")
        self._conductor.do(lambda: self._session.advance(ticks))

    def reset(self) -> None:
        """Begin a new run of the scene with the values of now, guides where they start; wait until it goes on.

        Raises:
            RecordingError, DeviceError: whatever keeps it from beginning; another reset may do it.
        """
        self._conductor.do(lambda: self._renew(None)).result()

    def record(self, folder: str | PathLike[str]) -> Path:
        """Begin a new run that is recorded in a folder, from its first tick on; wait until it goes on.

        Raises:
            RecordingError: the folder has a recording already, or cannot be written.
        """
        self._conductor.do(lambda: self._renew(folder)).result()
        assert self._out is not None
        return self._out

    def stop_recording(self) -> Path:
        """End the recording, and begin a new run that is not recorded; give the recording's file.

        Raises:
            InputError: nothing is recorded.
        """
        out = self._out
        if out is None:
            raise InputError("run", "one without a recording", "a run that is recorded", "record(folder) begins one")
        self._conductor.do(lambda: self._renew(None)).result()
        return out

    def _renew(self, out: str | PathLike[str] | None) -> None:
        """Begin a new run; what the former one ended in is raised afterwards where it was recorded."""
        self._require_sound_hardware()
        if out is not None:
            require_vacancy_of(recording_path(out, "folder") / NAME)
        was_recorded, failure = self._out is not None, None
        for number in list(self._releases):
            self._end_release(number)
        self._has_ended = True
        try:
            self._session.close()
        except Exception as error:  # noqa: BLE001 - of any driver or disk; it was there to be seen as `error`
            failure = error
        self._scene, self._out = self._session.scene, None
        self._open(out, paused=False)
        self.run_number += 1
        if was_recorded and failure is not None:
            raise failure

    def _require_sound_hardware(self) -> None:
        """Require that no hardware has ended in a fault: a button of a page does not arm it again.

        Raises:
            InputError: it has; its recording is closed with this object.
        """
        if not self.has_hardware or (self.fault is None and not self._session.outcome.get("cause")):
            return
        why = self.fault.message if self.fault is not None else self.cause
        do = "see to the device, end the program, and begin anew"
        raise InputError("run", f"hardware that has ended: {why}", "a run without fault", do)

    def rest(self) -> None:
        """Let every force decay to zero, and stay there; wait until it is."""
        self._conductor.do(lambda: self._session.rest()).result()

    def close(self) -> None:
        """End the run: forces are zero, the recording is whole, the process is gone; a second time nothing happens."""
        self._conductor.end(self._close)

    def _close(self) -> None:
        if hasattr(self, "_session"):
            self._session.close()
        self._has_ended = True

    def _apply(self, values: Mapping[str, Any]) -> None:
        self._session.set(dict(values))

    def _look(self) -> None:
        if hasattr(self, "_session") and not self._has_ended and not self._session.look():
            self._has_ended = True
