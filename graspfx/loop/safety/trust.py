"""Soft start, and trust in the readings: forces decay if there is a cause, such as missing readings, or at the end."""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.loop.safety.safety_state import Pace

STALE, QUICK, NOT_FINITE, DEADMAN, HOST = (
    1,
    2,
    3,
    4,
    5,
)  # causes of the decay; a fault code is cause + CAUSES * index of the device or finger
CAUSES = 8
DECAY = 0.02  # time in which forces decay to zero [s]


@kernel
def soft_share(ticks: float, pace: Pace) -> float:
    """Compute the factor 3 x^2 - 2 x^3 of the soft start, x = ticks/ramp; after the soft start, the factor is 1."""
    x = 1.0
    if ticks < pace.ramp:
        x = ticks / pace.ramp
    return x * x * (3.0 - 2.0 * x)


@kernel
def keep_pace(pace: Pace, k: int) -> int:
    """Compute the factor of the soft start and the trust in the readings for tick k.

    The trust decreases by T/DECAY per sample while a device has had no new reading for more than `hold` samples, or
    while there is another cause; otherwise it increases at the same rate up to 1. At the end of a run, the trust
    decreases without a cause.

    Returns:
        Fault code with the cause if the trust is zero because of a cause; otherwise 0.
    """
    pace.soft = soft_share(k, pace)
    cause = pace.cause
    for i in range(pace.devices):
        if cause == 0 and pace.misses[i] > pace.hold:
            cause = STALE + CAUSES * i
    if cause == 0 and pace.host != 0:
        cause = HOST + CAUSES * (pace.host - 1)
    half = 0.5 * pace.fading  # tolerance within which the trust is set to 0 or 1, so that rounding adds no sample
    if cause == 0 and not pace.resting:
        pace.trust = pace.trust + pace.fading if pace.trust + pace.fading < 1.0 - half else 1.0
        return 0
    pace.trust = pace.trust - pace.fading if pace.trust - pace.fading > half else 0.0
    return cause if pace.trust == 0.0 else 0
