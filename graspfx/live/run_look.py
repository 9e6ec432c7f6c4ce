"""Looks at a run, from a thread beside it: at one run after another, as each is attached."""

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
    """A watcher of runs with a thread that looks at the one that is attached; an error of one that ends is passed over.

    Args:
        name: of the thread.
        pause: from one look to the next [s].
    """

    def __init__(self, name: str, pause: float) -> None:
        self._pause = pause
        self._run: LiveRun | None = None
        self._lock, self._over = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._follow, name=name, daemon=True)
        self._thread.start()

    def attach(self, run: LiveRun) -> None:
        """Look at a run from now on."""
        with self._lock:
            self._begin(run)
            self._run = run

    def detach(self) -> None:
        """Look at no run."""
        with self._lock:
            self._run = None

    def close(self) -> None:
        """End the thread."""
        self._over.set()
        self._thread.join()

    @abstractmethod
    def _begin(self, run: LiveRun) -> None:
        """Prepare to look at a run; no look is taken meanwhile."""

    @abstractmethod
    def _look(self, run: LiveRun) -> None:
        """Look at a run once."""

    def _follow(self) -> None:
        while not self._over.wait(self._pause):
            with self._lock, suppress(GraspFXError):  # a run that ends while it is looked at
                if self._run is not None:
                    self._look(self._run)
