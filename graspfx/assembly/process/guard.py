"""Guard of a servo's process, which fetches rows, sends heartbeats, and removes forces if the process dies."""

from __future__ import annotations

import math
import os
import select
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from queue import SimpleQueue
from subprocess import Popen
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.assembly.process.orders import LETTER
from graspfx.assembly.process.quenching import Quencher, quench_all
from graspfx.loop.device_exchange import call_of
from graspfx.loop.realtime.pacing import Clock, WallClock
from graspfx.loop.realtime.process import GUARD
from graspfx.loop.realtime.readings import MOST_STILL, STILL_PERIODS, patience
from graspfx.loop.realtime.ring import SLOTS, Phase, Ring, Word
from graspfx.recording.recorder import Recorder
from graspfx.system import child_process, process_end
from graspfx.system.scheduling import set_fifo

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

FloatArray = NDArray[np.float64]
BACKLOG = 1 << 28  # bytes of rows that may wait for the disk; beyond this, the last rows stay in the ring buffer


class Relay:
    """Transfer of rows, faults and changes from the ring buffer of a servo in another process to a recorder.

    Args:
        ring: Ring buffer of the servo.
        recorder: Recorder of the run.
        watch: Function that is called after each batch of rows with the first tick and the number of ticks of the
            batch, and may read the recorder's last row; None without one.
        goals: Function that returns, by key, the changed values among the accepted goals; None without guided hands.

    Attributes:
        ticks: Number of ticks whose rows were fetched.
        lost: Number of rows that were overwritten before they were fetched; these rows are NaN.
        faults: Tick and text of each fault that the servo has reported.
        letters: Values, by key, that each letter to the servo contains, by number of the letter.
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
        self._goals = 0  # number of goals that were recorded

    def fetch(self) -> None:
        """Pass new rows, faults and changes to the recorder.

        Raises:
            RecordingError: If the recorder cannot store the data.
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
        """Record a fault that begins at a tick."""
        self.faults.append((tick, text))
        self._recorder.fault(tick, text)

    def _fetch_rows(self, head: int) -> None:
        """Copy the rows before tick `head` to the recorder, at most as many as fit into the recorder's block."""
        rows, place, left = self._recorder.space()
        every, first = self._ring.every, self.ticks
        count = min(left, head - first)
        begin, end = -(-first // every), -(-(first + count) // every)  # indices of the rows
        part = rows[-(-place // every) :][: end - begin]
        at = begin % SLOTS
        while len(part):
            piece = min(len(part), SLOTS - at, SLOTS)
            part[:piece] = self._ring.rows[at : at + piece]
            part, at = part[piece:], 0
        valid = -(-int(self._ring.words[Word.HEAD]) // every) + 1 - SLOTS  # first row not being overwritten
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
        """Yield tick and values of each acceptance of goals since the last call, at most of the last 16383."""
        count = int(self._ring.words[Word.GOALS])
        for number in range(max(self._goals, count - SLOTS + 1), count):
            row = self._ring.goal_log[number % SLOTS]
            if self._name_goals is not None and (values := self._name_goals(row[1:])):
                yield int(row[0]), values
        self._goals = count

    def _changes(self) -> Iterator[tuple[int, Mapping[str, Any]]]:
        """Yield tick and values of each key change since the last call, and record the faults since then."""
        for kind, tick, content in self._ring.notes.news():
            if kind == "fault":
                self.note_fault(tick, content)
            else:
                yield tick, self.letters.pop(content[LETTER]) if LETTER in content else content


PAUSE = 20  # interval of the guard's checks [ms]
PATIENCE = 0.5  # time for a servo to rest after the request [s]
LONGER = 0.25  # time until the next, stronger step [s]
OPENING = 30.0  # time for a device to open, and for all devices to come to rest [s]
CLOSING = 3.0  # time to close hardware that was not armed [s]
STEPS = (process_end.ASK, process_end.KILL)
SERVO = "graspfx.assembly.process.servo_child"
DEATH = "death"  # message of the guard: the process has ended


class Guard(Thread):
    """Thread that starts a servo's process, and ends after the end of this process.

    If the process dies while forces may act, the thread removes the forces within milliseconds. A servo that does not
    open its hardware in time, runs no ticks, or does not set its forces to zero on request is terminated by signals,
    because a driver's call may not have returned.

    Args:
        ring: Ring buffer shared with the process.
        devices: Devices whose force is removed if the process dies while forces may act.
        period: Sampling period [s].
        clock: Clock for the timeouts of an inactive servo; the wall clock if None.
        names: Names of all devices of the scene.
        watchdog: Largest permitted lateness of a tick [s].

    Attributes:
        messages: Messages from the process, tuples that begin with their kind; the kind of the last message is DEATH.
        lock: Lock for the use of the relay and its recorder.
        relay: Relay of the rows; None before the run.
        failure: Error of the relay, after which the servo sets its forces to zero, or error of the guard, after which
            the process is killed; None without an error.
        report: Sentences about the removal of forces; empty if no force was removed.
        is_settled: Whether the process has reported that its hardware is open and stationary.
        is_overdue: Whether the process was terminated because it did not report this in time.
        hang: Description of a device call that did not return; empty if there is none.
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
        self._head, self._place = -1, 0  # number of ticks, and the running call, at the last check
        self._since, self._step = 0.0, 0  # time of the last change of either, and number of steps taken
        self._sent = Lock()
        self._is_killed = False

    @property
    def pid(self) -> int:
        """Process identifier (PID); 0 before the process has started."""
        return self.process.pid if self.process is not None else 0

    def run(self) -> None:
        try:
            self.process, self._line = child_process.spawn(SERVO, self._ring.file)
        except BaseException as error:  # noqa: BLE001 - it is raised where a message is awaited
            self.messages.put(("failed", error))
            self.messages.put((DEATH, ""))
            return
        self._watched = process_end.watched(self.process)
        if self._is_killed:  # by an interruption before there was a process
            self.kill()
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
        """Send a message to the process; do nothing if the process has ended."""
        with self._sent, suppress(OSError):
            assert self._line is not None
            self._line.send(word)

    def rest(self) -> None:
        """Ask the servo to set its forces to zero before its next tick, and to end the run."""
        self._ring.words[Word.STOP] = 1

    def interrupt(self, number: int) -> None:
        """Ask the servo to rest, and send a signal to its process, which interrupts a driver's call."""
        self.rest()
        self._signal(number)

    def kill(self) -> None:
        """Kill the process at once, or as soon as it has started; the guard then removes the force of open hardware."""
        self._is_killed = True
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
                self.process.wait()  # returns at once; afterwards queries for the process number report its end
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
        """Receive one message if there is one; return whether a message was received."""
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
        except Exception as error:  # noqa: BLE001 - for example a class that only the process has
            self.messages.put(("warning", f"a message from the servo's process is unreadable: {error}", UserWarning))
        return True

    def _quench(self) -> None:
        """Remove the forces of the hardware if the process died while it was open."""
        if int(self._ring.words[Word.PHASE]) in (Phase.OPEN, Phase.RUNNING) and not self.report:
            self.report = quench_all(self._devices)

    def _fetch(self) -> None:
        """Fetch rows unless the recorder is locked, because waiting would delay the next heartbeat."""
        if not self.lock.acquire(blocking=False):
            return
        try:
            if self.relay is not None and self.failure is None:
                self.relay.fetch()
        except BaseException as error:  # noqa: BLE001 - it is raised in the run's thread, after rest
            self.failure = error
            self.rest()
        finally:
            self.lock.release()

    def _hurry(self) -> None:
        """Terminate a servo that exceeds the time for opening its hardware, for a tick, or for the end of its forces.

        The first step is a signal that interrupts a driver's call, and the second kills the process.
        """
        words, now = self._ring.words, self._clock.now()
        head, phase, place = int(words[Word.HEAD]), int(words[Word.PHASE]), int(words[Word.CALL])
        is_running, is_told = phase == Phase.RUNNING, bool(words[Word.STOP])
        is_opening = phase == Phase.OPEN and not (self.is_settled or is_told)
        if phase >= Phase.RESTED or not (is_running or is_told or is_opening):
            self._since, self._step = now, 0
            return
        halt = int(words[Word.HALT])
        if head != self._head or (halt and head >= halt - 1 and not is_told):  # a paused servo is not inactive
            self._head, self._since, self._step = head, now, 0
        if place != self._place:
            self._place = place
            if place and not is_told:  # each call has its own timeout: after one hung, the other devices are stopped
                self._since, self._step = now, 0
        call = call_of(place, self._names) if is_running and not is_told else ""
        wait = OPENING if is_opening else CLOSING if not is_running else PATIENCE if is_told else self._still
        if is_running and not is_told and (call or self.hang):
            wait = self._hung
        if self._step >= len(STEPS) or now - self._since <= wait + self._step * LONGER:
            return
        if call and not self.hang:
            if now - self._since <= self._still and process_end.is_stopped(self.pid):
                return  # a signal ended the servo outside its driver
            self.hang = f"{call} has not returned for {now - self._since:.2g} s; all forces are zero"
        self.is_overdue = self.is_overdue or is_opening
        self._signal(STEPS[self._step])
        self._step += 1
