"""Loss of stability in a recording: motions of a grasp that grow by themselves, or ring without end."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.drive import Drive
from graspfx.loop.recording.growth.divergence import Divergence, divergences
from graspfx.loop.recording.growth.evidence import (
    OVER_DRIVE,
    coherent_pole,
    is_alias,
    is_driven,
    is_steady,
    stands_out,
    stops,
)
from graspfx.loop.recording.growth.octaves import (
    LEAST_GROWTH,
    WINDOW,
    Octave,
    Stretch,
    amplitudes,
    gain,
    octaves,
    rises,
)
from graspfx.loop.recording.growth.ringing import ringing, touches
from graspfx.loop.recording.growth.view import GraspView, grasps
from graspfx.loop.recording.history import History

FloatArray = NDArray[np.float64]

LEAST_SIZE = 1e-9  # [m]
MOST_GROWTH = 600.0  # of log amplitude: numbers go no further
LASTING = 8  # windows in which what has grown goes on
ALIKE = 0.2  # of a frequency
MOST_OF_IT = 0.6  # of the largest growth
SHAKEN_ROWS = 1 << 16  # in which the content of tremor and noise is sought


@dataclass(frozen=True)
class Growth:
    """One loss of stability.

    Attributes:
        object: its name.
        mode: as certificates name it: "internal", "external", "external translation", "external rotation" or "pushing
            with ...".
        rate: of log amplitude [1/s]; zero for what rings at full size from the start.
        frequency: [Hz]; zero for what runs away without swinging.
        begin, end: between which it was seen [s].
        first, last: largest amplitude of a fingertip against the object then [m].
        sustained: whether the oscillation goes on at its size, as contacts that let go limit it.
    """

    object: str
    mode: str
    rate: float
    frequency: float
    begin: float
    end: float
    first: float
    last: float
    sustained: bool

    @property
    def growth(self) -> float:
        """Growth of the log amplitude, in all."""
        return math.log(self.last / self.first)

    def to_dict(self) -> dict[str, Any]:
        """Give the numbers for summaries and JSON, SI units."""
        return asdict(self)

    def __str__(self) -> str:
        where = f"from {self.begin:.3g} to {self.end:.3g} s"
        swing = f" at {self.frequency:.3g} Hz" if self.frequency else " without swinging"
        how = f"{self.mode} of {self.object} grows by itself, {self.rate:.2g} 1/s{swing}"
        if self.sustained and not self.rate:
            how = f"{self.mode} of {self.object} rings without end, {_length(self.last)} at {self.frequency:.3g} Hz"
            return f"NOT STABLE: {how}, {where}: contacts let go in every cycle"
        size = f"{_length(self.first)} to {_length(self.last)} at a fingertip"
        more = ", and goes on" if self.sustained else ""
        return f"NOT STABLE: {how}, {where}, {size}{more}"


def losses(recording: History) -> list[dict[str, Any]]:
    """List the growths of a recording for its summary: numbers, the certificate's word if there is one, and a sentence.

    Nothing is certified unless something grows.
    """
    tables = []
    for each in growths(recording):
        certificate = None if recording._beside is None else recording._beside(each.object, each.mode)
        text = str(each) if certificate is None else f"{each}; {certificate['text']}"
        tables.append(each.to_dict() | {"certificate": certificate, "text": text})
    return tables


def growths(recording: History) -> list[Growth]:
    """Find the strongest loss of stability of each object that fingers touch; none where a run looks stable.

    A stretch of a run counts as growth if, in an octave of frequency, the fingers' displacement against the object
    grows by e^2 along an exponential for eight cycles, one pole explains it, and the hands do not mean it. Operators'
    motions, touching, sliding and noise fail one or the other. It is judged by what is recorded alone.
    """
    with np.errstate(all="ignore"):  # positions may be anything; what is not finite is no growth
        both = [(_grown(grasp) or _rung(grasp)) for grasp in grasps(recording)]
    return [each for each in both if each is not None]


def _grown(grasp: GraspView) -> Growth | None:
    period = grasp.recording.row_period
    candidates: list[Growth] = []
    steady: list[Growth] = []
    hands: Drive | None = None
    above: Octave | None = None
    for octave in octaves(grasp.displacement, grasp.rows, period):
        for logs in octave.logs:
            for stretch in rises(logs):
                z = coherent_pole(octave, stretch)
                if z is None or (above is not None and is_alias(octave, above, stretch)):
                    continue
                growth = _growth(grasp, octave, logs, stretch, z)
                if growth.last < LEAST_SIZE or not stands_out(logs, stretch):
                    continue
                if stops(grasp, logs, stretch, growth.end, growth.last):
                    continue
                hands = hands or grasp.drive()
                if not is_driven(octave, stretch, z, hands) and not _shaken(grasp, growth, hands):
                    candidates.append(growth)
                    steady += [growth] if is_steady(octave, logs, stretch, z) else []
        for away in divergences(octave):
            hands = hands or grasp.drive()
            growth = _divergence(grasp, away)
            if growth.last > LEAST_SIZE and hands.complete and not _led(grasp, away, hands):
                candidates.append(growth)
                steady.append(growth)
        above = octave
    # of a motion whose frequency changes as arms move, a shorter stretch is steady
    candidates = [each for each in candidates if any(_is_alike(each, other) for other in steady)]
    if not candidates:
        return None
    # an alias or a harmonic of a motion is smaller than itself, and what comes of contacts that let go grows less
    strongest = max(candidates, key=lambda each: math.log(each.last) + each.growth)
    least = MOST_OF_IT * strongest.growth
    alike = [each for each in candidates if each.growth > least and _is_alike(each, strongest)]
    return max(alike, key=lambda each: each.rate)  # a stretch that reaches into the end of growth is slower


def _is_alike(growth: Growth, other: Growth) -> bool:
    """Tell whether two growths may be of one mode."""
    return abs(growth.frequency - other.frequency) <= ALIKE * other.frequency


def _rung(grasp: GraspView) -> Growth | None:
    """Find oscillations that grew too fast to be seen growing, and ring."""
    layout = grasp.recording.layout
    period = grasp.recording.row_period
    hands: Drive | None = None
    for first, stop, count in touches(grasp.recording.touching[: grasp.rows, grasp.fingers]):
        ring = ringing(grasp.displacement(first, stop), first, count, grasp.noise(first, stop))
        if ring is None:
            continue
        hands = hands or grasp.drive()
        begin, end, frequency = ring.first * period, ring.stop * period, ring.turn / period
        size = float(np.sqrt((np.abs(ring.swing.reshape(-1, layout.dimensions)) ** 2).sum(axis=1).max()))
        intent = hands.at(begin + period * np.arange(ring.stop - ring.first))
        if hands.swings(frequency, 1.5 / (end - begin)) or size < OVER_DRIVE * _content(intent, ring.turn):
            continue
        name = grasp.mode(ring.swing, ring.first, ring.stop)
        growth = Growth(grasp.name, name, 0.0, frequency, first * period, stop * period, size, size, True)
        if not _shaken(grasp, growth, hands):
            return growth
    return None


def _shaken(grasp: GraspView, growth: Growth, hands: Drive) -> bool:
    """Tell whether tremor or noise of the hands may do it, by the size in the end, however little it grew from.

    A grasp answers a tremor, behind the hand's spring, as it does what hands mean. Noise is force at the fingertip: in
    N cycles an oscillation without damping, driven at its own frequency, grows by pi N times its drive.
    """
    turn, cycles = growth.frequency * grasp.recording.row_period, growth.frequency * (growth.end - growth.begin)
    tremor, noise = (_content(each, turn) for each in _shaking(grasp, hands, growth.begin, growth.end))
    return growth.last < max(OVER_DRIVE * tremor, max(OVER_DRIVE, math.pi * cycles) * noise)


def _shaking(grasp: GraspView, hands: Drive, begin: float, end: float) -> tuple[FloatArray, FloatArray]:
    """Compute tremor and noise of the hands from row to row, (r, c) each [m]; of a long time its end."""
    period = grasp.recording.row_period
    times = (begin + period * np.arange(max(math.ceil((end - begin) / period), 1)))[-SHAKEN_ROWS:]
    return hands.tremor(times), hands.noise(times, grasp.depth(0, grasp.rows))


def _content(x: FloatArray, turn: float) -> float:
    """Find the largest amplitude of a frequency, in cycles a sample, in columns (M, c)."""
    taper = np.hanning(len(x))
    phase = np.exp(-2j * np.pi * turn * np.arange(len(x)))
    return float(np.abs(((x - x.mean(axis=0)) * (taper * phase)[:, None]).sum(axis=0)).max() * 2.0 / taper.sum())


def _divergence(grasp: GraspView, away: Divergence) -> Growth:
    period, d = grasp.recording.row_period, grasp.recording.layout.dimensions
    rows = round(away.begin / period), min(round(away.end / period), grasp.rows)
    last = float(np.linalg.norm(away.swing.reshape(-1, d), axis=1).max())
    rate = math.log(away.z) / away.octave.step
    first = last * math.exp(-rate * (away.end - away.begin))
    mode = grasp.mode(away.swing.astype(complex), *rows)
    return Growth(grasp.name, mode, rate, 0.0, away.begin, away.end, first, last, False)


def _led(grasp: GraspView, away: Divergence, hands: Drive) -> bool:
    """Tell whether the hands may mean it, or shake so much."""
    step = away.octave.step
    times = away.begin + step * (np.arange(away.stretch.length * WINDOW + 2) - 1)
    intent = np.diff(hands.at(times), 2, axis=0)
    largest = float(np.abs(intent).max())
    shaking = np.concatenate(_shaking(grasp, hands, away.begin, away.end), axis=1)
    for octave in octaves(lambda first, stop: shaking[first:stop], len(shaking), grasp.recording.row_period):
        if octave.step == step:  # without what is faster, as the motion is
            largest = max(largest, float(np.abs(np.diff(octave.samples(), 2, axis=0)).max()))
    return float(np.abs(away.last).max()) < OVER_DRIVE * largest


def _growth(grasp: GraspView, octave: Octave, logs: FloatArray, stretch: Stretch, z: complex) -> Growth:
    y = octave.windows(stretch.first, stretch.length)
    period = grasp.recording.row_period
    frequency = abs(float(np.angle(z))) / (2.0 * math.pi * octave.step)
    rate = math.log(abs(z)) / octave.step
    begin, end = octave.time(stretch.first), octave.time(stretch.first + stretch.length)
    swing = amplitudes(y, z) / gain(frequency, octave, period)
    d = grasp.recording.layout.dimensions
    first = float(np.sqrt((np.abs(swing.reshape(-1, d)) ** 2).sum(axis=1).max()))
    rows = slice(round(begin / period), max(round(end / period), round(begin / period) + 1))
    after = logs[stretch.first + stretch.length :]
    level = float(logs[stretch.first + stretch.length - 1])
    goes_on = len(after) >= LASTING and float(np.median(after)) > level - LEAST_GROWTH / 2.0
    return Growth(
        object=grasp.name,
        mode=grasp.mode(swing, rows.start, rows.stop),
        rate=rate,
        frequency=frequency,
        begin=begin,
        end=end,
        first=first,
        last=first * math.exp(min(rate * (end - begin), MOST_GROWTH)),
        sustained=bool(goes_on),
    )


def _length(metres: float) -> str:
    for unit, factor in (("m", 1.0), ("mm", 1e3), ("um", 1e6)):
        if metres * factor >= 1.0:
            return f"{metres * factor:.3g} {unit}"
    return f"{metres * 1e9:.3g} nm"
