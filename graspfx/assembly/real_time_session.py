"""Sessions that run in real time in another process, and whose values can be read and changed during the run."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.live import DEVICE, GUIDE, is_of_a_hand
from graspfx.assembly.process.orders import GoalSender, GuideKeys, goal_places, guide_keys
from graspfx.assembly.process.servo_process import Mail, letter_of, servo_process
from graspfx.assembly.provenance import split_rules
from graspfx.assembly.resolve import Parts, resolve
from graspfx.assembly.session import Session
from graspfx.card import Card
from graspfx.errors import InputError
from graspfx.loop.columns import RunFault
from graspfx.loop.realtime.process import Interruption
from graspfx.loop.realtime.ring import SLOTS, Letter, Phase, Ring, Word
from graspfx.loop.servo import Update
from graspfx.numeric import single
from graspfx.recording.header import MARK, SPLIT, Header
from graspfx.recording.record import Recording
from graspfx.scene.keys import general

if TYPE_CHECKING:
    from graspfx.recording.recorded_split import Split
    from graspfx.scene.model import Scene


ENDLESS = 1 << 53  # ticks
LOOK = 0.05  # interval of checks for signals and faults of the recording [s]


class RealTimeSession(Session):
    """A real-time run in a separate process, with or without hardware; `gx.open(scene, real_time=True)` creates it.

    Ticks run until the end of the `with` block. Then all forces decay to zero, the recording is closed, and finally the
    hardware is closed. Positions, velocities and forces of the session are those of the last received tick, which is at
    most about 20 ms old. A signal (Ctrl-C, SIGTERM or SIGHUP) ends the block and the run at once.

    Args:
        scene: Scene to run.
        live, out, overwrite: As for `gx.open`.
    """

    is_paced = True

    def _start(self, stack: ExitStack, parts: Parts, keys: Sequence[str]) -> Header:
        for key in keys:
            if self.servo.hardware and (is_of_a_hand(general(key)) or general(key) in DEVICE):
                raise InputError(
                    "live", key, "gains, friction and numbers of objects",
                    f"in a scene with hardware ({', '.join(self.servo.hardware)}), keys of hands and devices cannot be "
                    "live",
                )  # fmt: skip
        self._guided = [] if self.servo.hardware else guide_keys(self.scene, self.servo)
        goals = sum(len(place.entries) for place in goal_places(self.servo)) if self._guided else 0
        process = servo_process(parts, self.servo.layout, 1, ticks=ENDLESS, selected=False, live=keys, goals=goals)
        self._remote = stack.enter_context(process)
        self._goals = GoalSender(self._remote.ring, self.servo, self._guided)
        return self._remote.header

    def _begin(self) -> None:
        """Start the ticks of the servo."""
        self._began = time.perf_counter()
        self._relay = self._remote.begin(self._recorder, self._look, self._goals.by_key if self._guided else None)
        self._mail = Mail(self._remote.ring, self._relay)

    def _go(self) -> None:
        self._begin()
        while not self.tick and not self._remote.await_rest(0.005):
            if self._remote.exits.numbers:
                raise Interruption(self._remote.exits.cause)
        if self._remote.error is not None:  # for example because a finger has moved in the meantime
            raise self._remote.error
        self._remote.exits.inside = True  # a signal interrupts the user's code

    def _look(self, first: int, count: int) -> None:
        """Update the last row and the number of ticks in this process's copy of the servo, after a batch of rows."""
        self.servo.row = self._recorder.row.copy()
        self.servo.ticks = first + count

    def _card(self) -> Card:
        rows = [("live", ", ".join(self.live)), ("fault", str(self.fault or ""))]
        face = ".wait(seconds), .set(key, value), .mark(text), .rest(), .position, .force, .recording, .close()"
        return Card(repr(self), rows, face)

    def step(self, ticks: int = 1) -> None:
        """Raise an error, because ticks follow the wall clock.

        Raises:
            InputError: Always.
        """
        raise InputError("ticks", ticks, "a session without real time", "in real time, use wait instead of step")

    def wait(self, seconds: float) -> bool:
        """Wait for a time [s] or until the run ends, and return whether the run continues.

        Raises:
            InputError: If the time is not a number.
            RecordingError: If the recording cannot be written; all forces are zero when this error is raised.
            Exception: If an error, such as an error of a driver, ended the run; this error is raised.
        """
        end = time.monotonic() + single("seconds", seconds, "a time [s]")
        with self._undisturbed():
            while not self._remote.exits.numbers:
                left = end - time.monotonic()
                if self._remote.await_rest(max(0.0, min(left, LOOK))) or left <= LOOK:
                    break
            for error in (self._remote.guard.failure, self._remote.error):
                if error is not None:
                    raise error
        return not self._remote.has_rested

    def mark(self, text: str) -> int:
        """Record a text marker, for example at the beginning of a trial, and return the marker's tick.

        Raises:
            InputError: If `text` is not a string, or the run has ended.
        """
        if not isinstance(text, str):
            raise InputError("text", text, "a text")
        with self._undisturbed():
            return self._mail.post(Letter([], []), {MARK: text}, self._require_going)

    def rest(self) -> None:
        """End the run: let all forces decay to zero; the recording remains accessible."""
        with self._undisturbed():
            self._remote.rest()

    @property
    def fault(self) -> RunFault | None:
        """First fault of the run, after which all forces are zero; None without a fault."""
        return RunFault(*self._relay.faults[0]) if self._relay.faults else None

    def _write(self, update: Update) -> None:
        letter = letter_of(self.servo, update)
        with self._undisturbed():
            self._require_going()
            self.servo.write(update)
            if any(general(key) in GUIDE for key in update.values):  # values of these keys are sent as goals
                self._goals.send_all(self.servo)
            values = {key: value for key, value in update.values.items() if general(key) not in GUIDE}
            if not values:
                return
            split = split_rules(self.servo.objects)
            if split != self._splits[-1][1]:
                values[SPLIT] = split
            tick = self._mail.post(letter, values, self._require_going)
            if SPLIT in values:
                self._splits.append((tick, split))

    def _require_going(self) -> None:
        """Wait until the first tick has been received; raise an error if the run has ended."""
        self._require_open()
        while not self._remote.await_rest(0.0):
            if self.tick:
                return
            time.sleep(0.001)
        cause = self._remote.outcome["cause"] or "all forces are zero"
        raise InputError("session", self, "a session that is running", f"this session has ended: {cause}")

    @contextmanager
    def _undisturbed(self) -> Iterator[None]:
        """Delay the effect of signals to the end of the block."""
        exits = self._remote.exits
        exits.inside = False
        try:
            yield
        finally:
            exits.inside = self._finished is None
        if exits.numbers:
            raise Interruption(exits.cause)

    def _recording_so_far(self) -> Recording:
        with self._undisturbed(), self._remote.guard.lock:
            return super()._recording_so_far()

    def _outcome(self, complete: bool) -> dict[str, Any]:
        if not self._remote.has_rested:
            return {"wall_time": None, "complete": False, "engine": self._remote.engine}
        return self._remote.outcome | {"wall_time": self._spent if complete else None, "complete": complete}

    def _close(self, *, complete: bool) -> None:
        if self._finished is not None:
            return
        remote = self._remote
        remote.exits.inside = False
        remote.rest()
        self._spent = time.perf_counter() - self._began
        super()._close(complete=complete and not (remote.outcome["cause"] or remote.error))
        if remote.error is not None and complete:  # otherwise the block ends in an error anyway
            raise remote.error


FloatArray = NDArray[np.float64]
BEGINNING = 0.005  # interval of checks whether a servo runs [s]


class LiveSession(RealTimeSession):
    """A real-time run, for viewers, that can be paused; rows are kept only in the ring buffer unless `out` is given.

    Args:
        scene: Scene to run.
        live, out, overwrite: As for `gx.open`.
        paused: Whether the session pauses before the first tick.
    """

    keeps_rows = False

    def __init__(
        self,
        scene: Scene,
        *,
        live: Iterable[str] = (),
        out: str | PathLike[str] | None = None,
        overwrite: bool = False,
        paused: bool = False,
    ) -> None:
        self._is_recorded, self._begins_paused = out is not None, paused
        super().__init__(scene, live=live, out=out, overwrite=overwrite)

    def _go(self) -> None:
        if self._begins_paused:
            self.pause()
        self._begin()
        words = self.ring.words
        while not words[Word.HEAD] and not (self._begins_paused and words[Word.PHASE] == Phase.RUNNING):
            if self._remote.await_rest(BEGINNING):
                break
        if self._remote.error is not None:
            raise self._remote.error

    def _look(self, first: int, count: int) -> None:
        super()._look(first, count)
        if not self._is_recorded:
            self._recorder.changes.clear()  # changes are not needed, and a day produces many
            oldest = first + count - SLOTS  # tick of the oldest available row
            while len(self._splits) > 1 and self._splits[1][0] <= oldest:
                del self._splits[0]

    @property
    def ring(self) -> Ring:
        """Ring buffer with the rows and status words of the servo."""
        return self._remote.ring

    @property
    def goals(self) -> GoalSender:
        """Sender of the goals of guided hands."""
        return self._goals

    @property
    def guided(self) -> list[GuideKeys]:
        """Key and fingers of each guided hand."""
        return self._guided

    @property
    def header(self) -> Header:
        """Header of the recording."""
        return self._recorder.header

    @property
    def splits(self) -> list[tuple[int, Split]]:
        """Split rules of the objects' grasps during the run, each with the first tick at which it applies."""
        return list(self._splits)

    @property
    def start(self) -> FloatArray:
        """Start positions of the fingers, (n, d) [m]."""
        return resolve(self.scene).start

    @property
    def outcome(self) -> dict[str, Any]:
        """Items of the run's `Outcome`."""
        return self._remote.outcome

    @property
    def error(self) -> BaseException | None:
        """Error that ended the run; None without an error."""
        return self._remote.guard.failure or self._remote.error

    def look(self) -> bool:
        """Process messages of the servo, and return whether the servo still runs."""
        return not self._remote.await_rest(0.0)

    def _require_going(self) -> None:
        self._require_open()
        if not self.look():
            cause = self._remote.outcome["cause"] or "it was closed"
            raise InputError("run", "a run that has ended", "a run that is running", f"this run has ended: {cause}")
        while not self.tick and not self._waits_to_begin and self.look():
            time.sleep(0.001)

    @property
    def _waits_to_begin(self) -> bool:
        return int(self.ring.words[Word.HALT]) == 1 and not self.ring.words[Word.HEAD]

    # Pauses -------------------------------------------------------------------------------------------------------

    @property
    def is_paused(self) -> bool:
        """Whether the run is paused before its next tick."""
        words = self.ring.words
        halt = int(words[Word.HALT])
        return bool(halt) and int(words[Word.HEAD]) >= halt - 1

    def pause(self) -> None:
        """Pause before the next tick; during the pause, values and goals can be changed.

        Raises:
            InputError: If the scene has hardware.
        """
        self.require_no_hardware("pause")
        self.ring.words[Word.HALT] = 1

    def resume(self) -> None:
        """Continue the run after a pause, without ticks for the time of the pause.

        Raises:
            InputError: If the scene has hardware.
        """
        self.require_no_hardware("resume")
        self.ring.words[Word.HALT] = 0

    def advance(self, ticks: int) -> None:
        """Run one or more ticks at the normal rate, and pause again; a run that is not paused is paused first.

        Raises:
            InputError: If the scene has hardware.
        """
        self.require_no_hardware("step")
        words = self.ring.words
        if not self.is_paused:
            words[Word.HALT] = 1
            time.sleep(2.0 * self.scene.period)  # lets a tick that has begun finish
        words[Word.HALT] = max(int(words[Word.HALT]) - 1, int(words[Word.HEAD])) + ticks + 1

    def require_no_hardware(self, action: str) -> None:
        """Check that the scene has no hardware, with which `action` is not possible.

        Raises:
            InputError: If the scene has hardware.
        """
        if self.servo.hardware:
            raise InputError(
                action, ", ".join(self.servo.hardware), "a scene with simulated devices only",
                "a run with hardware cannot be paused, because a person feels its forces; use rest() instead",
            )  # fmt: skip
