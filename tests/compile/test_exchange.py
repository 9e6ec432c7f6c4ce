"""Exchanges: calls by machine code and by Python give the same bits; errors come through, and nothing leaks."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspfx.compile.calls import Call, in_turn

pytest.importorskip("llvmlite")

from graspfx.compile.exchange import MachineExchange

Array = NDArray[np.float64]
AWKWARD = [0.0, -0.0, 5e-324, -1e-310, 1.0, -2.5e300, float("inf"), float("nan"), 0.1]


class Peer:
    """Software that is pushed and read; it notes what it was called with."""

    def __init__(self) -> None:
        self.calls: list[Any] = []

    def push(self, number: int, force: list[float], where: list[float]) -> None:
        self.calls.append((number, np.array([*force, *where]).tobytes()))

    def spin(self, number: int, *, speed: list[float]) -> None:
        self.calls.append((number, np.array(speed).tobytes(), "spin"))

    def read(self, number: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
        last = np.frombuffer(self.calls[-1][1]) if self.calls else np.zeros(6)
        return tuple(float(x) for x in last[:2]), (float(number), *last[:3].tolist())


def program(buffer: Array) -> tuple[Peer, list[Call]]:
    """Calls to a peer, on the parts of a buffer of 16."""
    peer, memory = Peer(), memoryview(buffer)
    force, where, speed = [0.0] * 3, [0.0] * 2, [0.0] * 3
    return peer, [
        Call(peer.push, (7, force, where), sends=[(force, memory[:3]), (where, memory[3:5])], nonzero=memory[:3]),
        Call(
            peer.spin, (8,), {"speed": speed}, sends=[(speed, memory[5:8])], changed=(memory[5:8], memory[13:16])
        ),
        Call(peer.read, (9,), receipts=[(1, memory[8:12]), (0, memory[12:14])]),
    ]  # fmt: skip


def test_machine_code_calls_as_python_does() -> None:
    rng = np.random.default_rng(3)
    buffers = np.zeros(16), np.zeros(16)
    (peer, calls), (other, others) = map(program, buffers)
    run, again = MachineExchange(calls), in_turn(others)
    for _ in range(400):
        entries, numbers = rng.integers(0, 16, 4), rng.choice(AWKWARD, 4)
        for buffer in buffers:
            buffer[entries] = numbers
        run()
        again()
        assert buffers[0].tobytes() == buffers[1].tobytes()
    assert peer.calls == other.calls
    lengths = {len(call) for call in peer.calls}
    assert lengths == {2, 3}
    assert len(peer.calls) < 800  # some were left out


def test_what_changes_nothing_is_no_call() -> None:
    buffer = np.zeros(16)
    peer, calls = program(buffer)
    run = MachineExchange(calls)
    run()
    assert peer.calls == []
    buffer[1] = -0.0
    run()
    assert peer.calls == []
    buffer[5] = -0.0  # not the same to the bit
    run()
    assert len(peer.calls) == 1
    buffer[2] = 5e-324
    run()
    assert len(peer.calls) == 3


def raising(function: Callable[[int], Any], failing: int) -> Callable[[], Any]:
    """A function of its own turn, from 0 on, which gives what another does for all but one of them."""
    turns = iter(range(10**9))

    def called() -> Any:
        turn = next(turns)
        return function(turn) if turn == failing else ((1.0, 2.0),)

    return called


@pytest.mark.parametrize(
    ("function", "error"),
    [
        (lambda _: 1 // 0, ZeroDivisionError),
        (lambda _: ((1.0,),), IndexError),
        (lambda _: (), IndexError),
        (lambda _: ((1.0, "x"),), TypeError),
        (lambda _: None, SystemError),
        (lambda _: (None,), SystemError),
    ],
)
def test_errors_come_through(function: Callable[[int], Any], error: type[Exception]) -> None:
    buffer = np.zeros(2)
    run = MachineExchange([Call(raising(function, 3), (), receipts=[(0, memoryview(buffer))])])
    for turn in range(10):
        if turn == 3:
            with pytest.raises(error):
                run()
        else:
            run()


def test_a_list_that_has_become_too_short_is_an_error() -> None:
    numbers, buffer = [0.0, 0.0], np.ones(2)
    run = MachineExchange([Call(len, (numbers,), sends=[(numbers, memoryview(buffer))])])
    run()
    numbers.pop()
    with pytest.raises(IndexError):
        run()
    assert numbers == [1.0]


def test_a_million_exchanges_leave_nothing_behind() -> None:
    """References of all that takes part, and Python's blocks of memory, are as many as before."""
    numbers, buffer = [0.0] * 3, np.arange(1.0, 7.0)
    memory = memoryview(buffer)
    arguments, keywords = (numbers, 1.5), {"start": 0.25}
    wrong = (numbers, "x")

    def swap(values: list[float], scale: float, *, start: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        x, y, z = values
        return (y * scale, z, x), (start, x, y)

    call = Call(swap, arguments, keywords, [(numbers, memory[:3])], [(0, memory[3:6]), (1, memory[:3])])
    run = MachineExchange([call])
    failing = MachineExchange([Call(swap, wrong, keywords, [(numbers, memory[:3])]), call])

    def counts() -> list[int]:
        gc.collect()
        parts = (swap, arguments, keywords, numbers, wrong, run)
        return [*map(sys.getrefcount, parts), sys.getrefcount(None), sys.getallocatedblocks()]

    def fail() -> None:
        for _ in range(1000):
            with pytest.raises(TypeError):
                failing()

    def several(count: int) -> None:
        for _ in range(count):
            run()

    several(1000)
    fail()
    before = counts()
    several(1_000_000)
    fail()
    after = counts()
    assert after[:-2] == before[:-2]
    grown = np.subtract(after[-2:], before[-2:]).max()  # others in this process have these too
    assert grown < 900  # a leak leaves one for each of the 1000 failing exchanges, or of the 1 000 000 others


def test_an_exchange_holds_what_it_points_to() -> None:
    """Buffers, lists and functions live as long as somebody may call."""
    state = np.zeros(16)
    numbers = [0.0]

    def push(values: list[float]) -> tuple[tuple[float]]:
        return ((values[0] + 1.0,),)

    memory = memoryview(state)
    call = Call(push, (numbers,), sends=[(numbers, memory[3:4])], receipts=[(0, memory[3:4])])
    run = MachineExchange([call])
    del call, push, numbers, state
    gc.collect()
    rubbish = [np.full(16, 7.0) for _ in range(100)]
    for _ in range(1000):
        run()
    assert memory[3] == 1000.0
    assert len(rubbish) == 100
