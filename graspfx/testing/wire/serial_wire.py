"""An emulator of a board on a serial line, behind a pseudo-terminal."""

from __future__ import annotations

import os
import select
import threading
from abc import abstractmethod
from collections.abc import Iterable, Iterator
from contextlib import suppress
from typing import Any

from graspfx.loop.realtime.pacing import Clock
from graspfx.system import terminal
from graspfx.testing.wire.damage import Damage
from graspfx.testing.wire.plug import Plug
from graspfx.testing.wire.wire import Wire

IDLE = 0.001  # between two calls of `tick` [s]
MOST = 4096  # bytes at a time


class SerialWire(Wire):
    """A board on a serial line: a class made from it says what it answers, in `receive`.

    It runs in a thread of its own, and starts when it is made. `settings` are the port alone. On a clock that is given
    it has neither thread nor port: it works in `exchange` alone, and in no other time than that clock's.

    Args:
        seed: of the damage that failures do.
        clock: of the board; the machine's if it is left out.
    """

    def __init__(self, seed: int = 0, clock: Clock | None = None) -> None:
        super().__init__(clock)
        self._damage, self._plug = Damage(seed), Plug()
        self._lock = threading.Lock()  # of the terminal's descriptors
        self._late: list[tuple[float, bytes]] = []
        self._unread = b""
        self._master = self._slave = -1
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._serve, name=type(self).__name__, daemon=True)
        self._has_port = clock is None
        if self._has_port:
            self._insert()
            self._thread.start()

    @abstractmethod
    def receive(self, data: bytes) -> Iterable[bytes]:
        """Take bytes as they come, however they are cut, and give the answers to them, one frame each."""

    def tick(self) -> None:
        """Do what a board does by itself, such as a watchdog: called at least every millisecond."""

    def exchange(self, data: bytes = b"") -> bytes:
        """Give the board bytes, on a clock that was given, and take what has come out of it by now."""
        self._unread += data
        return b"".join(self._turn())

    @property
    def port(self) -> str:
        """Name of the serial port, the same after the cable was out."""
        return self._plug.port

    @property
    def settings(self) -> dict[str, Any]:
        return {"port": self.port}

    def _change(self) -> None:
        with self._lock:
            if self.failure == "unplugged":
                self._pull()
            elif self._master < 0 and self._has_port:
                self._insert()
            self._damage.number, self._damage.kind = self.number, self.failure

    def close(self) -> None:
        if not self._closed.is_set():
            self._closed.set()
            if self._has_port:
                self._thread.join()
            with self._lock:
                self._pull()
            self._plug.remove()

    def _insert(self) -> None:
        self._master, self._slave = terminal.pseudo_terminal()  # its own end of the slave, so that the line stays
        self._plug.lead(os.ttyname(self._slave))

    def _pull(self) -> None:
        if self._master >= 0:
            os.close(self._slave)
            os.close(self._master)
        self._master = self._slave = -1
        self._plug.pull()
        self._late.clear()

    def _serve(self) -> None:
        while not self._closed.is_set():
            self._unread += self._heard()
            with self._lock:
                for part in self._turn():
                    self._put(part)

    def _turn(self) -> Iterator[bytes]:
        """Let the board read, answer and work for itself; give what comes out of it."""
        if self._unread and self._damage.kind != "blocked":
            for answer in self.receive(self._unread):
                now = self.clock.now()
                self._late += [(now + delay, part) for delay, part in self._damage.apply(answer) if part]
            self._unread = b""
        now = self.clock.now()
        while self._late and self._late[0][0] <= now:
            yield self._late.pop(0)[1]
        self.tick()

    def _heard(self) -> bytes:
        """Wait for bytes, for `IDLE` at most."""
        wait = IDLE if not self._late else max(0.0, min(IDLE, self._late[0][0] - self.clock.now()))
        with self._lock:
            master = self._master
        if master < 0 or self._damage.kind == "blocked":
            self.clock.sleep(IDLE)
            return b""
        with suppress(OSError, ValueError):  # pulled meanwhile
            if select.select([master], [], [], wait)[0]:
                return os.read(master, MOST)
            terminal.release_terminal(self._slave)  # a dead user's claim goes with it, as a board's does
        return b""

    def _put(self, data: bytes) -> None:
        if self._master >= 0:
            with suppress(OSError):
                os.write(self._master, data)
