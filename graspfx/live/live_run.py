"""Real-time run of a scene that other threads watch and control: values, goals of hands, pauses and recordings."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from os import PathLike
from pathlib import Path
from threading import Condition, Lock, Thread
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.process.orders import FARTHEST
from graspfx.assembly.real_time_session import LiveSession
from graspfx.errors import InputError, message
from graspfx.live.guides import Guide, guided_scene, guides_of, withdrawal
from graspfx.loop.columns import Layout, RunFault
from graspfx.loop.realtime.ring import SLOTS, Phase, Word
from graspfx.numeric import count
from graspfx.recording.files import NAME, recording_path, require_vacancy_of
from graspfx.recording.header import SPLIT, Header, KeyChange
from graspfx.resource import Resource

if TYPE_CHECKING:
    from graspfx.loop.servo import Servo
    from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]
State = Literal["running", "paused", "ended"]

MARGIN = 64  # number of oldest rows that may be overwritten during a copy
SHORTEST, LONGEST = 0.0005, 0.002  # range of the polling interval for rows [s]
LOOK = 0.1  # interval between checks of the run [s]
CLEARANCE = 0.003  # distance of a released finger from the object [m]
GROWTH = 2.0  # factor of the clearance in each further step
LAGS = 6.0  # time between steps, in lags of the follower
OFTEN = 1.0  # time after a step during which every row is checked [s]
SELDOM = 0.05  # interval between later checks [s]


class LiveRun(Resource):
    """Real-time run of a scene in a separate process; any thread may watch and control the run.

    A method waits for the servo only where its description says so. The end of a `with` block closes the run.

    Args:
        scene: Scene to run.
        live: Keys that `set` may change; None if it may change no keys.
        out: Folder in which recording.h5 is written; None for no recording.
        overwrite: Whether to replace an existing recording in `out`, including an unfinished one of a killed run.
        guide: "hands" for one guide per hand of simulated fingers, "fingers" for one guide per simulated finger, or
            None for no guides.
        paused: Whether the run starts paused.

    Attributes:
        guides: Guides of the hands or fingers.
        run_number: Number of the present run, starting at 0; `reset`, `record` and `stop_recording` start the next run.

    Raises:
        InputError, SceneError, DeviceError, RecordingError: As in `graspfx.open`.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        live: Sequence[str] | None = None,
        out: str | PathLike[str] | None = None,
        overwrite: bool = False,
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
            self._conductor.do(lambda: self._open(out, overwrite=overwrite, paused=paused)).result()
        except BaseException:
            self._has_ended = True
            self._conductor.end(self._close)
            raise
        self.guides: Sequence[Guide] = guides_of(self._session, guide)

    def _open(self, out: str | PathLike[str] | None, *, overwrite: bool = False, paused: bool = False) -> None:
        self._session = LiveSession(self._scene, live=self._live, out=out, overwrite=overwrite, paused=paused)
        self._out, self._has_ended = None if out is None else Path(out) / NAME, False

    # State of the run -----------------------------------------------------------------------------------------------

    @property
    def scene(self) -> Scene:
        """Scene with the present values; it does not contain the goals of guides."""
        return self._session.scene

    @property
    def layout(self) -> Layout:
        """Columns of the rows."""
        return self._session.servo.layout

    @property
    def servo(self) -> Servo:
        """Copy of the servo, from which the devices and their workspaces can be read; the copy does not run."""
        return self._session.servo

    @property
    def header(self) -> Header:
        """Header that a recording of this run has."""
        return self._session.header

    @property
    def period(self) -> float:
        """Sampling period T [s]."""
        return self._session.servo.period

    @property
    def has_hardware(self) -> bool:
        """Whether any device is hardware."""
        return bool(self._session.servo.hardware)

    @property
    def ticks(self) -> int:
        """Number of ticks whose rows have been written; `rows` returns at most the last 16320 rows."""
        return int(self._session.ring.words[Word.HEAD])

    @property
    def tick(self) -> int:
        """Tick of the newest row; -1 before the first row."""
        return self.ticks - 1

    @property
    def time(self) -> float:
        """Time of the newest row, tick x period [s]; zero before the first row."""
        return max(self.tick, 0) * self.period

    @property
    def state(self) -> State:
        """State of the run; at the end of the run, the state is "ended" as soon as all forces are zero."""
        session = self._session
        if self._has_ended or int(session.ring.words[Word.PHASE]) >= Phase.RESTED:
            return "ended"
        return "paused" if session.is_paused else "running"

    @property
    def fault(self) -> RunFault | None:
        """First fault of the run, after which all forces are zero; None if there is no fault."""
        return self._session.fault

    @property
    def splits(self) -> list[KeyChange]:
        """Changes of the rule that splits forces into internal and external parts, as a recording stores them."""
        return [KeyChange(since, SPLIT, split) for since, split in self._session.splits]

    @property
    def cause(self) -> str:
        """Reason why the run ended; empty if the run has not ended or was closed."""
        if self.state != "ended":
            return ""
        return str(self._session.outcome["cause"]) or ("" if self.error is None else message(self.error))

    @property
    def error(self) -> BaseException | None:
        """Exception that ended the run, or None."""
        return self._session.error

    def row(self) -> FloatArray | None:
        """Return a copy of the newest row, or None before the first row."""
        ring = self._session.ring
        while True:  # if the copy takes 16384 ticks, the row may be overwritten during the copy
            head = int(ring.words[Word.HEAD])
            if not head:
                return None
            row: FloatArray = ring.rows[(head - 1) % SLOTS].copy()
            if int(ring.words[Word.HEAD]) - head < SLOTS - 1:
                return row

    def rows(self, since: int) -> tuple[int, FloatArray]:
        """Return the tick of the first available row from tick `since` on, and copies of all available rows (r, width).

        If there are no such rows, r is zero.
        """
        ring = self._session.ring
        head = int(ring.words[Word.HEAD])
        first = min(max(int(since), head - SLOTS + MARGIN, 0), head)
        at, end = first % SLOTS, first % SLOTS + head - first
        rows: FloatArray = np.concatenate([ring.rows[at : min(end, SLOTS)], ring.rows[: max(end - SLOTS, 0)]])
        late = max(int(ring.words[Word.HEAD]) - SLOTS + 1 - first, 0)  # rows that may have been overwritten since
        return first + late, rows[late:]

    def await_row(self, after: int, seconds: float) -> bool:
        """Wait at most `seconds` for a row later than tick `after`; return whether there is such a row."""
        words, end = self._session.ring.words, time.monotonic() + seconds
        pause = min(max(0.25 * self.period, SHORTEST), LONGEST)
        while int(words[Word.HEAD]) - 1 <= after:
            left = end - time.monotonic()
            if left <= 0.0 or self.state == "ended":
                return int(words[Word.HEAD]) - 1 > after
            time.sleep(min(pause, left))
            words = self._session.ring.words  # a reset replaces the ring
        return True

    # Steering -----------------------------------------------------------------------------------------------------

    def set(self, values: Mapping[str, Any]) -> Future[None]:
        """Change values of live keys; a new value of a key replaces a value of that key that has not yet been set.

        Returns:
            Future that completes when the servo uses the values; its `result` raises the exceptions of `Session.set`.
        """
        return self._conductor.set(values)

    def guide(self, number: int, offset: Any, squeeze: float | None = None, finger: int | None = None) -> None:
        """Set the goals of a guide; the servo applies the newest goals before the next tick.

        Args:
            number: Number of the guide.
            offset: Operator offset of the guide's fingers (d,) [m]; None keeps the present offset.
            squeeze: Additional squeeze, added to the squeeze of the hand [m]; None keeps the present value.
            finger: Index, within the hand, of the finger to which the offset applies; None for all fingers of the hand.

        Raises:
            InputError: If the guide does not exist, or a goal is not finite, has the wrong shape or is too far away.
        """
        guide = self._guide_of(number)
        self._end_release(number)
        self._session.goals.send(guide.hand, offset, squeeze, guide.place if guide.place is not None else finger)

    def goal(self, number: int) -> tuple[FloatArray, float]:
        """Return the last goals of a guide: mean offset of the guide's fingers (d,) [m], and additional squeeze [m].

        Raises:
            InputError: If the guide does not exist.
        """
        offsets, squeeze = self.goals(number)
        return offsets.mean(axis=0), squeeze

    def goals(self, number: int) -> tuple[FloatArray, float]:
        """Return the last goals of a guide: offsets of the guide's k fingers (k, d) [m], and additional squeeze [m].

        Raises:
            InputError: If the guide does not exist.
        """
        guide = self._guide_of(number)
        offsets, squeeze = self._session.goals.values(guide.hand)
        return (offsets if guide.place is None else offsets[[guide.place]]), squeeze

    def let_go(self, number: int) -> None:
        """Withdraw a guide's fingers along the forces on them until they are free, and keep them there.

        Raises:
            InputError: If the guide does not exist.
        """
        guide = self._guide_of(number)
        self._end_release(number)
        release = self._releases[number] = Release(self, self._session, guide)
        release.begin()

    def _end_release(self, number: int) -> None:
        release = self._releases.pop(number, None)
        if release is not None:
            release.end()

    def _guide_of(self, number: int) -> Guide:
        if not (type(number) is int and 0 <= number < len(self.guides)):
            raise InputError(
                "number", number, f"a guide, 0 to {len(self.guides) - 1}" if self.guides else "a run with guides"
            )
        return self.guides[number]

    # Pauses, resets and recordings ---------------------------------------------------------------------------------

    def pause(self) -> None:
        """Pause before the next tick; values and goals can still be changed.

        Raises:
            InputError: If the scene has hardware.
        """
        self._session.require_no_hardware("pause")
        self._conductor.do(lambda: self._session.pause())

    def resume(self) -> None:
        """Continue after a pause; the ticks of the pause are not made up.

        Raises:
            InputError: If the scene has hardware.
        """
        self._session.require_no_hardware("resume")
        self._conductor.do(lambda: self._session.resume())

    def step(self, ticks: int = 1) -> None:
        """Run a number of ticks in real time, then pause.

        Raises:
            InputError: If the scene has hardware, or the number is not an integer above zero.
        """
        self._session.require_no_hardware("step")
        ticks = count("ticks", ticks, 1)
        self._conductor.do(lambda: self._session.advance(ticks))

    def reset(self) -> None:
        """Start a new run with the present values and the guides at their initial positions; wait until it has started.

        Raises:
            RecordingError, DeviceError: If the new run cannot start; another reset may succeed.
            InputError: If hardware has failed.
        """
        self._conductor.do(lambda: self._renew(None)).result()

    def record(self, folder: str | PathLike[str]) -> Path:
        """Start a new run that is recorded from its first tick; wait until it has started.

        Args:
            folder: Folder of the recording.

        Returns:
            Path of the recording's file.

        Raises:
            RecordingError: If the folder already contains a recording, or cannot be written.
            InputError: If hardware has failed.
        """
        self._conductor.do(lambda: self._renew(folder)).result()
        assert self._out is not None
        return self._out

    def stop_recording(self) -> Path:
        """End the recording and start a new run that is not recorded; return the path of the recording's file.

        Raises:
            InputError: If the run is not recorded, or hardware has failed.
        """
        out = self._out
        if out is None:
            raise InputError("run", "a run that is not recorded", "a recorded run", "call record(folder) first")
        self._conductor.do(lambda: self._renew(None)).result()
        return out

    def _renew(self, out: str | PathLike[str] | None) -> None:
        """Start a new run; if an exception ended the previous run and that run was recorded, raise it afterwards."""
        self._require_sound_hardware()
        if out is not None:
            require_vacancy_of(recording_path(out, "folder") / NAME)
        was_recorded, failure = self._out is not None, None
        for number in list(self._releases):
            self._end_release(number)
        self._has_ended = True
        try:
            self._session.close()
        except Exception as error:  # noqa: BLE001 - from any driver or disk; also available as `error`
            failure = error
        self._scene, self._out = self._session.scene, None
        self._open(out)
        self.run_number += 1
        if was_recorded and failure is not None:
            raise failure

    def _require_sound_hardware(self) -> None:
        """Raise InputError if hardware has failed, because a button on a page must not start failed hardware again.

        The recording then remains open until this object is closed.
        """
        if not self.has_hardware or (self.fault is None and not self._session.outcome.get("cause")):
            return
        why = self.fault.message if self.fault is not None else self.cause
        do = "check the device, then end this program and start it again"
        raise InputError("run", f"hardware that has ended: {why}", "a run without a fault", do)

    def rest(self) -> None:
        """Let all forces decay to zero, and wait until they are zero."""
        self._conductor.do(lambda: self._session.rest()).result()

    def close(self) -> None:
        """Set the forces to zero, complete the recording and end the process; a second call has no effect."""
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


class Release:
    """Release of objects by a guide's fingers, supervised by a thread until the guide is moved again.

    The fingers are withdrawn by one step immediately. If a finger still touches an object after six time constants of
    the guide, because the object has followed the finger, it is withdrawn by a further step. Times are counted in
    ticks, so that pauses have no effect.

    Args:
        run: Run whose rows show which fingers touch.
        session: Session of the run.
        guide: Guide whose fingers release objects.
    """

    def __init__(self, run: LiveRun, session: LiveSession, guide: Guide) -> None:
        self._run, self._session, self._guide = run, session, guide
        self._lock, self._is_over, self._clearance = Lock(), False, CLEARANCE

    def begin(self) -> None:
        """Withdraw the fingers and start the thread, which also withdraws fingers that reach an object later."""
        has_touched = self._withdraw()
        Thread(target=self._watch, args=(has_touched,), name="graspfx-release", daemon=True).start()

    def end(self) -> None:
        """End the release: no finger is withdrawn any more."""
        with self._lock:
            self._is_over = True

    def _withdraw(self) -> bool:
        """Move touching fingers away from their objects; return whether any finger touches."""
        row, goals, guide = self._run.row(), self._session.goals, self._guide
        with self._lock:
            if row is None or self._is_over:
                return False
            offsets, _ = goals.values(guide.hand)
            has_touched = False
            for place in range(len(guide.all_fingers)) if guide.place is None else (guide.place,):
                step = withdrawal(self._session, row, guide.all_fingers[place], self._clearance)
                if step is not None:
                    has_touched = True
                    goals.send(guide.hand, np.clip(offsets[place] + step, -FARTHEST, FARTHEST), finger=place)
            if has_touched:
                self._clearance *= GROWTH  # larger, in case the object follows
            return has_touched

    def _watch(self, has_touched: bool) -> None:
        """Withdraw touching fingers until the release ends, or until all fingers arrive without having touched."""
        run, number = self._run, self._run.run_number
        wait, often = round(LAGS * self._guide.lag / run.period), round(OFTEN / run.period)
        step = run.ticks
        while not self._is_over and run.state != "ended" and run.run_number == number:
            if run.ticks - step < often:
                run.await_row(run.tick, SELDOM)
            else:
                time.sleep(SELDOM)
            if run.ticks - step > wait:
                if self._withdraw():
                    step, has_touched = run.ticks, True
                elif not has_touched:
                    return


class _Request(NamedTuple):
    """Request to call an action; `values` are the values that the action sets, None if it sets no values."""

    future: Future[None]
    action: Callable[[], object]
    values: Mapping[str, Any] | None = None


class Conductor:
    """Thread that executes requests to set values or to call an action, in the order of their arrival.

    Pending requests to set values that follow each other are executed together, with the newest value of each key. If
    setting all values together fails, the requests are executed one by one.

    Args:
        apply: Function that sets values by key.
        look: Function called periodically.
    """

    def __init__(self, apply: Callable[[Mapping[str, Any]], object], look: Callable[[], object]) -> None:
        self._apply, self._look = apply, look
        self._requests: list[_Request] = []
        self._change = Condition()
        self._is_over = False
        self._thread = Thread(target=self._run, name="graspfx-live", daemon=True)
        self._thread.start()

    def set(self, values: Mapping[str, Any]) -> Future[None]:
        """Request that values be set, by key."""
        own = dict(values)
        return self._ask(_Request(Future(), lambda: self._apply(own), own))

    def do(self, action: Callable[[], object]) -> Future[None]:
        """Request that an action be called."""
        return self._ask(_Request(Future(), action))

    def end(self, action: Callable[[], object]) -> None:
        """Reject pending requests, call a last action, and end the thread."""
        with self._change:
            if self._is_over:
                return
            self._is_over = True
            waiting, self._requests = self._requests, []
            last = _Request(Future(), action)
            self._requests.append(last)
            self._change.notify()
        for each in waiting:
            if each.future.set_running_or_notify_cancel():
                each.future.set_exception(_over())
        last.future.result()
        self._thread.join()

    def _ask(self, request: _Request) -> Future[None]:
        with self._change:
            if self._is_over:
                request.future.set_exception(_over())
            else:
                self._requests.append(request)
                self._change.notify()
        return request.future

    def _run(self) -> None:
        while True:
            with self._change:
                if not self._requests:
                    self._change.wait(LOOK)
                batch = self._next()
                is_last = self._is_over and not self._requests
            self._execute(batch)
            if is_last:
                return
            with suppress(Exception):  # for example a warning turned into an error, which was reported
                self._look()

    def _next(self) -> list[_Request]:
        """Remove and return the next request for an action, or all requests for values before it."""
        batch: list[_Request] = []
        while self._requests and not (batch and None in (batch[0].values, self._requests[0].values)):
            request = self._requests.pop(0)
            if request.future.set_running_or_notify_cancel():
                batch.append(request)
        return batch

    def _execute(self, batch: list[_Request]) -> None:
        """Execute several requests for values together; if this fails, or for one request, execute each separately."""
        are_set = False
        if len(batch) > 1:
            with suppress(BaseException):  # raised again below for the request that caused it
                self._apply({key: value for each in batch for key, value in (each.values or {}).items()})
                are_set = True
        for each in batch:
            try:
                if not are_set:
                    each.action()
            except BaseException as error:  # noqa: BLE001 - the future raises it
                each.future.set_exception(error)
            else:
                each.future.set_result(None)


def _over() -> InputError:
    return InputError("run", "closed", "an open run", "it was closed; start a new run")
