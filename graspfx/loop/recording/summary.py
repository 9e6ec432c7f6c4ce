"""A run in numbers: how far the fingers go in, how well the object follows, what shakes, and what it cost."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.loop.recording.history import History
from graspfx.loop.recording.tally import Ledger, books_of
from graspfx.loop.recording.tally_program import (
    DEPTHS,
    DISTANCES,
    LARGEST,
    LAWS,
    LENGTHS,
    MOMENTS,
    PLACES,
    SHARES,
    Measure,
    Measures,
)
from graspfx.loop.recording.two_parts import RowSplit, force_places, splits_of, wide_width
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
            |f| r (`tally_program.measure_moments`); None where the reaction is at the contacts or nothing turns.
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
        engine: what ran the ticks, "compiled" or "interpreted", or what an earlier version said; None if not known.
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
        self.recording, self.n, self.d = recording, len(layout.fingers), layout.dimensions
        self.divided = bool(recording.header.split) and bool(layout.forces) and self.has("touching", "finger_force")
        self.splits = splits_of(recording.header, recording.outcome.changes) if self.divided else []
        self.places = force_places(layout) if self.divided else {}
        self.turning = self.has("finger_position")
        self.ledgers = {name: Ledger() for name in layout.objects}
        self.energy: FloatArray | None = None
        self.shaking = Vibration(recording.row_period, len(recording))
        self.signals: dict[str, list[slice]] = {}
        self.measures = Measures(len(recording))
        self._room = np.empty((0, 0))
        self._choose_measures()
        self._choose_signals()
        self._whole = [*self.measures]

    def has(self, *columns: str) -> bool:
        """Tell whether the recording has all of these columns."""
        return all(column in self.recording.layout.columns for column in columns)

    def _at(self, column: str) -> int:
        """Find the entry of a column in a row; -1 if it is not there."""
        columns = self.recording.layout.columns
        return columns[column].where.start if column in columns else -1

    def _choose_measures(self) -> None:
        add, layout, n, d = self.measures.add, self.recording.layout, self.n, self.d
        position, contact, touching = (self._at(k) for k in ("finger_position", "contact_position", "touching"))
        for name in ("touching", "saturated"):
            if self.has(name):
                add(name, Measure(SHARES, self._at(name), n))
        for k, name in enumerate(layout.objects):
            fingers = [i for i, owner in enumerate(layout.finger_objects) if owner == k]
            if position >= 0 and fingers:
                squeezed = self.has("contact_position", "touching")
                add(f"places of {name}", Measure(
                    PLACES, position, len(fingers), d, touching if squeezed else -1, contact if squeezed else -1,
                    self._at(f"objects/{name}/position"), fingers,
                ))  # fmt: skip
            for kind, column in ((LAWS, "law"), (LARGEST, "residual")):
                if self.has(f"objects/{name}/{column}"):
                    add(f"{column} of {name}", Measure(kind, self._at(f"objects/{name}/{column}")))
        if n == 2 and position >= 0:
            add("apart", Measure(DISTANCES, position, n, d))
        if self.has("gap", "touching"):
            add("depth", Measure(DEPTHS, self._at("gap"), n, mask=touching))
        for name in ("finger_force", "displayed_force"):
            if self.has("finger_force", name):
                add(name, Measure(LENGTHS, self._at(name), n, d))
        if self.divided:
            for name in FORCES:
                add(name, Measure(LENGTHS, self.places[name].start, n, d, touching))

    def _choose_signals(self) -> None:
        layout = self.recording.layout
        tips = "true_position" if layout.simulated else "finger_position"
        columns = layout.columns
        if self.has("finger_force"):
            self.signals["force_vibration"] = [columns["finger_force"].where]
        if self.divided:
            self.signals |= {f"{name}_vibration": [self.places[name]] for name in FORCES}
        if self.has(tips):
            self.signals["finger_vibration"] = [columns[tips].where]
        places = [f"objects/{name}/position" for name in layout.objects]
        if self.has(*places):
            self.signals["object_vibration"] = [columns[place].where for place in places]

    def add(self, part: History) -> None:
        """Add a block of rows, in memory."""
        count, layout = len(part), part.layout
        if not count:
            return
        width = wide_width(layout, part.header) if self.divided else layout.width
        if len(self._room) < count:
            self._room = np.empty((count, width))
        rows = self._room[:count]  # which programs may write, unlike those of a recording
        pieces = dict.fromkeys(self._whole, slice(0, count))
        if self.divided:
            split = RowSplit(part.rows, layout, self.splits, part.start)
            split.widened(rows)
            pieces |= self._moments(split)
        else:
            rows[:] = part.rows
        self.measures.take(rows, pieces)
        for name in layout.objects:
            at = f"objects/{name}/energy/"
            books = [column for column in layout.columns if column.startswith(at)]
            self.ledgers[name].add((each.rpartition("/")[2], part.array(each)) for each in books)
        if self.has("device_energy"):
            self.energy = rows[-1, layout.columns["device_energy"].where].copy()
        if self.signals:
            self.shaking.add(rows, [where for each in self.signals.values() for where in each])

    def _moments(self, split: RowSplit) -> dict[str, slice]:
        """List the rows of which the moments of internal forces are measured, adding those measures that are not there.

        The fingers act on the object at their tips, so that internal forces, which have no moment about the contact
        points, turn it by that moment; not where the reaction is at the contact points, nor where nothing turns.
        """
        pieces = {}
        for rows, rule, fingers, key in split.grasps():
            if not self.turning or rule.reaction == "contact" or not any(rule.rotations):
                continue
            name = f"moments of {key}"
            if name not in self.measures:
                at, contact = self._at("finger_position"), self._at("contact_position")
                some = [*map(float, fingers), *map(float, rule.rotations)]
                force = self.places["internal_force"].start
                self.measures.add(name, Measure(MOMENTS, at, len(fingers), self.d, -1, contact, force, some))
            pieces[name] = rows
        return pieces

    def result(self, growth: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        """Give the summary."""
        recording, n = self.recording, self.n
        outcome, ticks, wall_time = recording.outcome, recording.ticks, recording.wall_time
        timed = wall_time is not None and wall_time > 0.0 and ticks > 0
        energy, names = self.energy, recording.layout.objects
        squeeze = self._over_objects("places of {}")
        deformed = self.has("finger_position", "contact_position", "touching")
        depth = self.measures.get("depth")
        apart = self.measures.get("apart", [0.0] * 3)
        lawful = [name for name in names if f"law of {name}" in self.measures]
        residuals = self._over_objects("residual of {}")
        displayed = "displayed_force" if "displayed_force" in self.measures else "finger_force"
        centred = sum(1 for name in names if f"places of {name}" in self.measures and self._is_placed(name))
        return {
            "ticks": ticks,
            "period": float(recording.period),
            "duration": float(ticks * recording.period),
            "touching": self._shares("touching"),
            "internal_deformation_mean": _mean(sum(each[1] for each in squeeze), sum(each[2] for each in squeeze))
            or 0.0
            if deformed
            else None,
            "internal_deformation_peak": _peak(each[0] for each in squeeze) or 0.0 if deformed else None,
            "invasion_mean": None if depth is None else _mean(depth[2], depth[1]) or 0.0,
            "invasion_peak": None if depth is None else _peak(depth[:1]) or 0.0,
            "finger_distance_mean": _mean(apart[2], apart[1]),
            "finger_distance_least": -apart[0] if apart[1] else None,
            "tracking_error": _rms(sum(each[3] for each in squeeze), len(recording) * centred),
            "peak_force": self._peaks("finger_force"),
            "peak_displayed_force": self._peaks(displayed),
            "saturated": self._shares("saturated"),
            "force_vibration": self._vibration("force_vibration"),
            **self._two_forces("internal_force"),
            **self._two_forces("external_force"),
            "internal_moment": self._moment(),
            "finger_vibration": self._vibration("finger_vibration"),
            "object_vibration": self._vibration("object_vibration"),
            "port_energy": [None if energy is None else float(energy[i]) for i in range(n)],
            "fade_shortfall": outcome.fade_shortfall or None,
            "blended": outcome.blended / ticks if outcome.blended and ticks else None,
            "associated": _mean(
                sum(self.measures[f"law of {name}"][0] for name in lawful), len(recording) * len(lawful)
            ),
            "friction_residual": _peak(each[0] for each in residuals),
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

    def _over_objects(self, name: str) -> list[list[float]]:
        """List the results of a measure that each object has."""
        names = [name.format(each) for each in self.recording.layout.objects]
        return [self.measures[each] for each in names if each in self.measures]

    def _is_placed(self, name: str) -> bool:
        return self.has(f"objects/{name}/position")

    def _shares(self, name: str) -> list[float | None] | None:
        return [_mean(each, len(self.recording)) for each in self.measures[name]] if name in self.measures else None

    def _peaks(self, name: str) -> list[float | None] | None:
        return [_peak([each]) for each in self.measures[name][: self.n]] if name in self.measures else None

    def _two_forces(self, name: str) -> dict[str, Any]:
        results = self.measures[name] if self.divided else [0.0, 0.0]
        return {
            f"{name}_peak": self._peaks(name),
            f"{name}_mean": _mean(results[-2], results[-1]),
            f"{name}_vibration": self._vibration(f"{name}_vibration"),
        }

    def _vibration(self, name: str) -> float | None:
        squares = self.mean_squares
        if squares is None or name not in self.signals:
            return None
        start = 0
        for each, places in self.signals.items():
            width = sum(where.stop - where.start for where in places)
            if each == name:
                return float(np.sqrt(squares[start : start + width].sum() / (width // self.d)))
            start += width
        return None

    @property
    def mean_squares(self) -> FloatArray | None:
        """Mean squares of the signals."""
        return self.shaking.mean_squares()

    def _moment(self) -> float | None:
        both = [self.measures[name] for name in self.measures if name.startswith("moments of ")]
        return max((moment / whole for moment, whole in both if whole > 0.0), default=None)

    def _recorded(self) -> str | None:
        layout, every = self.recording.layout, self.recording.header.every
        texts = [f"peaks, means and energies are of the rows recorded, one in {every} ticks"] if every > 1 else []
        if layout.omitted:
            texts.append(f"not recorded, nor what follows from it: {', '.join(layout.omitted)}")
        return "; ".join(texts) or None


def _mean(total: float, count: float) -> float | None:
    return total / count if count else None


def _rms(squares: float, count: float) -> float | None:
    return float(np.sqrt(squares / count)) if count else None


def _peak(values: Iterable[float]) -> float | None:
    """Find the largest of some peaks; those below zero are of nothing."""
    peaks = [value for value in values if not value < 0.0]
    return float(np.max(peaks)) if peaks else None
