"""Trust in the readings: a soft start, and the decay of forces for a cause, such as missing readings, or at the end."""

from __future__ import annotations

from graspfx.compile.kernel import kernel
from graspfx.loop.safety.safety_state import Pace

STALE, QUICK, NOT_FINITE, DEADMAN, HOST = (
    1,
    2,
    3,
    4,
    5,
)  # causes; the code is cause + CAUSES * index of the device or finger
CAUSES = 8
DECAY = 0.02  # time in which forces decay [s]


@kernel
def soft_share(ticks: float, pace: Pace) -> float:
    """Compute the soft start's factor 3 x^2 - 2 x^3, x = ticks/ramp."""
    x = 1.0
    if ticks < pace.ramp:
        x = ticks / pace.ramp
    return x * x * (3.0 - 2.0 * x)


@kernel
def keep_pace(pace: Pace, k: int) -> int:
    """Compute the soft start's factor 3 x^2 - 2 x^3, x = k/ramp, and the trust in the readings; return 0 or a cause.

    The trust decreases by T/DECAY per sample while a device has had no new reading for more than `hold` samples or
    another cause persists, and increases at the same rate afterwards. When the trust is zero, the function returns the
    cause, which is a fault. At the end of a run the trust decreases without a fault.
    """
    pace.soft = soft_share(k, pace)
    cause = pace.cause
    for i in range(pace.devices):
        if cause == 0 and pace.misses[i] > pace.hold:
            cause = STALE + CAUSES * i
    if cause == 0 and pace.host != 0:
        cause = HOST + CAUSES * (pace.host - 1)
    half = 0.5 * pace.fading  # a trust this close to 0 or 1 counts as 0 or 1, so rounding adds no sample
    if cause == 0 and not pace.resting:
        pace.trust = pace.trust + pace.fading if pace.trust + pace.fading < 1.0 - half else 1.0
        return 0
    pace.trust = pace.trust - pace.fading if pace.trust - pace.fading > half else 0.0
    return cause if pace.trust == 0.0 else 0
