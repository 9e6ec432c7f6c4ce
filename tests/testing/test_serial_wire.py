"""Emulated boards on a serial line: what a driver flushes, and answers that find the line full."""

from __future__ import annotations

import os
import select
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from graspfx.devices.rig.controller import Kind, short_frame
from graspfx.devices.rig.emulator import PATIENCE, RigWire
from graspfx.testing.wire import SerialWire, Wire, compiler
from tests.support.waiting import wait_until

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="terminals of POSIX")


class Echo(SerialWire):
    """A board that answers what it is told, `times` over."""

    times = 1

    def receive(self, data: bytes) -> Iterable[bytes]:
        return [data * self.times]

    def home(self) -> None: ...

    def move(self, *places: Any) -> None: ...

    @property
    def torque(self) -> Any:
        return np.zeros(1)


def ends(act: Callable[[], object]) -> bool:
    """Tell whether a call returns within some seconds."""
    thread = threading.Thread(target=act, daemon=True)
    thread.start()
    thread.join(20.0)
    return not thread.is_alive()


def closes(wire: Wire) -> bool:
    return ends(wire.close)


@contextmanager
def opened(wire: Wire) -> Iterator[int]:
    """Open the line of a wire, as a driver that does not wait."""
    line = os.open(wire.settings["port"], os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        yield line
    finally:
        os.close(line)


def test_bytes_that_were_announced_and_flushed_block_no_board(monkeypatch: pytest.MonkeyPatch) -> None:
    """The line was readable, and is empty when it is read: the board goes on, and can be closed."""
    own = select.select

    def announced(readers: Any, writers: Any, others: Any, wait: float) -> Any:
        own(readers, writers, others, 1e-3)
        return readers, writers, others

    monkeypatch.setattr(select, "select", announced)
    assert closes(Echo())


def test_an_answer_that_fills_the_line_comes_whole() -> None:
    """Its end waits for room; a board that nobody reads can be closed all the same."""
    wire = Echo()
    wire.times = 100_000
    with opened(wire) as line:
        os.write(line, b"abc")
        found = b""
        while len(found) < 300_000 and own_is_ready(line):
            found += os.read(line, 1 << 16)
        assert found == b"abc" * 100_000
        os.write(line, b"abc")
        assert own_is_ready(line)
        assert closes(wire)


def own_is_ready(line: int) -> bool:
    return bool(select.select([line], [], [], 20.0)[0])


def test_a_board_whose_line_is_full_can_be_unplugged() -> None:
    wire = Echo()
    wire.times = 100_000
    with opened(wire) as line:
        os.write(line, b"abc")
        assert own_is_ready(line)
        assert ends(lambda: wire.fail("unplugged")) and closes(wire)


def test_a_board_reads_no_file_that_has_got_the_number_of_its_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bytes have come when the cable is unplugged; another file has that number when the board reads them."""
    wire, has_bytes, goes_on = Echo(), threading.Event(), threading.Event()
    whole, number = select.select, wire._master

    def slow(*arguments: Any) -> Any:
        ready = whole(*arguments)
        if ready[0] and threading.current_thread() is wire._thread:
            has_bytes.set()
            goes_on.wait(20.0)
        return ready

    monkeypatch.setattr(select, "select", slow)
    empty, other = os.pipe()
    line = os.open(wire.port, os.O_RDWR | os.O_NOCTTY)
    try:
        wait_until(lambda: os.write(line, b"abc") and has_bytes.wait(0.1))  # the first may come before `slow`
        wire.fail("unplugged")
        os.dup2(empty, number)
        goes_on.set()
        assert closes(wire)
    finally:
        for each in (line, empty, other, number):
            os.close(each)


def test_a_board_whose_late_answers_are_dropped_goes_on() -> None:
    """The cable is unplugged between the board's looks whether there are late answers, and when they are due."""
    wire, is_unplugged = Echo(), threading.Event()

    class Late(list[tuple[float, bytes]]):
        def __bool__(self) -> bool:
            is_empty = len(self) == 0
            if not is_empty:
                is_unplugged.wait(0.2)
            return not is_empty

    wire._late = Late()
    try:
        wire.fail("late", 60.0)
        line = os.open(wire.port, os.O_RDWR | os.O_NOCTTY)
        os.write(line, b"abc")
        wait_until(lambda: len(wire._late))
        wire.fail("unplugged")
        os.close(line)
        is_unplugged.set()
        wire.heal()
        line = os.open(wire.port, os.O_RDWR | os.O_NOCTTY)
        os.write(line, b"abc")
        assert own_is_ready(line)
        os.close(line)
    finally:
        wire.close()


@pytest.mark.skipif(compiler() is None, reason="no C compiler")
def test_a_rig_that_nobody_reads_can_be_closed() -> None:
    wire = RigWire()
    with opened(wire) as line:
        questions = short_frame(Kind.POLL) * 20_000  # some 300 kB of answers, for a line that holds less
        while questions and select.select([], [line], [], 1.0)[1]:
            questions = questions[os.write(line, questions) :]
        assert own_is_ready(line)
        began = time.monotonic()
        assert closes(wire)
        assert time.monotonic() - began < PATIENCE  # ended by itself, and not killed
