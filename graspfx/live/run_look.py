"""Base class of observers that poll a run from a thread."""

from __future__ import annotations

import threading
from abc import abstractmethod
from contextlib import suppress
from typing import TYPE_CHECKING

from graspfx.errors import GraspFXError
from graspfx.resource import Resource

if TYPE_CHECKING:
    from graspfx.live.live_run import LiveRun


class RunLook(Resource):
    """Observer with a thread that polls the attached run and ignores errors of GraspFX, as a run raises at its end.

    Args:
        name: Name of the thread.
        pause: Interval between polls [s].
    """

    def __init__(self, name: str, pause: float) -> None:
        self._pause = pause
        self._run: LiveRun | None = None
        self._lock, self._over = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._follow, name=name, daemon=True)
        self._thread.start()

    def attach(self, run: LiveRun) -> None:
        """Observe a run, instead of the run that was attached before."""
        with self._lock:
            self._begin(run)
            self._run = run

    def detach(self) -> None:
        """Observe no run."""
        with self._lock:
            self._run = None

    def close(self) -> None:
        """End the thread."""
        self._over.set()
        self._thread.join()

    @abstractmethod
    def _begin(self, run: LiveRun) -> None:
        """Prepare for polling a run; the thread does not poll during this call."""

    @abstractmethod
    def _look(self, run: LiveRun) -> None:
        """Poll a run once."""

    def _follow(self) -> None:
        while not self._over.wait(self._pause):
            with self._lock, suppress(GraspFXError):  # a run that ends during the poll
                if self._run is not None:
                    self._look(self._run)
