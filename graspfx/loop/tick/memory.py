"""The servo's own memory: the first fault, what cannot go on, and each finger's force, place and energy."""

from __future__ import annotations

from typing import Any

FAULTED = 0
TICK = 1  # of the first fault
KIND = 2  # what could not go on,
INDEX = 3  # which of its kind,
CODE = 4  # and why
PERIOD = 5  # T [s]
LOOKED_UP = 6  # the tick that the targets of hands without kernels begin with
STUCK = 7  # one for each mover, then for each plant; each finger's displayed force, place and energy follow

STATION, OBJECT_, MOVER, PLANT, FOREIGN = range(5)  # TOLD: by code that is no kernel, in words

CHUNK = 1024  # ticks for which the targets of a hand without a kernel are known ahead


def latch(S: Any, k: int, kind: int, index: int, code: int) -> None:
    """Keep the first fault; from then on every force is zero."""
    if S[FAULTED] == 0.0:
        S[FAULTED] = 1.0
        S[TICK] = k
        S[KIND] = kind
        S[INDEX] = index
        S[CODE] = code
