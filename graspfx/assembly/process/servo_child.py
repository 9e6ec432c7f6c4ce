"""The servo's process, which builds a servo, opens its hardware, runs it, sets forces to zero and closes the hardware.

The process reports its progress to the recording process, and waits for a message before it opens the hardware, before
it runs, and, after the files are closed, before it closes the hardware. A run also ends if the recording process dies.
"""

from __future__ import annotations

import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

from graspfx import log, progress
from graspfx.assembly.build import build
from graspfx.assembly.hardware import Hardware, at_hardware
from graspfx.assembly.process.orders import Errand, Orders, ParentGone, PausingPacer
from graspfx.assembly.provenance import header_of
from graspfx.assembly.resolve import resolve
from graspfx.environment import granted
from graspfx.errors import GraspFXError
from graspfx.loop.realtime.pacing import WallClock
from graspfx.loop.realtime.process import NAMES, Exits, signals_end, take_priority
from graspfx.loop.realtime.ring import Phase, Ring, RingRecorder, Word, pack_error
from graspfx.loop.servo import Servo
from graspfx.system.process_end import ASK, KILL, die_with_parent

if TYPE_CHECKING:
    from graspfx.assembly.resolve import Parts
    from graspfx.recording.header import Header


def main(line_: int, ring_: int) -> None:
    """Receive a task from the recording process, and perform it.

    Args:
        line_: File descriptor of the connection to the recording process.
        ring_: File descriptor of the shared memory with the ring buffer.
    """
    die_with_parent(KILL)  # no hardware is open yet
    for name in NAMES:
        signal.signal(getattr(signal, name), _wait_for_orders)
    line = Connection(line_)
    try:
        errand: Errand = line.recv()
        with _tell_aside(line, errand):
            _serve(errand, line, ring_)
    except (EOFError, BrokenPipeError, ConnectionResetError):
        sys.exit(1)  # the parent process has ended
    except BaseException as error:  # noqa: BLE001 - it is raised in the other process
        line.send(("failed", pack_error(error)))


def _serve(errand: Errand, line: Connection, ring_: int) -> None:
    """Build the servo, open its hardware, run it, set its forces to zero, and close the hardware."""
    with (
        granted(errand.trust),
        build(errand.scene, selected=errand.selected, live=errand.live, real_time=True) as servo,
    ):
        parts = resolve(errand.scene)
        if servo.layout.width != errand.width:
            raise GraspFXError(f"the servo's rows have {servo.layout.width} numbers, expected {errand.width}")
        ring = Ring(ring_, servo.layout.width, servo.every, errand.goals)
        header, scheduling = header_of(parts, servo.objects), dict[str, Any]()

        def ready(exits: Exits) -> None:
            line.send(("ready", servo.engine.name))
            _require(line.recv(), "open")
            die_with_parent(ASK)
            ring.rows.fill(0.0)  # makes the system allocate every page before the first row
            scheduling.update(take_priority())
            ring.words[Word.PHASE] = Phase.OPEN

        with _at_devices(servo, parts, ready) as hardware:
            loop = "process" if servo.native is None else servo.native.name
            header = replace(hardware.header(header), scheduling={"loop": loop, **scheduling})
            line.send(("settled", header))
            _require(line.recv(), "run")
            _run(errand, line, ring, servo, hardware)
            if not hardware.has_unstopped:
                _await_close(line)
        if not hardware.has_unstopped:  # otherwise the process ends as during a run, and the guard removes the force
            ring.words[Word.PHASE] = Phase.CLOSED
    line.send(("closed",))


@contextmanager
def _at_devices(servo: Servo, parts: Parts, ready: Callable[[Exits], None]) -> Iterator[Hardware | Simulations]:
    """Open the hardware of a scene; for a scene without hardware, yield `Simulations`."""
    if servo.hardware:
        with at_hardware(servo, parts, WallClock(), ready=ready) as hardware:
            yield hardware
        return
    with signals_end() as exits:
        ready(exits)
        yield Simulations(servo, exits)


class Simulations:
    """Real-time run with simulated devices only, in place of `Hardware`.

    Args:
        servo: Servo that is ready to run.
        exits: Signals that end the run.

    Attributes:
        pacer: Pacer of the ticks.
    """

    has_unstopped = False  # no hardware, so no force can persist

    def __init__(self, servo: Servo, exits: Exits) -> None:
        self._servo, self._exits, self.pacer = servo, exits, PausingPacer(servo.period)

    def header(self, header: Header) -> Header:
        """Return the header without changes."""
        return header

    def run(self, ticks: int, recorder: RingRecorder, stop: Callable[[], bool]) -> None:
        """Run the ticks until `stop` returns True or a signal arrives."""
        self._servo.run(ticks, recorder, lambda: bool(self._exits.numbers) or stop(), self.pacer)

    @property
    def outcome(self) -> dict[str, Any]:
        """Items of the run's `Outcome`: cause of an early end, and lateness of ticks."""
        return {"cause": self._exits.cause, **self.pacer.outcome}


def _run(errand: Errand, line: Connection, ring: Ring, servo: Servo, hardware: Hardware | Simulations) -> None:
    """Run until the last tick, an order to stop or an error; report the outcome when all forces are zero."""
    recorder, error = RingRecorder(ring), b""
    orders = Orders(ring, servo, recorder, hardware.pacer)
    if isinstance(hardware.pacer, PausingPacer):
        hardware.pacer.orders = orders
    servo.show_calls(memoryview(ring.memory).cast("q")[Word.CALL : Word.CALL + 1])
    ring.words[Word.PHASE] = Phase.RUNNING
    try:
        hardware.run(errand.ticks, recorder, orders)
    except BaseException as raised:  # noqa: BLE001 - as in `main`
        error = pack_error(raised)
    if not hardware.has_unstopped:
        ring.words[Word.PHASE] = Phase.RESTED
    outcome = {"engine": servo.engine.name, **servo.coupling, **hardware.outcome}
    if orders.cause:
        outcome["cause"] = orders.cause
    line.send(("rested", servo.ticks, outcome, error))


def _await_close(line: Connection) -> None:
    """Wait until the recording process has closed its files, or has ended."""
    try:
        line.recv()
    except (EOFError, OSError):
        return


def _require(word: Any, expected: str) -> None:
    if word != expected:
        raise ParentGone(f"message of the recording process: given {word!r}, expected {expected!r}")


def _wait_for_orders(number: int, frame: object) -> None:
    """Ignore a signal, which the recording process handles before hardware is open."""


@contextmanager
def _tell_aside(line: Connection, errand: Errand) -> Iterator[None]:
    """Send warnings, log messages and waits during the block to the recording process."""

    def show(message: Warning | str, category: type[Warning], *rest: Any, **more: Any) -> None:
        line.send(("warning", str(message), category))

    class Waits:
        def begin(self, wait: progress.Wait) -> None:
            line.send(("begin", wait.text))

        def end(self, wait: progress.Wait) -> None:
            line.send(("end",))

        def clear(self) -> None:
            """Do nothing: this process does not display waits."""

    if errand.verbosity is not None:
        _listen(line, errand.verbosity)
    with warnings.catch_warnings(), progress.listening(Waits()):
        warnings.simplefilter("always")
        warnings.showwarning = show
        yield


def _listen(line: Connection, level: int) -> None:
    """Send log messages of `level` and higher levels to the recording process."""
    import logging

    class Line(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            line.send(("message", record.levelno, record.getMessage()))

    logger = logging.getLogger(log.NAME)
    logger.setLevel(level)
    logger.addHandler(Line())
