"""Guests of a tick: bodies that other software moves, and their exchange after each tick."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

from graspfx.loop.arena import Arena
from graspfx.loop.parts import BodyGroup
from graspfx.loop.world import MOVER, ServoState, latch
from graspfx.objects.guest import CallingGuest, Guest

TURN = 64  # number of ticks after which the interpreter may handle signals and other threads


def exchange_by_machine(arena: Arena, guests: Sequence[Guest]) -> list[object]:
    """Let `steps` exchange with all guests by machine code, if possible; return the objects that must stay alive."""
    from graspfx.compile.exchange import MachineExchange

    if not all(isinstance(guest, CallingGuest) and guest.calls for guest in guests):
        return []
    with suppress(ImportError, LookupError):
        made = [MachineExchange(guest.calls) for guest in guests if isinstance(guest, CallingGuest)]
        for record, each in zip(arena.world.exchanges, made, strict=True):
            record.address, record.plan = each.address, arena.place(each.plan.view(float))
        arena.world.exchanging = True
        arena.world.pauses = bool(arena.ports or arena.bodies or arena.plants)
        return list(made)
    return []


def settle_guests(guests: Sequence[int], movers: Sequence[BodyGroup], servo: ServoState, k: int) -> None:
    """Complete the last tick's exchange with guests; a fault is assigned to the following tick.

    Args:
        guests: indices of their movers.
        movers: movers of the scene.
        servo: memory of the tick.
        k: the following tick.
    """
    for i in guests:
        code = 0 if servo.stuck_bodies[i] else movers[i].body.take()
        if code:
            latch(servo, k, MOVER, i, code)
            servo.stuck_bodies[i] = 1.0
