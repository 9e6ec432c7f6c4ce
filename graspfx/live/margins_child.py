"""The process of `Margins`: provisional verdicts by the thread that reads requests, full ones by a second thread."""

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

NICENESS = 10  # other programs, and above all the servo, come first
SWITCH = 2e-4  # after which the two threads change [s]: a provisional verdict waits for no full one


def main(line_: int) -> None:
    """Answer requests until whoever sends them is no more.

    Args:
        line_: descriptor of the line.
    """
    die_with_parent(KILL)
    be_nice(NICENESS)
    sys.setswitchinterval(SWITCH)
    warnings.simplefilter("ignore")  # they are the run's, which has them once
    line = Connection(line_)
    try:
        errand: Errand = line.recv()
        with granted(errand.trust):
            _Answers(Certifier(errand.scene), line).serve()
    except (EOFError, OSError):
        pass
    finally:
        os._exit(0)  # also while a full verdict is computed


class _Answers:
    """Answers to requests on a line, of which the newest counts."""

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
        """Compute full verdicts."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._number > self._done)
                number, values = self._number, self._values
                self._done = number
            for verdict in self._certifier.stages(values):
                if self._number != number:
                    break  # its linearisation stays, for provisional verdicts
                self._send(number, verdict)

    def _send(self, number: int, verdict: Verdict) -> None:
        with self._sending:
            self._line.send(replace(verdict, number=number))
