"""Detection of instability in a recording: motions of a grasp that grow or oscillate without an external cause."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.columns import WIDTHS
from graspfx.loop.hand_excitation import Drive, drive
from graspfx.recording.history import History
from graspfx.recording.octaves import (
    LEAST_GROWTH,
    ORDER,
    STEADY,
    TINY,
    WINDOW,
    Divergence,
    Octave,
    Ringing,
    Stretch,
    amplitudes,
    divergences,
    gain,
    octaves,
    poles,
    ringing,
    rises,
    touches,
)

FloatArray = NDArray[np.float64]

LEAST_SIZE = 1e-9  # [m]
MOST_GROWTH = 600.0  # largest log amplitude, bounded by the range of numbers
LASTING = 8  # smallest number of windows in which a grown motion continues
ALIKE = 0.2  # largest relative difference of frequencies of one mode
MOST_OF_IT = 0.6  # fraction of the largest growth
SHAKEN_ROWS = 1 << 16  # largest number of rows in which the content of tremor and noise is analysed


@dataclass(frozen=True)
class Growth:
    """One detected instability of a grasp.

    Attributes:
        object: Name of the object.
        mode: Name of the mode as in certificates: "internal", "external", "external translation", "external rotation",
            or "pushing with" and the names of fingers.
        rate: Growth rate of the log amplitude [1/s]; zero for an oscillation of constant amplitude.
        frequency: Frequency [Hz]; zero for a divergence without oscillation.
        begin, end: Bounds of the interval in which the motion grows or oscillates [s].
        first, last: Amplitudes of the fingertip that moves most, relative to the object, at `begin` and `end` [m].
        sustained: Whether the oscillation continues at the amplitude `last`.
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
        """Increase of the log amplitude from `begin` to `end`."""
        return math.log(self.last / self.first)

    def to_dict(self) -> dict[str, Any]:
        """Return all attributes as a dictionary, in SI units."""
        return asdict(self)

    def __str__(self) -> str:
        where = f"from {self.begin:.3g} to {self.end:.3g} s"
        swing = f" at {self.frequency:.3g} Hz" if self.frequency else " without oscillation"
        how = f"{self.mode} of {self.object} grows by itself, {self.rate:.2g} 1/s{swing}"
        if self.sustained and not self.rate:
            how = f"{self.mode} of {self.object} does not decay, {_length(self.last)} at {self.frequency:.3g} Hz"
            return f"NOT STABLE: {how}, {where}: contacts release in every cycle"
        size = f"{_length(self.first)} to {_length(self.last)} at a fingertip"
        more = ", and continues" if self.sustained else ""
        return f"NOT STABLE: {how}, {where}, {size}{more}"


def losses(recording: History) -> list[dict[str, Any]]:
    """Return a table for the summary for each instability: its attributes, its `certificate` and its `text`.

    A certificate is computed only for a detected instability, and only if the scene is available.
    """
    tables = []
    for each in growths(recording):
        certificate = None if recording._beside is None else recording._beside(each.object, each.mode)
        text = str(each) if certificate is None else f"{each}; {certificate['text']}"
        tables.append(each.to_dict() | {"certificate": certificate, "text": text})
    return tables


def growths(recording: History) -> list[Growth]:
    """Return the strongest instability of each object that has fingers; empty if the run appears stable.

    An interval of a run counts as growth if, in one octave of frequency, the displacement of the fingers relative to
    the object grows exponentially, by a factor of e^2 or more, over eight cycles or more; if one pole explains this
    motion; and if the intended motion of the hands does not explain it. Motions of operators, changes of contact,
    sliding and noise violate at least one of these criteria. Only recorded data are used.
    """
    with np.errstate(all="ignore"):  # non-finite positions are not growth
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
    # if the frequency changes with the arms' posture, a shorter interval is steady
    candidates = [each for each in candidates if any(_is_alike(each, other) for other in steady)]
    if not candidates:
        return None
    # aliases and harmonics are smaller than their motion, and effects of releasing contacts grow less
    strongest = max(candidates, key=lambda each: math.log(each.last) + each.growth)
    least = MOST_OF_IT * strongest.growth
    alike = [each for each in candidates if each.growth > least and _is_alike(each, strongest)]
    return max(alike, key=lambda each: each.rate)  # growth appears slower in an interval that includes its end


def _is_alike(growth: Growth, other: Growth) -> bool:
    """Return whether the frequencies of two growths are close enough for both to belong to one mode."""
    return abs(growth.frequency - other.frequency) <= ALIKE * other.frequency


def _rung(grasp: GraspView) -> Growth | None:
    """Find an oscillation of constant amplitude with contacts that close in every cycle; None if there is none.

    The growth of such an oscillation was too fast to be observed.
    """
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
        if calms(grasp, ring, size):
            continue
        name = grasp.mode(ring.swing, ring.first, ring.stop)
        growth = Growth(grasp.name, name, 0.0, frequency, first * period, stop * period, size, size, True)
        if not _shaken(grasp, growth, hands):
            return growth
    return None


def _shaken(grasp: GraspView, growth: Growth, hands: Drive) -> bool:
    """Return whether tremor or noise of the hands could cause a motion of the amplitude at the end of a growth.

    A grasp responds to tremor, through the spring of the hand, as to intended motion. Noise is a force at the
    fingertip. An undamped oscillation that noise excites at its natural frequency reaches pi N times the static
    displacement in N cycles.
    """
    turn, cycles = growth.frequency * grasp.recording.row_period, growth.frequency * (growth.end - growth.begin)
    tremor, noise = (_content(each, turn) for each in _shaking(grasp, hands, growth.begin, growth.end))
    return growth.last < max(OVER_DRIVE * tremor, max(OVER_DRIVE, math.pi * cycles) * noise)


def _shaking(grasp: GraspView, hands: Drive, begin: float, end: float) -> tuple[FloatArray, FloatArray]:
    """Return tremor and noise of the hands at each row, (r, c) each [m], for the last SHAKEN_ROWS rows at most."""
    period = grasp.recording.row_period
    times = (begin + period * np.arange(max(math.ceil((end - begin) / period), 1)))[-SHAKEN_ROWS:]
    return hands.tremor(times), hands.noise(times, grasp.depth(0, grasp.rows))


def _content(x: FloatArray, turn: float) -> float:
    """Return the largest amplitude of the columns x (M, c) at the frequency `turn`, in cycles per sample."""
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
    """Return whether intended motion, tremor or noise of the hands could cause a divergence."""
    step = away.octave.step
    times = away.begin + step * (np.arange(away.stretch.length * WINDOW + 2) - 1)
    intent = np.diff(hands.at(times), 2, axis=0)
    largest = float(np.abs(intent).max())
    shaking = np.concatenate(_shaking(grasp, hands, away.begin, away.end), axis=1)
    for octave in octaves(lambda first, stop: shaking[first:stop], len(shaking), grasp.recording.row_period):
        if octave.step == step:  # low-pass filtered like the motion
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


# One grasp of a recording: an object and its fingers ----------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class GraspView:
    """An object of a recording with its fingers.

    Attributes:
        recording: Recording of the run.
        name: Name of the object.
        number: Index of the object.
        fingers: Indices of the object's fingers.
        rows: Number of rows before the first fault.
    """

    recording: History
    name: str
    number: int
    fingers: NDArray[np.intp]
    rows: int

    def displacement(self, first: int, stop: int) -> FloatArray:
        """Return the displacements p - c of fingertips p from their contacts c, zero without contact, (r, n d) [m]."""
        e = self._position(first, stop) - self._read("contact_position", first, stop)
        e *= np.not_equal(self._read("touching", first, stop), 0.0)[:, :, None]
        return e.reshape(len(e), -1)

    def arms(self, first: int, stop: int) -> FloatArray:
        """Return the mean positions of the fingers relative to the object's centre, (n, d) [m]."""
        centre = self.recording.read(f"objects/{self.name}/position", first, stop)[:, None]
        return np.asarray((self._position(first, stop) - centre).mean(axis=0))

    def touching(self, first: int, stop: int) -> NDArray[np.bool_]:
        """Return which fingers touch the object in more than half of the rows, (n,)."""
        return np.asarray(np.not_equal(self._read("touching", first, stop), 0.0).mean(axis=0) > 0.5)

    def depth(self, first: int, stop: int) -> float:
        """Return the largest length of a finger's mean displacement [m]."""
        mean = self.displacement(first, stop).mean(axis=0).reshape(len(self.fingers), -1)
        return float(np.linalg.norm(mean, axis=1).max())

    def noise(self, first: int, stop: int) -> float:
        """Return the RMS difference of measured and true positions [m]; zero if true positions are not recorded."""
        if "true_position" not in self.recording.layout.columns:
            return 0.0
        off = self._read("finger_position", first, stop) - self._read("true_position", first, stop)
        return float(np.sqrt((off**2).mean()))

    def drive(self) -> Drive:
        """Return the excitation of the object's fingers by their hands, computed from the recorded scene."""
        header = self.recording.header
        centre = self.recording.read(f"objects/{self.name}/position", 0, 1)[0]
        return drive(header.scene_table, self.fingers.tolist(), header.scene_folder, self._position(0, 1)[0], centre)

    def mode(self, swing: NDArray[np.complex128], first: int, stop: int) -> str:
        """Return the name of the mode of an oscillation with amplitudes `swing` (n d,) in a range of rows."""
        layout, table = self.recording.layout, self.recording.header.scene_table
        things = table.get("object") or [{}]
        free = (things[self.number] if self.number < len(things) else {}).get("free")
        width = WIDTHS[layout.dimensions]
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
        is_true = "true_position" in self.recording.layout.columns
        return self._read("true_position" if is_true else "finger_position", first, stop)

    def _read(self, column: str, first: int, stop: int) -> FloatArray:
        values = self.recording.read(column, first, stop)
        return values if len(self.fingers) == values.shape[1] else values[:, self.fingers]  # all in order


def grasps(recording: History) -> Iterator[GraspView]:
    """Yield each object that has fingers, with the rows before the first fault."""
    layout = recording.layout
    rows = min([len(recording), *(recording.header.rows_before(fault.tick) for fault in recording.faults)])
    for number, name in enumerate(layout.objects):
        fingers = np.flatnonzero(np.array(layout.finger_objects) == number)
        if fingers.size and rows:
            yield GraspView(recording, name, number, fingers, rows)


def mode_name(
    swing: NDArray[np.complex128],
    arms: FloatArray,
    free: Sequence[bool],
    touching: NDArray[np.bool_],
    names: Sequence[str],
    gains: tuple[float, float] = (1.0, 1.0),
) -> str:
    """Return the name of the mode with the largest energy of an oscillation.

    The modes are internal, external translation and external rotation. If some fingers do not touch, the name is
    "pushing with" and the names of those that touch. The split into modes is eq. (3) for hard fingers: the external
    part is the free motion of the object that fits the motion of the touching fingers best.

    Args:
        swing: Amplitudes of fingertips relative to their contacts, (n, d).
        arms: Positions of the fingers relative to the object's centre, (n, d) [m].
        free: Mask of the object's free degrees of freedom, (w,).
        touching: Mask of the touching fingers, (n,).
        names: Names of the fingers.
        gains: External and internal stiffness, which weight the energies of the modes.

    Returns:
        Name of the mode as in certificates.
    """
    if not touching.any():
        touching = np.ones_like(touching)
    elif not touching.all():
        return f"pushing with {', '.join(name for name, on in zip(names, touching, strict=True) if on)}"
    n, d = arms.shape
    shifts = np.tile(np.eye(d), (n, 1))[:, np.array(free[:d], dtype=bool)]
    turns = _turns(arms)[:, np.array(free[d:], dtype=bool)]
    x = swing.ravel()
    shift = _fit(shifts, x)
    external = _fit(np.hstack([shifts, turns]), x)
    kep, kip = gains
    energies = {
        "external translation" if d > 1 and turns.shape[1] else "external": kep * _square(shift),
        "external rotation": kep * _square(external - shift),
        "internal": kip * _square(x - external),
    }
    return max(energies, key=lambda name: energies[name])


def _turns(arms: FloatArray) -> FloatArray:
    """Return the fingers' motions for unit rotations of the object about each axis, (n d, 0), (n d, 1) or (n d, 3)."""
    n, d = arms.shape
    if d == 1:
        return np.zeros((n, 0))
    if d == 2:
        return np.stack([-arms[:, 1], arms[:, 0]], axis=1).reshape(n * d, 1)
    return np.stack([np.cross(axis, arms).ravel() for axis in np.eye(3)], axis=1)


def _fit(basis: FloatArray, x: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the linear combination of the basis's columns that is closest to x."""
    if not basis.shape[1]:
        return np.zeros_like(x)
    return np.asarray(basis @ np.linalg.lstsq(basis, x, rcond=None)[0], dtype=np.complex128)


def _square(x: NDArray[np.complex128]) -> float:
    return float((np.abs(x) ** 2).sum())


# Evidence that a stretch of an octave grows by itself: one pole, enough cycles, no alias, no noise, and no hand -----

LEAST_CYCLES = 8.0  # a transient has fewer cycles
LEAST_SHARE = 0.8  # fraction of an interval, after removal of growth, that one oscillation must explain
LEAST_SHARE_OF_TWO = 0.97
INSIDE = 0.4  # fraction of half the sampling rate; an octave begins at 0.5
AGREEMENT = (0.6, 1.6)  # allowed ratios of the pole's rate to the growth of the windows
FAR = 20.0  # difference of log amplitude between the ends of an interval, beyond which a component lies outside
NEW = 1.0  # required excess of log amplitude over all earlier windows
CERTAIN = 4.5  # log amplitude by which noise grows in a mode once in 1e4 independent windows, but not along a line
SMALL = 0.1  # fraction of the displacement at rest, below which a motion is small
FLAGGING = 0.6  # fraction of the first half's rate that the second half must keep; a transient t^k exp(-s t) keeps less
BENDING = 0.6  # largest second difference of the phases of three thirds, zero for a single frequency [rad]
OVER_DRIVE = 30.0  # required ratio to the hands' motion at the pole; a driven resonance stays below
DRIVE_SAMPLES = 2048


def coherent_pole(octave: Octave, stretch: Stretch) -> complex | None:
    """Return the pole of an interval; None if no single oscillation grows there for at least LEAST_CYCLES cycles.

    If one oscillation does not explain the interval, two oscillations may explain it. A pole is then returned only if
    the growing oscillation has the larger amplitude at the end of the interval.
    """
    y = octave.windows(stretch.first, stretch.length)
    growth = stretch.growth / len(y)
    for rank, least in ((2, LEAST_SHARE), (4, LEAST_SHARE_OF_TWO)):
        z_i, share = poles(y, growth, rank)
        upper = [complex(z) for z in z_i if z.imag > 0.0]
        if not upper and octave.is_highest:  # an alternating motion has a real pole
            upper = [complex(z_i[np.argmax(np.abs(z_i))])]
        # a component that is much larger or smaller at one end is outside the interval
        upper = [z for z in upper if abs(math.log(max(abs(z), TINY)) - growth) * len(y) < FAR]
        growing = [z for z in upper if _grows(z, growth, len(y))]
        if share >= least and growing:
            z = growing[0]
            sizes = [_size_at_end(y, each, [other for other in upper if other != each]) for each in upper]
            if len(upper) == 1 or upper[int(np.argmax(sizes))] == z:
                return z
    return None


def _size_at_end(y: FloatArray, z: complex, others: list[complex]) -> float:
    """Return the log amplitude of the oscillation with the pole z at the end of the interval y."""
    size = float(np.abs(amplitudes(y, z, others)).max())
    return math.log(max(size, TINY)) + math.log(max(abs(z), TINY)) * len(y)


def _grows(z: complex, growth: float, count: int) -> bool:
    """Return whether a pole is in the octave, makes enough cycles in `count` samples, and grows like the windows."""
    turn = abs(float(np.angle(z)))
    low, high = AGREEMENT
    agrees = low * growth < math.log(max(abs(z), TINY)) < high * growth
    return agrees and turn > INSIDE * math.pi and turn * count / (2.0 * math.pi) >= LEAST_CYCLES


def is_steady(octave: Octave, logs: FloatArray, stretch: Stretch, z: complex) -> bool:
    """Return whether growth has a constant rate and frequency in an interval.

    The growth of a transient t^k exp(-s t) slows down. The frequency of a chirp that passes through a resonance
    changes.
    """
    if stretch.growth > 2.0 * CERTAIN:  # a chirp passes a resonance faster, and two growing modes may beat
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
    """Return whether growth in an octave is an alias of a motion in the octave above.

    A motion at half the sampling rate of an octave has twice the amplitude there that it has in the octave above. The
    amplitude of an alias is as large in the octave above.
    """
    end = octave.time(stretch.first + stretch.length)
    return 2.0 * above.size_before(end) > octave.size_before(end)


def stands_out(logs: FloatArray, stretch: Stretch) -> bool:
    """Return whether growth ends above all earlier amplitudes, or exceeds the growth that noise can cause in a mode.

    Noise makes the amplitude of a lightly damped mode fluctuate. When this amplitude has been near zero, it grows along
    any curve with constant phase, but not above its earlier values.
    """
    before = float(logs[: stretch.first].max(initial=-math.inf))
    end = float(logs[stretch.first + stretch.length - 1])
    return stretch.growth > CERTAIN or end > before + NEW


def stops(grasp: GraspView, logs: FloatArray, stretch: Stretch, end_time: float, size: float) -> bool:
    """Return whether a motion stops after little growth although no contact changes.

    The motion has stopped if it remains small, as noise does, or if it decays, as a transient does.

    Args:
        grasp: Grasp that moves.
        logs, stretch: Log amplitudes of all windows, and the windows with growth.
        end_time: Time at the end of `stretch` [s].
        size: Amplitude of the motion at `end_time` [m].
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


def calms(grasp: GraspView, ring: Ringing, size: float) -> bool:
    """Return whether the fingers move less, after an oscillation, in a contact that lasts as long as the oscillation.

    Args:
        grasp: Grasp that moves.
        ring: Observed oscillation.
        size: Amplitude of the oscillation [m].
    """
    on = grasp.recording.touching[ring.stop : grasp.rows, grasp.fingers]
    changes = np.flatnonzero((on[1:] != on[:-1]).any(axis=1))
    held = on[changes[-1] + 1 :] if len(changes) else on
    if len(held) < ring.stop - ring.first or not held.any():
        return False
    late = grasp.displacement(grasp.rows - len(held) // 2, grasp.rows)
    return math.sqrt(2.0) * float(late.std(axis=0).max()) < STEADY * size


def is_driven(octave: Octave, stretch: Stretch, z: complex, hands: Drive) -> bool:
    """Return whether the intended motion of the hands could cause the growth in an interval with the pole z."""
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
