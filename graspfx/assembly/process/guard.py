"""Guard over a servo's process: fetches its rows, shows it a sign of life, and takes the force away when it dies."""

from __future__ import annotations

import math
import os
import select
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from queue import SimpleQueue
from subprocess import Popen
from threading import Lock, Thread
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.process import boot
from graspfx.assembly.process.orders import LETTER
from graspfx.assembly.process.quenching import Quencher, quench_all
from graspfx.loop.device_exchange import call_of
from graspfx.loop.realtime.pacing import Clock, WallClock
from graspfx.loop.realtime.process import GUARD
from graspfx.loop.realtime.readings import MOST_STILL, STILL_PERIODS, patience
from graspfx.loop.realtime.ring import SLOTS, Phase, Ring, Word
from graspfx.recording.recorder import Recorder
from graspfx.system import process_end
from graspfx.system.scheduling import set_fifo

FloatArray = NDArray[np.float64]
BACKLOG = 1 << 28  # bytes of rows that may wait for the disk; beyond it rows stay in the ring, the last ones


class Relay:
    """Fetches rows, faults and changes of a servo that runs in another process.

    Args:
        ring: of the servo.
        recorder: of the run.
        watch: told of each batch of rows by the tick of the first and the count of ticks, such as a viewer; it may look
            at the recorder's last row then.
        goals: gives goals of guided hands that were taken by key; None where there are none.

    Attributes:
        ticks: whose rows were fetched.
        lost: rows that came too late, which are NaN.
        faults: that the servo has noted.
        letters: values by the number of the letter that brings them to the servo.
    """

    def __init__(
        self,
        ring: Ring,
        recorder: Recorder,
        watch: Callable[[int, int], object] | None = None,
        goals: Callable[[FloatArray], Mapping[str, Any]] | None = None,
    ) -> None:
        self._ring, self._recorder, self._watch, self._name_goals = ring, recorder, watch, goals
        self.ticks = self.lost = 0
        self.faults: list[tuple[int, str]] = []
        self.letters: dict[int, Mapping[str, Any]] = {}
        self._goals = 0  # how many of them were told

    def fetch(self) -> None:
        """Hand the recorder what is new.

        Raises:
            RecordingError: the recorder cannot take it.
        """
        changes = [*self._changes(), *self._goal_changes()]
        for tick, values in sorted(changes, key=lambda change: change[0]):
            self._recorder.change(tick, values)
        if self._recorder.backlog > BACKLOG:
            return
        head, first = int(self._ring.words[Word.HEAD]), self.ticks
        while self.ticks < head:
            self._fetch_rows(head)
        if self._watch is not None and self.ticks > first:
            self._watch(first, self.ticks - first)

    def note_fault(self, tick: int, text: str) -> None:
        """Note a fault from a tick on."""
        self.faults.append((tick, text))
        self._recorder.fault(tick, text)

    def _fetch_rows(self, head: int) -> None:
        """Copy the rows of as many ticks as the recorder's block has room for."""
        rows, place, left = self._recorder.space()
        every, first = self._ring.every, self.ticks
        count = min(left, head - first)
        begin, end = -(-first // every), -(-(first + count) // every)  # numbers of the rows
        part = rows[-(-place // every) :][: end - begin]
        at = begin % SLOTS
        while len(part):
            piece = min(len(part), SLOTS - at, SLOTS)
            part[:piece] = self._ring.rows[at : at + piece]
            part, at = part[piece:], 0
        valid = -(-int(self._ring.words[Word.HEAD]) // every) + 1 - SLOTS  # the first that was not being written over
        late = min(max(valid - begin, 0), end - begin)
        if late:
            start = -(-place // every)
            rows[start : start + late] = np.nan
            self.lost += late
        self.ticks = first + count
        self._ring.words[Word.TAIL] = self.ticks
        self._recorder.take(count)
        self._recorder.drain()

    def _goal_changes(self) -> Iterator[tuple[int, Mapping[str, Any]]]:
        """List the goals that were taken since the last time; who comes 16384 of them late has lost some."""
        count = int(self._ring.words[Word.GOALS])
        for number in range(max(self._goals, count - SLOTS + 1), count):
            row = self._ring.goal_log[number % SLOTS]
            if self._name_goals is not None and (values := self._name_goals(row[1:])):
                yield int(row[0]), values
        self._goals = count

    def _changes(self) -> Iterator[tuple[int, Mapping[str, Any]]]:
        """List the changes of keys since the last time; faults that were noted meanwhile are recorded."""
        for kind, tick, content in self._ring.notes.news():
            if kind == "fault":
                self.note_fault(tick, content)
            else:
                yield tick, self.letters.pop(content[LETTER]) if LETTER in content else content


PAUSE = 20  # between two looks [ms]
PATIENCE = 0.5  # for a servo to rest that was asked to [s]
LONGER = 0.25  # then, until the next step [s]
OPENING = 30.0  # for a device to open, and for all to come to rest [s]
CLOSING = 3.0  # for hardware to be closed that was not armed yet [s]
STEPS = (process_end.ASK, process_end.KILL)
DEATH = "death"  # message of the guard's own: the process has ended


class Guard(Thread):
    """A thread that begins a servo's process, and ends with it.

    It waits on the process, so that it quenches the hardware within milliseconds of a death without rest. A servo that
    was asked to rest and does not, that runs and does no tick, or whose hardware does not open, is ended by signals: it
    may hang in a driver.

    Args:
        ring: shared with the process.
        devices: that are quenched when the process dies with forces on.
        period: T [s].
        clock: of its patience with a servo that does nothing.
        names: of all devices of the scene.
        watchdog: time by which a tick may be late [s].

    Attributes:
        messages: of the process, each a tuple that begins with its kind; the last one is DEATH.
        lock: of the relay and its recorder.
        relay: of the rows, from the moment on that there is one.
        failure: of the relay; then the servo is asked to rest.
        report: how the quenching went, a sentence each; empty without.
        is_settled: whether the hardware has told that it is open and at rest.
        is_overdue: whether it has not, in time, and was ended.
        hang: which call of a device did not return, in words; empty without.
    """

    def __init__(
        self, ring: Ring, devices: Sequence[Quencher], period: float, clock: Clock | None = None,
        *, names: Sequence[str] = (), watchdog: float = math.inf,
    ) -> None:  # fmt: skip
        super().__init__(name="graspfx-guard", daemon=True)
        self._ring, self._devices, self._clock = ring, devices, clock or WallClock()
        self._still = max(MOST_STILL, STILL_PERIODS * period)
        self._names, self._hung = names, patience(period, watchdog)
        self.messages: SimpleQueue[Any] = SimpleQueue()
        self.lock = Lock()
        self.relay: Relay | None = None
        self.failure: BaseException | None = None
        self.report: list[str] = []
        self.is_settled = self.is_overdue = False
        self.hang = ""
        self.process: Popen[bytes] | None = None
        self._line: Connection | None = None
        self._watched = -1  # descriptor of the process
        self._head, self._place = -1, 0  # ticks that were there, and the call that was under way
        self._since, self._step = 0.0, 0  # when these came, and what was done
        self._sent = Lock()

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self.process.pid if self.process is not None else 0

    def run(self) -> None:
        try:
            self.process, self._line = boot.start(self._ring.file)
        except BaseException as error:  # noqa: BLE001 - it is raised by whoever waits for a message
            self.messages.put(("failed", error))
            self.messages.put((DEATH, ""))
            return
        self._watched = process_end.watched(self.process)
        self.messages.put(("begun",))
        set_fifo(GUARD)
        try:
            self._watch()
        except BaseException as error:  # noqa: BLE001 - without a guard there is no run
            self.failure = error
            self.kill()
            code = self.process.wait()
            self._quench()
            self.messages.put((DEATH, process_end.ending(code)))
        finally:
            self._line.close()
            if self._watched >= 0:
                os.close(self._watched)
            os.close(self._ring.file)

    def send(self, word: Any) -> None:
        """Send the process a word; one that is no more hears nothing."""
        with self._sent, suppress(OSError):
            assert self._line is not None
            self._line.send(word)

    def rest(self) -> None:
        """Ask the servo to rest before its next tick."""
        self._ring.words[Word.STOP] = 1

    def interrupt(self, number: int) -> None:
        """Pass a signal on to the process: it breaks off a driver that hangs."""
        self.rest()
        self._signal(number)

    def kill(self) -> None:
        """End the process at once; what is open then is quenched."""
        self._signal(process_end.KILL)

    def _signal(self, number: int) -> None:
        process_end.send(number, self.process, self._watched)

    def _watch(self) -> None:
        assert self._line is not None
        assert self.process is not None
        words, poll, line = self._ring.words, select.poll(), self._line.fileno()
        poll.register(line, select.POLLIN)
        if self._watched >= 0:
            poll.register(self._watched, select.POLLIN)
        while True:
            ready = [file for file, _ in poll.poll(PAUSE)]
            words[Word.BEAT] = time.monotonic_ns()
            is_dead = self._watched in ready
            if is_dead:
                self.process.wait()  # at once: whoever asks for its number is told that it is no more
                self._quench()
            if line in ready and not self._receive():
                poll.unregister(line)
                is_dead = is_dead or self._watched < 0
                if self._watched < 0:
                    self.process.wait()
                    self._quench()
            self._fetch()
            if is_dead:
                while self._receive():
                    pass
                self.messages.put((DEATH, process_end.ending(self.process.wait())))
                return
            self._hurry()

    def _receive(self) -> bool:
        """Take a message over; return whether there was one."""
        assert self._line is not None
        try:
            if not self._line.poll():
                return False
            message = self._line.recv()
            self.is_settled = self.is_settled or message[0] == "settled"
            if not self.is_settled:
                self._since = self._clock.now()  # another device has opened
            self.messages.put(message)
        except (EOFError, OSError):
            return False
        except Exception as error:  # noqa: BLE001 - such as a class that only the process knows
            self.messages.put(("warning", f"a message of the servo's process cannot be read: {error}", UserWarning))
        return True

    def _quench(self) -> None:
        """Take the force away from hardware whose program has died with it."""
        if int(self._ring.words[Word.PHASE]) in (Phase.OPEN, Phase.RUNNING) and not self.report:
            self.report = quench_all(self._devices)

    def _fetch(self) -> None:
        """Fetch rows, unless somebody has the recorder now: signs of life must not wait for it."""
        if not self.lock.acquire(blocking=False):
            return
        try:
            if self.relay is not None and self.failure is None:
                self.relay.fetch()
        except BaseException as error:  # noqa: BLE001 - it is raised in the thread of the run, after rest
            self.failure = error
            self.rest()
        finally:
            self.lock.release()

    def _hurry(self) -> None:
        """End a servo that does not open its hardware, does not rest, or does nothing.

        First by a signal that a driver's call gives way to.
        """
        words, now = self._ring.words, self._clock.now()
        head, phase, place = int(words[Word.HEAD]), int(words[Word.PHASE]), int(words[Word.CALL])
        is_running, is_told = phase == Phase.RUNNING, bool(words[Word.STOP])
        is_opening = phase == Phase.OPEN and not (self.is_settled or is_told)
        if phase >= Phase.RESTED or not (is_running or is_told or is_opening):
            self._since, self._step = now, 0
            return
        halt = int(words[Word.HALT])
        if head != self._head or (halt and head >= halt - 1 and not is_told):  # a pause is no standstill
            self._head, self._since, self._step = head, now, 0
        if place != self._place:
            self._place = place
            if place and not is_told:  # each call has its own time: after another one hung, the others are stopped
                self._since, self._step = now, 0
        call = call_of(place, self._names) if is_running and not is_told else ""
        wait = OPENING if is_opening else CLOSING if not is_running else PATIENCE if is_told else self._still
        if is_running and not is_told and (call or self.hang):
            wait = self._hung
        if self._step >= len(STEPS) or now - self._since <= wait + self._step * LONGER:
            return
        if call and not self.hang:
            if now - self._since <= self._still and process_end.is_stopped(self.pid):
                return  # by a signal, not in its driver
            self.hang = f"{call} has not returned for {now - self._since:.2g} s; all forces are zero"
        self.is_overdue = self.is_overdue or is_opening
        self._signal(STEPS[self._step])
        self._step += 1
