"""Stability of a running scene whose values change, computed in a separate process."""

from __future__ import annotations

import os
import pickle
import sys
import threading
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from multiprocessing.connection import Connection
from subprocess import Popen
from typing import Any

from graspfx.assembly.process.orders import Errand
from graspfx.environment import granted
from graspfx.errors import GraspFXError
from graspfx.live.certifier import Certifier, Verdict
from graspfx.resource import Resource
from graspfx.scene.model import Scene
from graspfx.system import child_process
from graspfx.system.process_end import KILL, die_with_parent
from graspfx.system.scheduling import be_nice

NICENESS = 10  # gives other programs priority, above all the servo
SWITCH = 2e-4  # switch interval of the process's threads [s], so that provisional results are not delayed by full ones
NO_PROCESS = "the process that computes certificates has ended"


class Margins(Resource):
    """Stability results for a scene with other values, computed in a child process so that the servo is not delayed.

    If requests arrive faster than they can be answered, only the newest request is answered: first with a provisional
    result, if the last linearisation is valid for its values, and then with a complete result. A complete result is
    discarded if a newer request exists. The first request is the unchanged scene.

    Args:
        scene: Running scene.
        tell: Function called with each result; it runs in a thread of this object and must not raise an exception.
    """

    def __init__(self, scene: Scene, tell: Callable[[Verdict], object] | None = None) -> None:
        self._scene, self._tell = scene, tell
        self._changed = threading.Condition()
        self._values: dict[str, Any] = {}
        self._number, self._sent = 1, 0
        self._latest: Verdict | None = None
        self._closed, self._failure = False, ""
        self._process: Popen[bytes] | None = None
        self._thread = threading.Thread(target=self._serve, name="graspfx margins", daemon=True)
        self._thread.start()

    def ask(self, values: Mapping[str, Any]) -> int:
        """Request the stability for values by live key, without waiting for the result; return the request's number.

        Keys that are not in `values` have the values of the scene.
        """
        with self._changed:
            self._values = dict(values)
            self._number += 1
            if self._failure:
                self._latest = self._failed()
                return self._number
            self._changed.notify_all()
            return self._number

    def latest(self) -> Verdict | None:
        """Return the newest result, or None before the first result."""
        return self._latest

    def await_verdict(self, number: int, seconds: float) -> Verdict | None:
        """Wait for the complete result of a request or of a later request; return None after a timeout or `close`.

        Args:
            number: Number of the request, returned by `ask`; 1 for the unchanged scene.
            seconds: Timeout [s].
        """
        with self._changed:
            self._changed.wait_for(lambda: self._has(number) or self._closed, seconds)
            return self._latest if self._has(number) else None

    def close(self) -> None:
        """End the process."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
            if self._process is not None:
                self._process.kill()  # the process has nothing to clean up
        self._thread.join()

    def _has(self, number: int) -> bool:
        verdict = self._latest
        if verdict is None or self._failure:
            return verdict is not None
        return verdict.number >= number and not verdict.is_provisional

    def _serve(self) -> None:
        """Start the process, send requests to it, and end it; the system also ends it if this thread ends."""
        try:
            errand = Errand(self._scene, ticks=0, width=0).text()
            process, line = child_process.spawn(__name__)
        except (GraspFXError, OSError) as error:
            self._fail(str(error))
            return
        listener = threading.Thread(target=self._listen, args=(line,), name="graspfx verdicts", daemon=True)
        listener.start()
        try:
            self._process = process
            line.send_bytes(errand)
            self._send(line)
        except OSError:
            self._fail(NO_PROCESS)
        finally:
            process.kill()
            process.wait()
            listener.join()
            line.close()

    def _send(self, line: Connection) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or self._number > self._sent)
                if self._closed:
                    return
                number, values = self._number, self._values
                self._sent = number
            try:
                text = pickle.dumps((number, values))
            except Exception as error:  # noqa: BLE001 - pickling may raise anything
                self._take(Verdict(values, False, error=f"values cannot be pickled: {error}", number=number, stage=2))
                continue
            line.send_bytes(text)

    def _listen(self, line: Connection) -> None:
        """Receive results until the process ends."""
        try:
            while True:
                self._take(line.recv())
        except (EOFError, OSError):
            if not self._closed:
                self._fail(NO_PROCESS)

    def _take(self, verdict: Verdict) -> None:
        with self._changed:
            latest = self._latest
            if latest is not None and (verdict.number, verdict.stage) <= (latest.number, latest.stage):
                return
            self._latest = verdict
            self._changed.notify_all()
        if self._tell is not None:
            self._tell(verdict)

    def _fail(self, why: str) -> None:
        """Report a result with this error, because no more results will be computed."""
        with self._changed:
            self._failure = self._failure or why
            self._latest = verdict = self._failed()
            self._changed.notify_all()
        if self._tell is not None:
            self._tell(verdict)

    def _failed(self) -> Verdict:
        return Verdict(self._values, False, error=self._failure, number=self._number, stage=2)


# In the process -----------------------------------------------------------------------------------------------------


def main(line_: int) -> None:
    """Answer requests until the parent ends.

    Args:
        line_: Descriptor of the connection.
    """
    die_with_parent(KILL)
    be_nice(NICENESS)
    sys.setswitchinterval(SWITCH)
    warnings.simplefilter("ignore")  # the run reports them already
    line = Connection(line_)
    try:
        errand: Errand = line.recv()
        with granted(errand.trust):
            _Answers(Certifier(errand.scene), line).serve()
    except (EOFError, OSError):
        pass
    finally:
        os._exit(0)  # even while a full result is computed


class _Answers:
    """Answers requests that arrive on a connection; a newer request replaces older unanswered requests."""

    def __init__(self, certifier: Certifier, line: Connection) -> None:
        self._certifier, self._line = certifier, line
        self._changed = threading.Condition()
        self._number, self._done, self._values = 0, 0, dict[str, Any]()
        self._sending = threading.Lock()

    def serve(self) -> None:
        """Read requests, and answer each with a provisional result from the last linearisation."""
        threading.Thread(target=self._certify, daemon=True).start()
        while True:
            number, values = self._line.recv()
            while self._line.poll():
                number, values = self._line.recv()
            verdict = self._certifier.provisional(values)
            if verdict is not None:
                self._send(number, verdict)
            with self._changed:
                self._number, self._values = number, values
                self._changed.notify_all()

    def _certify(self) -> None:
        """Compute complete results for the newest request."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._number > self._done)
                number, values = self._number, self._values
                self._done = number
            for verdict in self._certifier.stages(values):
                if self._number != number:
                    break  # the linearisation is kept for provisional results
                self._send(number, verdict)

    def _send(self, number: int, verdict: Verdict) -> None:
        with self._sending:
            self._line.send(replace(verdict, number=number))
