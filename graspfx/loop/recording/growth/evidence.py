"""Evidence that a stretch of an octave grows by itself: one pole, enough cycles, no alias, no noise, and no hand."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.drive import Drive
from graspfx.loop.recording.growth.octaves import ORDER, TINY, Octave, Stretch, amplitudes, poles
from graspfx.loop.recording.growth.view import GraspView

FloatArray = NDArray[np.float64]

LEAST_CYCLES = 8.0  # a transient has fewer
LEAST_SHARE = 0.8  # of a stretch without its growth that one oscillation explains
LEAST_SHARE_OF_TWO = 0.97
INSIDE = 0.4  # of half the sampling rate: an octave begins at 0.5
AGREEMENT = (0.6, 1.6)  # of the pole's rate with the growth that the windows show
FAR = 20.0  # of log amplitude
NEW = 1.0  # of log amplitude, above all that was before
CERTAIN = 4.5  # of log amplitude: noise takes a mode so far once in 1e4 independent windows, not along a line
SMALL = 0.1  # of the displacement at rest
FLAGGING = 0.6  # of the first half's rate that the second half keeps; t^k exp(-s t) that rises by e^2 keeps less
BENDING = 0.6  # rad: second difference of the phases of three thirds, which one frequency has none of
OVER_DRIVE = 30.0  # times what the hands mean at the pole: a resonance that is driven stays below
DRIVE_SAMPLES = 2048


def coherent_pole(octave: Octave, stretch: Stretch) -> complex | None:
    """Find the pole of a stretch; None where it is no oscillation that grows for long enough, of one phase.

    Where one oscillation does not explain it two may, of which the larger one in the end has to be what grows.
    """
    y = octave.windows(stretch.first, stretch.length)
    growth = stretch.growth / len(y)
    for rank, least in ((2, LEAST_SHARE), (4, LEAST_SHARE_OF_TWO)):
        z_i, share = poles(y, growth, rank)
        upper = [complex(z) for z in z_i if z.imag > 0.0]
        if not upper and octave.is_highest:  # it alternates
            upper = [complex(z_i[np.argmax(np.abs(z_i))])]
        # what is so much larger or smaller at one end is not in the stretch
        upper = [z for z in upper if abs(math.log(max(abs(z), TINY)) - growth) * len(y) < FAR]
        growing = [z for z in upper if _grows(z, growth, len(y))]
        if share >= least and growing:
            z = growing[0]
            sizes = [_size_at_end(y, each, [other for other in upper if other != each]) for each in upper]
            if len(upper) == 1 or upper[int(np.argmax(sizes))] == z:
                return z
    return None


def _size_at_end(y: FloatArray, z: complex, others: list[complex]) -> float:
    """Estimate the log amplitude at the end."""
    size = float(np.abs(amplitudes(y, z, others)).max())
    return math.log(max(size, TINY)) + math.log(max(abs(z), TINY)) * len(y)


def _grows(z: complex, growth: float, count: int) -> bool:
    """Tell whether a pole lies in the octave, turns often enough in so many samples and grows as the windows do."""
    turn = abs(float(np.angle(z)))
    low, high = AGREEMENT
    agrees = low * growth < math.log(max(abs(z), TINY)) < high * growth
    return agrees and turn > INSIDE * math.pi and turn * count / (2.0 * math.pi) >= LEAST_CYCLES


def is_steady(octave: Octave, logs: FloatArray, stretch: Stretch, z: complex) -> bool:
    """Tell whether a stretch keeps its rate and its frequency.

    A transient t^k exp(-s t) grows ever slower, and the frequency of a chirp through a resonance goes on.
    """
    if stretch.growth > 2.0 * CERTAIN:  # no resonance is passed so slowly, and two modes that grow may beat
        return True
    part = logs[stretch.first : stretch.first + stretch.length]
    half = len(part) // 2
    first, second = (float(np.polyfit(np.arange(len(each)), each, 1)[0]) for each in (part[:-half], part[half:]))
    if second < FLAGGING * first:
        return False
    y = octave.windows(stretch.first, stretch.length)
    size = len(y) // 3
    thirds = [amplitudes(y[k * size : (k + 1) * size], z) * z ** (-k * size) for k in range(3)]
    early, late = np.vdot(thirds[0], thirds[1]), np.vdot(thirds[1], thirds[2])
    return abs(float(np.angle(late * np.conj(early)))) < BENDING


def is_alias(octave: Octave, above: Octave, stretch: Stretch) -> bool:
    """Tell whether growth is faster than half the octave's samples can tell: it is as large in the octave above.

    What is at half the octave's samples passes twice as large to it as to the one above.
    """
    end = octave.time(stretch.first + stretch.length)
    return 2.0 * above.size_before(end) > octave.size_before(end)


def stands_out(logs: FloatArray, stretch: Stretch) -> bool:
    """Tell whether the growth ends above everything before, or exceeds what noise does to a mode with little damping.

    The amplitude of such a mode wanders: it comes back from near zero, along any curve and of one phase, to no more
    than it was before.
    """
    before = float(logs[: stretch.first].max(initial=-math.inf))
    end = float(logs[stretch.first + stretch.length - 1])
    return stretch.growth > CERTAIN or end > before + NEW


def stops(grasp: GraspView, logs: FloatArray, stretch: Stretch, end_time: float, size: float) -> bool:
    """Tell whether a motion that has grown a little stops although nothing limits it.

    It stops at a small size, as noise lets it, or it dies away again, as a transient does.

    Args:
        grasp: whose motion it is.
        logs, stretch: the windows.
        end_time: when the stretch ends [s].
        size: of the motion then [m].
    """
    rest = logs[stretch.first + stretch.length :]
    after = rest[: stretch.length]
    end = float(logs[stretch.first + stretch.length - 1])
    if stretch.growth > CERTAIN or len(after) < stretch.length or float(after.max()) > end + NEW:
        return False
    dies = float(np.median(rest[len(rest) // 2 :])) < end - NEW
    period = grasp.recording.row_period
    rows = slice(round(end_time / period), grasp.rows)
    on = grasp.recording.touching[rows, grasp.fingers]
    return bool((on == on[0]).all()) and (dies or size < SMALL * grasp.depth(rows.start, rows.stop))


def is_driven(octave: Octave, stretch: Stretch, z: complex, hands: Drive) -> bool:
    """Tell whether the hands may mean it."""
    frequency = abs(float(np.angle(z))) / (2.0 * math.pi * octave.step)
    y = octave.windows(stretch.first, stretch.length)
    if hands.swings(frequency, 1.5 / (len(y) * octave.step)):
        return True
    count = min(len(y), DRIVE_SAMPLES)
    last = y[len(y) - count :]
    begin = octave.time(stretch.first) + (len(y) - count - ORDER // 2) * octave.step
    intent = np.diff(hands.at(begin + octave.step * np.arange(count + ORDER)), ORDER, axis=0) / 2.0**ORDER
    taper = np.hanning(count)[:, None]
    here, there = (float(np.abs(amplitudes(part * taper, z)).max()) for part in (last, intent))
    return here < OVER_DRIVE * there
