"""Ticks with an exchange with guests after each: in machine code where ticks and exchanges are, else in Python."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from graspfx.compile.calls import Call
from graspfx.loop.parts import BodyGroup
from graspfx.loop.tick.memory import MOVER, ServoState, latch
from graspfx.loop.tick.programs import Engine
from graspfx.objects.guest import CallingGuest, Guest

if TYPE_CHECKING:
    from graspfx.compile.rounds import Rounds

Exchange = Callable[[], object]
TURN = 64  # ticks after which the interpreter may see to signals and other threads


class GuestRounds:
    """Rounds of a tick and an exchange with each guest.

    Args:
        guests: in their order.
        flag: a float that is not zero after a tick with a fault, and from then on.
    """

    def __init__(self, guests: Sequence[Guest], flag: memoryview) -> None:
        self._guests, self._flag = guests, flag
        self.k = 0  # the next tick
        lists = [list(guest.calls) if isinstance(guest, CallingGuest) else [] for guest in guests]
        self._calls: list[Call] | None = [call for calls in lists for call in calls] if all(lists) else None
        self._rounds: Rounds | None = None
        self._exchanges: list[Exchange] | None = None

    def run(self, engine: Engine, last: int, row: int) -> bool:
        """Run ticks up to `last`, tick k recorded in row k + `row`; False after one with a fault, without exchange."""
        while self.k < last:
            count = min(last - self.k, TURN)
            if not self._run(engine, count, self.k + row):
                return False
        return True

    def exchanges(self, *, machine: bool) -> list[Exchange]:
        """List an exchange for each guest, as machine code if it may be."""
        if not machine:
            return [guest.exchange for guest in self._guests]
        if self._exchanges is None:
            self._exchanges = [_quick(guest) for guest in self._guests]
        return self._exchanges

    def _run(self, engine: Engine, count: int, row: int) -> bool:
        rounds = self._machine_rounds(engine, count)
        if rounds is None:
            return self._interpret(engine, count, row)
        try:
            return rounds.run(self.k, count, row) == count
        finally:
            self.k += rounds.done

    def _interpret(self, engine: Engine, count: int, row: int) -> bool:
        run, flag, exchanges = engine.each, self._flag, self.exchanges(machine=False)
        for r in range(row, row + count):
            run(self.k, 1, r)
            if flag[0]:
                return False
            for exchange in exchanges:
                exchange()
            self.k += 1
        return True

    def _machine_rounds(self, engine: Engine, count: int) -> Rounds | None:
        spread = None if self._calls is None else engine.spread(self.k, count)
        if spread is None:
            return None
        assert self._calls is not None
        from graspfx.compile.rounds import Rounds

        if self._rounds is None:
            try:
                self._rounds = Rounds(self._calls, self._flag)
            except LookupError:
                self._calls = None
                return None
        self._rounds.program = spread
        return self._rounds


def _quick(guest: Guest) -> Exchange:
    """Make a guest's exchange in machine code, where it has calls and there is LLVM."""
    if not isinstance(guest, CallingGuest) or not guest.calls:
        return guest.exchange
    from graspfx.compile.rounds import at_once

    return at_once(guest.calls)


def settle_guests(guests: Sequence[int], movers: Sequence[BodyGroup], servo: ServoState, k: int) -> None:
    """Settle what guests were told in the last tick: a fault is one of the tick that would follow.

    Args:
        guests: numbers of their movers.
        movers: of the scene.
        servo: memory of the tick.
        k: the tick that would follow.
    """
    for i in guests:
        code = 0 if servo.stuck_bodies[i] else movers[i].body.take()
        if code:
            latch(servo, k, MOVER, i, code)
            servo.stuck_bodies[i] = 1.0
