"""Control of a servo's process by the recording process: start, preparation, run, updates, end of forces, close."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from queue import Empty
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx import log
from graspfx.assembly.device_limits import guards_of
from graspfx.assembly.process.guard import DEATH, OPENING, Guard, Relay
from graspfx.assembly.process.orders import Errand, Hold, is_carried, memories
from graspfx.assembly.process.quenching import quenchers
from graspfx.errors import DeviceError, InputError
from graspfx.loop.device_exchange import device_name
from graspfx.loop.realtime.process import REMEDY, Exits, Interruption, RealTimeWarning, signals_end
from graspfx.loop.realtime.ring import Letter, Phase, Ring, Word, create, fence, unpack_error, write_letter
from graspfx.loop.servo import CarriedPlant, Servo, Update
from graspfx.loop.servo_parts import DeviceWiring
from graspfx.progress import waiting

if TYPE_CHECKING:
    from graspfx.assembly.resolve import Parts
    from graspfx.loop.columns import Layout
    from graspfx.recording.header import Header
    from graspfx.recording.recorder import Recorder


FloatArray = NDArray[np.float64]
Index = NDArray[np.intp]
TAKEN = 5e-4  # interval of checks whether a letter was accepted [s]


def letter_of(servo: Servo, update: Update) -> Letter:
    """Convert an update of this process's copy of a servo to a letter for the servo in another process.

    Raises:
        InputError: If the update replaces parts that a letter cannot change, such as a hand by another kind of hand.
    """
    own = memories(servo)
    places = {id(memory): i for i, memory in enumerate(own)}
    objects = {id(part.grasped): i for i, part in enumerate(servo.objects)}
    holders = {id(part) for j in update.plants for part in (servo.plants[j].hand, servo.plants[j].plant)}
    if not all(id(part) in objects or id(part) in holders for part, _ in update.parts):
        raise _refusal(update.values)
    entries = [
        (places[id(memory)], where, numbers) for memory, where, numbers in update.entries if id(memory) in places
    ]
    if servo.ticks == 0:  # a copy that has not run has equal numbers; comparing a mesh would be slow
        entries = [_news(own[i], i, where, numbers) for i, where, numbers in entries]
    anew = {id(part): new for part, new in update.parts}
    for j, wiring in ((j, servo.plants[j]) for j in update.plants):
        hand: Any = anew.get(id(wiring.hand), wiring.hand)
        plant = anew.get(id(wiring.plant), wiring.plant)
        if not is_carried(hand) or (id(wiring.plant) in anew and not isinstance(plant, CarriedPlant)):
            raise _refusal(update.values)
        hold = Hold(hand, plant)
        entries += [(len(own) + 3 * j + i, where, numbers) for i, where, numbers in hold.numbers()]
    return Letter(entries, [objects[id(part)] for part, _ in update.parts if id(part) in objects], update.plants)


def _news(memory: FloatArray, number: int, where: Index, numbers: FloatArray) -> tuple[int, Index, FloatArray]:
    """Return an entry of a letter without the numbers that are bit-identical to those in `memory`."""
    differ = memory[where].view(np.int64) != np.asarray(numbers, dtype=float).view(np.int64)
    return number, where[differ], numbers[differ]


def _refusal(values: Mapping[str, Any]) -> InputError:
    return InputError(
        ", ".join(values), list(values.values()), "gains, friction and numbers of objects that collide with no plane",
        "other parts cannot change in real time, because they run in another process; start a run with these values",
    )  # fmt: skip


class Mail:
    """Sender of letters to a servo; a letter is sent after the servo has accepted the previous letter.

    Args:
        ring: Ring buffer shared with the servo.
        relay: Relay that records the first tick of each change.
    """

    def __init__(self, ring: Ring, relay: Relay) -> None:
        self._ring, self._relay = ring, relay
        self._number = int(ring.words[Word.MAIL])

    def post(self, letter: Letter, values: Mapping[str, Any], require: Callable[[], object]) -> int:
        """Send a letter, wait until the servo has accepted it, and return the first tick with its values.

        Args:
            letter: Letter to the servo.
            values: Values by key, which are recorded as changes at this tick.
            require: Function that is called repeatedly, and raises an error if the servo no longer accepts letters.
        """
        ring, number = self._ring, self._number + 1
        require()
        write_letter(letter, ring.letters[number % 2])
        self._relay.letters[number] = values
        fence()
        ring.words[Word.MAIL] = self._number = number
        while int(ring.words[Word.DONE]) != number:
            require()
            time.sleep(TAKEN)
        return int(ring.words[Word.TICK])


LOOK = 0.01  # interval of checks whether to stop [s]
FAREWELL = 3.0  # time for a process to close its hardware and end [s]


class ServoProcess:
    """A servo in a separate process, whose hardware is open and stationary; `servo_process` creates it.

    Args:
        guard: Guard of the process.
        ring: Ring buffer shared with the process.
        layout: Layout of the rows.
        exits: Signals that end the run.

    Attributes:
        engine: Name of the engine that runs the ticks.
        cause: Description of the end of the process if it died before its forces were zero; otherwise empty.
        error: Error that ended the run in the process; None without an error.
    """

    def __init__(self, guard: Guard, ring: Ring, layout: Layout, exits: Exits) -> None:
        self.guard, self.ring, self.layout, self.exits = guard, ring, layout, exits
        self._header: Header | None = None
        self.engine, self.cause = "", ""
        self._has_rested = self._has_ended = False
        self._ticks: int | None = None
        self._result: dict[str, Any] = {}
        self.error: BaseException | None = None
        self._waits, self._doing = ExitStack(), ""  # shown waits, and the text of the last one
        self.relay: Relay | None = None

    @property
    def header(self) -> Header:
        """Header of the recording, which the process has sent."""
        assert self._header is not None
        return self._header

    @property
    def ticks(self) -> int:
        """Number of ticks that the servo has run."""
        return int(self.ring.words[Word.HEAD]) if self._ticks is None else self._ticks

    @property
    def has_rested(self) -> bool:
        """Whether the run has ended with all forces zero, or the process has ended."""
        return self._has_rested

    def begin(
        self,
        recorder: Recorder,
        watch: Callable[[int, int], object] | None = None,
        goals: Callable[[FloatArray], Mapping[str, Any]] | None = None,
    ) -> Relay:
        """Start the run, and let the guard pass its rows to a recorder; `watch` and `goals` are those of `Relay`."""
        relay = self.relay = Relay(self.ring, recorder, watch, goals)
        with self.guard.lock:
            self.guard.relay = relay
        self.guard.send("run")
        return relay

    def run(self, ticks: int, recorder: Recorder, stop: Callable[[], bool] | None) -> None:
        """Run the ticks until the last one or until `stop` returns True; at the end, set all forces to zero."""
        self.begin(recorder)
        try:
            while not self.await_rest(LOOK):
                if stop is not None and stop():
                    self.guard.rest()
        finally:
            self.rest()
        if self.error is not None:
            raise self.error
        if self.guard.failure is not None:
            raise self.guard.failure

    def rest(self) -> None:
        """Set all forces to zero; return when they are zero and all rows are fetched."""
        self.guard.rest()
        while not self.await_rest(1.0):
            pass
        with self.guard.lock:
            relay = self.guard.relay
            if relay is not None and self.guard.failure is None:
                try:
                    while relay.ticks < int(self.ring.words[Word.HEAD]):
                        relay.fetch()
                        time.sleep(0.001)
                    relay.fetch()
                except BaseException as error:  # noqa: BLE001 - it is raised by `run`
                    self.guard.failure = error
            self.guard.relay = None
        texts = [self.guard.hang] if self.guard.hang else []
        if self.guard.report:
            texts += [f"the servo's process {self.cause}", *self.guard.report]
        if relay is not None and texts:
            relay.note_fault(self.ticks, "; ".join(texts))

    @property
    def outcome(self) -> dict[str, Any]:
        """Items of the run's `Outcome`: engine, cause of an early end, and numbers of skipped ticks and lost rows."""
        cause = self.exits.cause or (f"the servo's process {self.cause}" if self.cause else self.guard.hang)
        lost = {} if self.relay is None else {"lost": self.relay.lost}
        result = {"skipped": int(self.ring.words[Word.SKIPPED]), **self._result, **lost}
        return {"engine": self.engine, **result, "cause": cause or self._result.get("cause", "")}

    # Messages of the process --------------------------------------------------------------------------------------

    def await_rest(self, seconds: float) -> bool:
        """Wait at most `seconds` until `has_rested`; return whether it is true."""
        end = left = time.monotonic() + seconds
        while not self._has_rested and left > 0.0:
            self._take(max(end - time.monotonic(), 0.0))
            left = end - time.monotonic()
        return self._has_rested

    def _take(self, seconds: float) -> Any:
        """Wait at most `seconds` for a message, and handle it; return messages of other kinds, and None otherwise."""
        try:
            kind, *rest = self.guard.messages.get(timeout=seconds)
        except Empty:
            return None
        match kind:
            case "warning":
                log.warn(str(rest[0]), rest[1])
            case "message":
                if log.is_heard(rest[0]):
                    logging.getLogger(log.NAME).log(rest[0], "%s", rest[1])
            case "begin":
                self._doing = rest[0]
                self._waits.enter_context(waiting(self._doing))
            case "end":
                self._waits.pop_all().close()
            case "rested":
                self._has_rested = True
                self._ticks, self._result = rest[0], rest[1]
                self.error = unpack_error(rest[2]) if rest[2] else None
            case _ if kind == DEATH:
                self.cause = "" if self._has_rested else rest[0]
                self._has_rested = self._has_ended = True
            case "failed":
                error = rest[0] if isinstance(rest[0], BaseException) else unpack_error(rest[0])
                return kind, error
            case _:
                return (kind, *rest)
        return None

    def expect(self, word: str) -> tuple[Any, ...]:
        """Wait for a message of kind `word`, and return its content; an error that the process reports is raised.

        Raises:
            DeviceError: If the process died, or a device did not open in time.
            Interruption: If the process failed after a signal had arrived.
        """
        while True:
            message = self._take(0.05)
            if self._has_ended and self.guard.is_overdue:
                report = "".join(f"; {text}" for text in self.guard.report)
                do = "check that the device is switched on and plugged in, and that no other program uses it"
                raise DeviceError(f"{self._doing} took more than {OPENING:g} s and was ended{report}; {do}")
            if message is not None and message[0] == "failed" and not self.guard.is_overdue:
                if self.exits.numbers:
                    raise Interruption(self.exits.cause)
                raise message[1] from None
            if message is not None and message[0] == word:
                return tuple(message[1:])
            if self._has_ended:
                report = "".join(f"; {text}" for text in self.guard.report)
                raise DeviceError(f"the servo's process {self.cause} before the run began{report}")

    def settle(self) -> None:
        """Wait until the hardware is open and stationary."""
        (self._header,) = self.expect("settled")
        log.info("the servo runs in process %d: %s", self.guard.pid, dict(self.header.scheduling))
        if not str(self.header.scheduling.get("policy", "")).startswith("fifo"):
            log.warn(REMEDY, RealTimeWarning)

    def close(self) -> None:
        """Let the process close its hardware and end; kill a process that takes longer than 3 s."""
        self.guard.send("close")
        end = time.monotonic() + FAREWELL
        while not self._has_ended and time.monotonic() < end:
            self._take(0.05)
        if not self._has_ended:
            self.guard.kill()
        while not self._has_ended:
            self._take(0.05)
        self.guard.join()
        self._waits.close()
        if self.guard.report and not self.cause:  # devices that could not be stopped
            log.info("%s", "; ".join(self.guard.report))


@contextmanager
def servo_process(
    parts: Parts, layout: Layout, every: int, *, ticks: int, selected: bool, live: Sequence[str] = (), goals: int = 0
) -> Iterator[ServoProcess]:
    """Start a process with a scene's servo, and open its hardware; on exit, close the hardware and end the process.

    Args:
        parts: Parts of the scene.
        layout: Layout of the rows.
        every: Number of ticks from one row to the next.
        ticks: Number of ticks to run.
        selected: Whether the servo writes only the columns and ticks that the scene's `record` selects.
        live: Keys whose values may change during the run.
        goals: Number of entries of all guided hands' goals.

    Raises:
        InputError: If the scene cannot be serialised, a device has neither a watchdog nor `quench`, or a finger is
            inside its object. Other errors of the process before its run are raised, too.
        DeviceError: If a device does not open or is not stationary, or the process died.
        KeyboardInterrupt: If a signal arrived before the run.
    """
    errand = Errand(parts.scene, ticks, layout.width, selected, tuple(live), goals)
    errand.text()
    ring = Ring(create(layout.width, goals), layout.width, every, goals)
    ring.words[Word.BEAT] = time.monotonic_ns()
    names = [device_name(DeviceWiring(w.device, w.fingers), parts.scene.finger_names) for w in parts.wires]
    period = parts.scene.period
    watchdog = period * guards_of(parts.scene, parts.wires).late
    guard = Guard(ring, quenchers(parts), period, names=names, watchdog=watchdog)
    remote = ServoProcess(guard, ring, layout, Exits())
    try:
        guard.start()
        remote.expect("begun")
        guard.send(errand)
        (remote.engine,) = remote.expect("ready")
        with signals_end() as exits:
            remote.exits = exits
            exits.heed = guard.interrupt
            try:
                guard.send("open")
                remote.settle()
                yield remote
            finally:
                if int(ring.words[Word.PHASE]) == Phase.RUNNING:
                    remote.rest()
                remote.close()
    finally:
        if guard.is_alive() or not guard.pid:  # also where an interruption came while the thread was being started
            guard.kill()
        if guard.is_alive():
            guard.join()
