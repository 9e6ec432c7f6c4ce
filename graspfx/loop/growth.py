"""Loss of stability in a recording: motions of a grasp that grow by themselves, or ring without end."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.drive import Drive, drive
from graspfx.loop.mode import mode_name
from graspfx.loop.octaves import LEAST_GROWTH, Octave, Stretch, amplitudes, gain, octaves, pole, rises
from graspfx.loop.ringing import ringing, touches

if TYPE_CHECKING:
    from graspfx.loop.record import Recording

FloatArray = NDArray[np.float64]

LEAST_CYCLES = 8.0  # a transient has fewer
LEAST_SHARE = 0.8  # of a stretch without its growth that one pole explains
AGREEMENT = (0.6, 1.6)  # of the pole's rate with the growth that the windows show
LEAST_SIZE = 1e-9  # [m]
OVER_DRIVE = 30.0  # times what the hands mean at the pole: a resonance that is driven stays below
NEW = 1.0  # of log amplitude, above all that was before
CERTAIN = 4.5  # of log amplitude: noise takes a mode so far once in 1e4 independent windows, not along a line
SMALL = 0.1  # of the displacement at rest
LASTING = 8  # windows in which what has grown goes on
DRIVE_SAMPLES = 2048
ALIKE = 0.2  # of a frequency
MOST_OF_IT = 0.6


@dataclass(frozen=True)
class Growth:
    """One loss of stability.

    Attributes:
        object: its name.
        mode: as certificates name it: "internal", "external", "external translation", "external rotation" or "pushing
            with ...".
        rate: of log amplitude [1/s]; zero for what rings at full size from the start.
        frequency: [Hz].
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
        """Of log amplitude, in all."""
        return math.log(self.last / self.first)

    def to_dict(self) -> dict[str, Any]:
        """For summaries and JSON, SI units."""
        return asdict(self)

    def __str__(self) -> str:
        where = f"from {self.begin:.3g} to {self.end:.3g} s"
        how = f"{self.mode} of {self.object} grows by itself, {self.rate:.2g} 1/s at {self.frequency:.3g} Hz"
        if self.sustained and not self.rate:
            how = f"{self.mode} of {self.object} rings without end, {_length(self.last)} at {self.frequency:.3g} Hz"
            return f"NOT STABLE: {how}, {where}: contacts let go in every cycle"
        size = f"{_length(self.first)} to {_length(self.last)} at a fingertip"
        more = ", and goes on at that size" if self.sustained else ""
        return f"NOT STABLE: {how}, {where}, {size}{more}"


@dataclass(frozen=True, eq=False)
class Grasp:
    """What is looked at for one object.

    Attributes:
        name: of the object.
        fingers: theirs.
        rows: how many count: up to a fault.
    """

    recording: Recording
    name: str
    number: int
    fingers: NDArray[np.intp]
    rows: int

    def displacement(self, first: int, stop: int) -> FloatArray:
        """e = p - c of the fingers that touch, zero of the others, (r, n d) [m]."""
        e = self._position(first, stop) - self.recording.contact_position[first:stop, self.fingers]
        e *= self.recording.touching[first:stop, self.fingers, None]
        return e.reshape(len(e), -1)

    def arms(self, first: int, stop: int) -> FloatArray:
        """Of the fingers about the object, mean (n, d) [m]."""
        centre = self.recording.objects[self.name].position[first:stop, None]
        return np.asarray((self._position(first, stop) - centre).mean(axis=0))

    def touching(self, first: int, stop: int) -> NDArray[np.bool_]:
        """Who touches most of the time, (n,)."""
        return np.asarray(self.recording.touching[first:stop, self.fingers].mean(axis=0) > 0.5)

    def depth(self, first: int, stop: int) -> float:
        """The largest of the fingers' mean displacements [m]."""
        mean = self.displacement(first, stop).mean(axis=0).reshape(len(self.fingers), -1)
        return float(np.linalg.norm(mean, axis=1).max())

    def noise(self, first: int, stop: int) -> float:
        """Of the measured positions, RMS [m]; zero where nothing is known of it."""
        true, told = self.recording.true_position, self.recording.finger_position
        if true is None:
            return 0.0
        return float(np.sqrt(((told - true)[first:stop, self.fingers] ** 2).mean()))

    def drive(self) -> Drive:
        """What hands mean to do with it."""
        header = self.recording.header
        centre = self.recording.objects[self.name].position[0]
        return drive(header.scene_table, self.fingers.tolist(), header.scene_folder, self._position(0, 1)[0], centre)

    def mode(self, swing: NDArray[np.complex128], first: int, stop: int) -> str:
        """The name of a swing (n d,) in these rows."""
        layout, table = self.recording.layout, self.recording.header.scene_table
        things = table.get("object") or [{}]
        free = (things[self.number] if self.number < len(things) else {}).get("free")
        width = {1: 1, 2: 3, 3: 6}[layout.dimensions]
        coupling = table.get("coupling") or {}
        gains = [(coupling.get(part) or {}).get("stiffness", 0.0) for part in ("external", "internal")]
        plain = all(isinstance(each, int | float) and each > 0.0 for each in gains)
        return mode_name(
            swing.reshape(len(self.fingers), -1),
            self.arms(first, stop),
            free or [True] * width,
            self.touching(first, stop),
            [layout.fingers[i] for i in self.fingers],
            (float(gains[0]), float(gains[1])) if plain else (1.0, 1.0),
        )

    def _position(self, first: int, stop: int) -> FloatArray:
        true = self.recording.true_position
        return (self.recording.finger_position if true is None else true)[first:stop, self.fingers]


def growths(recording: Recording) -> list[Growth]:
    """The strongest loss of stability of each object that fingers touch; none where a run is stable as far as it shows.

    A stretch of a run counts as growth if, in an octave of frequency, the fingers' displacement against the object
    grows by e^2 along an exponential for eight cycles, one pole explains it, and the hands do not mean it. Operators'
    motions, touching, sliding and noise fail one or the other. It is judged by what is recorded alone.
    """
    both = ((_grown(grasp) or _rung(grasp)) for grasp in grasps(recording))
    return [each for each in both if each is not None]


def grasps(recording: Recording) -> Iterator[Grasp]:
    """Each object with its fingers, up to a fault."""
    layout = recording.layout
    rows = min([len(recording), *(fault.tick for fault in recording.faults)])
    for number, name in enumerate(layout.objects):
        fingers = np.flatnonzero(np.array(layout.finger_objects) == number)
        if fingers.size and rows:
            yield Grasp(recording, name, number, fingers, rows)


def _grown(grasp: Grasp) -> Growth | None:
    period = grasp.recording.period
    found: list[Growth] = []
    known: Drive | None = None
    above: Octave | None = None
    for octave in octaves(grasp.displacement, grasp.rows, period):
        for logs in octave.logs:
            for stretch in rises(logs):
                seen = _coherent(octave, stretch)
                if seen is None or (above is not None and _is_alias(octave, above, stretch)):
                    continue
                growth = _growth(grasp, octave, logs, stretch, seen)
                if growth.last < LEAST_SIZE or not _stands_out(logs, stretch) or _stops(grasp, logs, stretch, growth):
                    continue
                known = known or grasp.drive()
                if not _driven(octave, stretch, seen, known):
                    found.append(growth)
        above = octave
    if not found:
        return None
    # an alias or a harmonic of a motion is smaller than itself, and what comes of contacts that let go grows less
    strongest = max(found, key=lambda each: math.log(each.last) + each.growth)
    alike = [
        each
        for each in found
        if abs(each.frequency / strongest.frequency - 1.0) < ALIKE and each.growth > MOST_OF_IT * strongest.growth
    ]
    return max(alike, key=lambda each: each.rate)  # a stretch that reaches into the end of growth is slower


def _rung(grasp: Grasp) -> Growth | None:
    """What grew too fast to be seen growing, and rings."""
    layout = grasp.recording.layout
    period = grasp.recording.period
    known: Drive | None = None
    for first, stop in touches(grasp.recording.touching[: grasp.rows, grasp.fingers]):
        seen = ringing(grasp.displacement(first, stop), first, grasp.noise(first, stop))
        if seen is None:
            continue
        known = known or grasp.drive()
        begin, end, frequency = seen.first * period, seen.stop * period, seen.turn / period
        size = float(np.sqrt((np.abs(seen.swing.reshape(-1, layout.dimensions)) ** 2).sum(axis=1).max()))
        meant = known.at(begin + period * np.arange(seen.stop - seen.first))
        if known.swings(frequency, 1.5 / (end - begin)) or size < OVER_DRIVE * _content(meant, seen.turn):
            continue
        name = grasp.mode(seen.swing, seen.first, seen.stop)
        return Growth(grasp.name, name, 0.0, frequency, first * period, stop * period, size, size, True)
    return None


def _content(x: FloatArray, turn: float) -> float:
    """The largest amplitude of a frequency, in cycles a sample, in columns (M, c)."""
    taper = np.hanning(len(x))
    phase = np.exp(-2j * np.pi * turn * np.arange(len(x)))
    return float(np.abs(((x - x.mean(axis=0)) * (taper * phase)[:, None]).sum(axis=0)).max() * 2.0 / taper.sum())


def _coherent(octave: Octave, stretch: Stretch) -> complex | None:
    """The pole of a stretch; None where it is no oscillation that grows for long enough, of one phase."""
    y = octave.windows(stretch.first, stretch.count)
    growth = stretch.growth / len(y)
    z, share = pole(y, growth)
    turn = abs(float(np.angle(z)))
    cycles = turn / (2.0 * math.pi) * len(y)
    low, high = AGREEMENT
    agrees = low * growth < math.log(max(abs(z), 1e-300)) < high * growth
    inside = turn > 0.4 * math.pi
    if cycles < LEAST_CYCLES or share < LEAST_SHARE or not agrees or not inside:
        return None
    return z


def _is_alias(octave: Octave, above: Octave, stretch: Stretch) -> bool:
    """Whether what grows is faster than half the octave's samples can tell: it is larger in the octave above."""
    end = octave.time(stretch.first + stretch.count)
    return above.size_before(end) > octave.size_before(end)


def _stands_out(logs: FloatArray, stretch: Stretch) -> bool:
    """Whether the growth ends above all that was before, or is more than noise ever does to a mode with little damping.

    The amplitude of such a mode wanders: it comes back from near zero, along any curve and of one phase, to no more
    than it was before.
    """
    before = float(logs[: stretch.first].max(initial=-math.inf))
    end = float(logs[stretch.first + stretch.count - 1])
    return stretch.growth > CERTAIN or end > before + NEW


def _stops(grasp: Grasp, logs: FloatArray, stretch: Stretch, growth: Growth) -> bool:
    """Whether a motion that has grown a little stops at a small size although nothing limits it, as noise lets it."""
    after = logs[stretch.first + stretch.count :][: stretch.count]
    end = float(logs[stretch.first + stretch.count - 1])
    if stretch.growth > CERTAIN or len(after) < stretch.count or float(after.max()) > end + NEW:
        return False
    period = grasp.recording.period
    rows = slice(round(growth.end / period), grasp.rows)
    on = grasp.recording.touching[rows, grasp.fingers]
    return bool((on == on[0]).all()) and growth.last < SMALL * grasp.depth(rows.start, rows.stop)


def _driven(octave: Octave, stretch: Stretch, z: complex, known: Drive) -> bool:
    """Whether the hands may mean it."""
    frequency = abs(float(np.angle(z))) / (2.0 * math.pi * octave.step)
    y = octave.windows(stretch.first, stretch.count)
    if known.swings(frequency, 1.5 / (len(y) * octave.step)):
        return True
    count = min(len(y), DRIVE_SAMPLES)
    last = y[len(y) - count :]
    begin = octave.time(stretch.first) + (len(y) - count - 3) * octave.step
    meant = np.diff(known.at(begin + octave.step * np.arange(count + 6)), 6, axis=0) / 64.0
    tapered = np.hanning(count)[:, None]
    here, there = (float(np.abs(amplitudes(part * tapered, z)).max()) for part in (last, meant))
    return here < OVER_DRIVE * there


def _growth(grasp: Grasp, octave: Octave, logs: FloatArray, stretch: Stretch, z: complex) -> Growth:
    y = octave.windows(stretch.first, stretch.count)
    period = grasp.recording.period
    frequency = abs(float(np.angle(z))) / (2.0 * math.pi * octave.step)
    rate = math.log(abs(z)) / octave.step
    begin, end = octave.time(stretch.first), octave.time(stretch.first + stretch.count)
    swing = amplitudes(y, z) / gain(frequency, octave, period)
    d = grasp.recording.layout.dimensions
    first = float(np.sqrt((np.abs(swing.reshape(-1, d)) ** 2).sum(axis=1).max()))
    rows = slice(round(begin / period), max(round(end / period), round(begin / period) + 1))
    after = logs[stretch.first + stretch.count :]
    level = float(logs[stretch.first + stretch.count - 1])
    lasts = len(after) >= LASTING and float(np.median(after)) > level - LEAST_GROWTH / 2.0
    return Growth(
        object=grasp.name,
        mode=grasp.mode(swing, rows.start, rows.stop),
        rate=rate,
        frequency=frequency,
        begin=begin,
        end=end,
        first=first,
        last=first * math.exp(rate * (end - begin)),
        sustained=bool(lasts),
    )


def _length(metres: float) -> str:
    for unit, factor in (("m", 1.0), ("mm", 1e3), ("um", 1e6)):
        if metres * factor >= 1.0:
            return f"{metres * factor:.3g} {unit}"
    return f"{metres * 1e9:.3g} nm"
