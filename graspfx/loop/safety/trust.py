"""The trust in a run: a soft start, and forces that decay where readings stop or a finger is too quick."""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.loop.safety.safety_state import Pace

STALE, QUICK, NOT_FINITE, DEADMAN, HOST = (
    1,
    2,
    3,
    4,
    5,
)  # causes; with the number of a device or a finger: cause + CAUSES number
CAUSES = 8
DECAY = 0.02  # over which forces decay [s]


@kernel
def soft_share(ticks: float, pace: Pace) -> float:
    """Compute the soft start's share 3 x^2 - 2 x^3, x = ticks/ramp."""
    x = 1.0
    if ticks < pace.ramp:
        x = ticks / pace.ramp
    return x * x * (3.0 - 2.0 * x)


@kernel
def keep_pace(pace: Pace, k: int) -> int:
    """Compute the soft start's share 3 x^2 - 2 x^3, x = k/ramp, and the trust in the readings; give 0 or a cause.

    The trust falls by T/DECAY a sample where a device has had no new reading for more than `hold` samples, or while
    there is another cause, and grows as slowly once readings come again. At zero it gives the cause, a fault. At the
    end of a run it falls without one.
    """
    pace.soft = soft_share(k, pace)
    cause = pace.cause
    for i in range(pace.devices):
        if cause == 0 and pace.misses[i] > pace.hold:
            cause = STALE + CAUSES * i
    if cause == 0 and pace.host != 0:
        cause = HOST + CAUSES * (pace.host - 1)
    half = 0.5 * pace.fading  # nearer than that to an end is there: rounding adds no sample
    if cause == 0 and not pace.resting:
        pace.trust = pace.trust + pace.fading if pace.trust + pace.fading < 1.0 - half else 1.0
        return 0
    pace.trust = pace.trust - pace.fading if pace.trust - pace.fading > half else 0.0
    return cause if pace.trust == 0.0 else 0
