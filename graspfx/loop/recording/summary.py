"""A run in numbers: how far the fingers go in, how well the object follows, what shakes, and what it cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.recording.history import History
from graspfx.loop.recording.tally import Ledger, Mean, Parts, Peaks, books_of, lengths
from graspfx.loop.recording.tally_program import Measures
from graspfx.loop.recording.vibration import Vibration

FloatArray = NDArray[np.float64]

MICROSECONDS = 1e6
FORCES = ("internal_force", "external_force")


def summarise(recording: History, growth: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Summarise a run in SI units, in one pass over its rows; a value is None where this run does not have it.

    Keys:
        ticks, period, duration: N, T [s], N T [s].
        touching: per finger, the share of ticks in which it touches.
        internal_deformation_mean, internal_deformation_peak: how far touching fingers squeeze in against each
            other, sqrt(mean |e - mean e|^2), e = p - c: (I - P) e with the object's rotation locked, eq. (3), so that
            moving the whole hand against the object does not count [m].
        invasion_mean, invasion_peak: depth of touching fingers in the object, along its normal [m]; None if attached.
        finger_distance_mean, finger_distance_least: between two fingers [m]; None for another number of them.
        tracking_error: RMS distance between an object's centre and the centre of its fingers [m].
        peak_force: per finger [N].
        peak_displayed_force: per finger, of the force on the operator [N]; None if not given.
        saturated: per finger, the share of ticks in which its force stands at its limit; None without limits.
        force_vibration: RMS over fingers and ticks of what is above 5 Hz in a finger's force [N].
        internal_force_peak, external_force_peak: per finger, the largest while it touches [N].
        internal_force_mean, external_force_mean: of the length, over fingers and ticks in which they touch [N].
        internal_force_vibration, external_force_vibration: as `force_vibration` [N]; all of these None for a recording
            of an earlier format, which does not say how its forces divide.
        internal_moment: moment sum e_i x f_i of the internal forces f at the fingertips, the largest over the largest
            |f| r (`two_parts.RowSplit.moments`); None where the reaction is at the contacts or nothing turns.
        finger_vibration: RMS over fingers and ticks of what is above 5 Hz in a fingertip's position, true if known [m].
        object_vibration: RMS over objects and ticks of what is above 5 Hz in an object's position [m].
        port_energy: per finger, work done on the fingertip through its device in all [J].
        fade_shortfall: by how much `coupling.fade` began too near for the forces, at most [m]; None if it did not.
        blended: share of samples in which a rotation of a grasp was in the band of `coupling.blend`, where forces are
            not those of eq. (4); None if none was.
        associated: share of samples in which an object's forces satisfy the associated law instead of Coulomb's; None
            without a coefficient of friction.
        friction_residual: the largest of either law [N]; None without a coefficient.
        leak: by mode, the most energy that was made beyond what frictions had taken, the largest of any object [J].
        braking: by mode, the largest damping that control added [N s/m]; None without control.
        braked: by mode, what that took in all [J]; None without control.
        ledger_gap: the largest gap of an object's ledger over its largest entry; these four None unless observed.
        growth: a table for each object whose grasp is seen to lose stability, empty without: `object`, `mode` as
            certificates name it, `rate` of log amplitude [1/s], `frequency` [Hz], `begin` and `end` of where it is seen
            [s], `first` and `last` amplitude of a fingertip against the object then [m], `sustained` if it goes on at
            that size, `certificate` (its `spectral_radius`, `gain` and `limit` [N/m] and `text`; None for a
            recording without its scene) and `text`, all in a sentence.
        wall_time, ticks_per_second, tick_cost: of the computation [s, 1/s, microseconds].
        engine: what ran the ticks, "generic", "compiled" or "interpreted", or since when; None if not known.
        faults: how many.
        changes: how many values of keys were replaced in mid-run; None if none was.
        recorded: what the rest is of, where a recording has not every number of every tick, in a sentence; else None.

    Args:
        recording: in memory or on a disk.
        growth: as in the result.
    """
    tally = Tally(recording)
    for part in recording.parts():
        tally.add(part)
    return tally.result(growth)


class Tally:
    """The sums and peaks of a recording's blocks.

    Args:
        recording: the whole.
    """

    def __init__(self, recording: History) -> None:
        layout = recording.layout
        self.recording, self.n = recording, len(layout.fingers)
        self.groups = [
            (name, [i for i, owner in enumerate(layout.finger_objects) if owner == k])
            for k, name in enumerate(layout.objects)
        ]
        self.touching = [Mean() for _ in range(self.n)]
        self.saturated = [Mean() for _ in range(self.n)]
        self.deformation, self.depth, self.apart, self.error, self.associated = (Mean() for _ in range(5))
        self.deepest, self.force, self.displayed = Peaks(2), Peaks(self.n), Peaks(self.n)
        self.least_apart = np.inf
        self.residual = Peaks(1)
        self.parts = {name: Parts(Peaks(self.n), Mean()) for name in FORCES}
        self.moments: dict[tuple[int, int], tuple[float, float]] = {}
        self.ledgers = {name: Ledger() for name in layout.objects}
        self.energy: FloatArray | None = None
        self.shaking = Vibration(recording.row_period, len(recording))
        self.signals: dict[str, slice] = {}
        self.measures = Measures(len(recording))

    def has(self, *columns: str) -> bool:
        """Tell whether the recording has all of these columns."""
        return all(column in self.recording.layout.columns for column in columns)

    def add(self, part: History) -> None:
        """Add a block of rows, in memory."""
        layout, signals = part.layout, list[tuple[str, FloatArray]]()
        touching = part.touching if self.has("touching") else np.zeros((len(part), self.n), dtype=bool)
        if self.has("touching"):
            for i in range(self.n):
                self.touching[i].add(touching[:, i])
        if self.has("saturated") and (saturated := part.saturated) is not None:
            for i in range(self.n):
                self.saturated[i].add(saturated[:, i])
        rows = np.array(part.rows)  # which programs take only where they could write
        if self.has("finger_position"):
            self._add_places(part, rows)
        if self.has("gap", "touching"):
            depth = np.maximum(-part.read("gap", 0, len(part)), 0.0)[touching]
            self.depth.add(depth)
            self.deepest.add(1, depth)
        if self.has("finger_force"):
            self._add_forces(part, rows, touching, signals)
        tips = "true_position" if layout.simulated else "finger_position"
        if self.has(tips):
            signals.append(("finger_vibration", part.array(tips)))
        places = [f"objects/{name}/position" for name in layout.objects]
        if self.has(*places):
            signals.append(("object_vibration", np.stack([part.array(place) for place in places], axis=1)))
        for name in layout.objects:
            at = f"objects/{name}/"
            if self.has(at + "law"):
                self.associated.add(part.array(at + "law") == 1.0)
            if self.has(at + "residual"):
                self.residual.add(0, part.array(at + "residual"))
            books = [column for column in layout.columns if column.startswith(at + "energy/")]
            self.ledgers[name].add((each.rpartition("/")[2], part.array(each)) for each in books)
        if self.has("device_energy") and len(part):
            self.energy = part.array("device_energy")[-1].copy()
        self._add_signals(signals)

    def _add_places(self, part: History, rows: FloatArray) -> None:
        p, at, d = part.finger_position, part.layout.columns, part.layout.dimensions
        squeezes = self.has("contact_position", "touching")
        touching, contact = (at[k].where.start if squeezes else -1 for k in ("touching", "contact_position"))
        for name, fingers in self.groups:
            place = f"objects/{name}/position"
            centre = at[place].where.start if fingers and self.has(place) else -1
            start = at["finger_position"].where.start
            peak, total, count, squares = self.measures.places(rows, fingers, d, start, touching, contact, centre)
            self.deformation.add_sum(total, count)
            self.deepest.add_peak(0, peak)
            if centre >= 0:
                self.error.add_squares(squares, len(part))
        if self.n == 2:
            apart = lengths(p[:, 1] - p[:, 0])
            self.apart.add(apart)
            self.least_apart = min(self.least_apart, float(apart.min(initial=np.inf)))

    def _add_forces(
        self, part: History, rows: FloatArray, touching: NDArray[np.bool_], signals: list[tuple[str, FloatArray]]
    ) -> None:  # fmt: skip
        force, at = part.finger_force, part.layout.columns
        displayed = "displayed_force" if self.has("displayed_force") else "finger_force"
        for peaks, name in ((self.force, "finger_force"), (self.displayed, displayed)):
            largest, _, _ = self.measures.lengths(rows, at[name].where.start, self.n, part.layout.dimensions)
            for i in range(self.n):
                peaks.add_peak(i, largest[i])
        signals.append(("force_vibration", force))
        if not part.header.split or not part.layout.forces or not self.has("touching"):
            return
        both = {"internal_force": part.internal_force, "external_force": part.external_force}
        for name, values in both.items():
            self.parts[name].add(self.measures, values, touching)
            signals.append((f"{name}_vibration", values))
        if self.has("finger_position"):
            for key, moment, whole in part._row_split.moments(both["internal_force"]):
                before = self.moments.get(key, (0.0, 0.0))
                self.moments[key] = max(before[0], moment), max(before[1], whole)

    def _add_signals(self, signals: list[tuple[str, FloatArray]]) -> None:
        if not signals or not self.shaking.is_long:
            return
        if not self.signals:
            start = 0
            for name, values in signals:
                width = int(np.prod(values.shape[1:]))
                self.signals[name] = slice(start, start + width)
                start += width
        self.shaking.add(np.concatenate([values.reshape(len(values), -1) for _, values in signals], axis=1))

    def result(self, growth: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        """Give the summary."""
        recording, n = self.recording, self.n
        outcome, ticks, wall_time = recording.outcome, recording.ticks, recording.wall_time
        timed = wall_time is not None and wall_time > 0.0 and ticks > 0
        touching = self.has("touching")
        divided = bool(recording.header.split) and bool(recording.layout.forces) and touching
        deformed = self.has("finger_position", "contact_position", "touching")
        deep, energy = self.has("gap", "touching"), self.energy
        friction = any(self.has(f"objects/{name}/law") for name in recording.layout.objects)
        residual = any(self.has(f"objects/{name}/residual") for name in recording.layout.objects)
        return {
            "ticks": ticks,
            "period": float(recording.period),
            "duration": float(ticks * recording.period),
            "touching": [each.mean for each in self.touching] if touching else None,
            "internal_deformation_mean": self.deformation.mean or 0.0 if deformed else None,
            "internal_deformation_peak": self.deepest.values[0] or 0.0 if deformed else None,
            "invasion_mean": self.depth.mean or 0.0 if deep else None,
            "invasion_peak": self.deepest.values[1] or 0.0 if deep else None,
            "finger_distance_mean": self.apart.mean,
            "finger_distance_least": float(self.least_apart) if self.apart.count else None,
            "tracking_error": self.error.rms,
            "peak_force": self.force.values if self.has("finger_force") else None,
            "peak_displayed_force": self.displayed.values if self.has("finger_force") else None,
            "saturated": [each.mean for each in self.saturated] if self.has("saturated") else None,
            "force_vibration": self._vibration("force_vibration"),
            **self._two_forces("internal_force", divided=divided),
            **self._two_forces("external_force", divided=divided),
            "internal_moment": self._moment() if divided else None,
            "finger_vibration": self._vibration("finger_vibration"),
            "object_vibration": self._vibration("object_vibration"),
            "port_energy": [None if energy is None else float(energy[i]) for i in range(n)],
            "fade_shortfall": outcome.fade_shortfall or None,
            "blended": outcome.blended / ticks if outcome.blended and ticks else None,
            "associated": self.associated.mean if friction else None,
            "friction_residual": self.residual.values[0] if residual else None,
            **dict(books_of(list(self.ledgers.values()))),
            "growth": [dict(each) for each in growth],
            "wall_time": wall_time,
            "engine": outcome.engine or None,
            "ticks_per_second": ticks / wall_time if timed and wall_time else None,
            "tick_cost": wall_time / ticks * MICROSECONDS if timed and wall_time else None,
            "faults": len(recording.faults),
            "changes": len(recording.changes) or None,
            "recorded": self._recorded(),
        }

    def _two_forces(self, name: str, *, divided: bool) -> dict[str, Any]:
        if not divided:
            return dict.fromkeys((f"{name}_peak", f"{name}_mean", f"{name}_vibration"))
        parts = self.parts[name]
        return {
            f"{name}_peak": parts.peaks.values,
            f"{name}_mean": parts.mean.mean,
            f"{name}_vibration": self._vibration(f"{name}_vibration"),
        }

    def _vibration(self, name: str) -> float | None:
        squares = self.mean_squares
        if squares is None or name not in self.signals:
            return None
        where = self.signals[name]
        d = self.recording.layout.dimensions
        return float(np.sqrt(squares[where].sum() / ((where.stop - where.start) // d)))

    @property
    def mean_squares(self) -> FloatArray | None:
        """Mean squares of the signals."""
        return self.shaking.mean_squares()

    def _moment(self) -> float | None:
        shares = [moment / whole for moment, whole in self.moments.values() if whole > 0.0]
        return max(shares, default=None)

    def _recorded(self) -> str | None:
        layout, every = self.recording.layout, self.recording.header.every
        texts = [f"peaks, means and energies are of the rows recorded, one in {every} ticks"] if every > 1 else []
        if layout.omitted:
            texts.append(f"not recorded, nor what follows from it: {', '.join(layout.omitted)}")
        return "; ".join(texts) or None
