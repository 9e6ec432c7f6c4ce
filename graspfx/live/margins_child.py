"""Child process of `Margins`: one thread reads requests and answers provisionally, another computes full results."""

from __future__ import annotations

import os
import sys
import threading
import warnings
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Any

from graspfx.assembly.process.orders import Errand
from graspfx.environment import granted
from graspfx.live.certifier import Certifier
from graspfx.live.stability_verdict import Verdict
from graspfx.system.process_end import KILL, die_with_parent
from graspfx.system.scheduling import be_nice

NICENESS = 10  # gives other programs priority, above all the servo
SWITCH = 2e-4  # switch interval of the threads [s], so that provisional results are not delayed by full ones


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
    """Answers requests from a connection; a newer request replaces older requests."""

    def __init__(self, certifier: Certifier, line: Connection) -> None:
        self._certifier, self._line = certifier, line
        self._changed = threading.Condition()
        self._number, self._done, self._values = 0, 0, dict[str, Any]()
        self._sending = threading.Lock()

    def serve(self) -> None:
        """Read requests and answer each from the last linearisation."""
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
        """Compute full results."""
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
