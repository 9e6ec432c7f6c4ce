"""Summary of a run: penetration depth, tracking error, vibration, energies and computing time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.recording.history import History
from graspfx.recording.recorded_split import GraspRows, RowSplit, coefficients, splits_of
from graspfx.recording.vibration import Vibration

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

MICROSECONDS = 1e6
HALVES = ("internal_force", "external_force")


def summarise(recording: History, growth: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return a summary of a run in SI units, computed in one pass over its rows; None if a value does not apply.

    Keys:
        ticks, period, duration: Number of ticks N, sampling period T [s], duration N T [s].
        touching: Fraction of ticks in which each finger touches.
        internal_deformation_mean, internal_deformation_peak: Mean and peak over ticks of the squeeze of the touching
            fingers: RMS over the fingers of e - mean e [m], where e is the vector from a finger's contact to its
            fingertip. With equal weights and a locked rotation of the object, e - mean e is (I - P) e of eq. (3).
        invasion_mean, invasion_peak: Mean and peak penetration depth of touching fingers along the normal [m]; None for
            attached fingers.
        finger_distance_mean, finger_distance_least: Mean and smallest distance of two fingers [m]; None unless there
            are two fingers.
        tracking_error: RMS distance of an object's centre from the mean position of its fingers [m].
        peak_force: Peak force of each finger [N].
        peak_displayed_force: Peak force on each finger's operator [N]; None if not recorded.
        saturated: Fraction of ticks in which each finger's force is at its limit; None without limits.
        force_vibration: RMS over fingers and ticks of the part above 5 Hz of a finger's force [N].
        internal_force_peak, external_force_peak: Peak magnitude of the internal or external force of each finger while
            the finger touches [N].
        internal_force_mean, external_force_mean: Mean magnitude over fingers and ticks with contact [N].
        internal_force_vibration, external_force_vibration: RMS of the part above 5 Hz, as in `force_vibration` [N]. All
            six values of internal and external forces are None for a recording of an early format without split rule.
        internal_moment: Peak moment of the internal forces about the object, which act at the fingertips, relative to
            the peak of |f| r. Here f are the internal forces, and r is the RMS distance of the contacts from their
            mean. None if forces react at the contacts, or if no object can rotate.
        finger_vibration: RMS over fingers and ticks of the part above 5 Hz of a fingertip's position [m]; of its true
            position if known.
        object_vibration: RMS over objects and ticks of the part above 5 Hz of an object's position [m].
        port_energy: Work that each finger's device has done on the fingertip in the run [J].
        fade_shortfall: Largest distance by which the fade of `coupling.fade` began too close to the surface [m]; None
            if the fade never began too close.
        blended: Fraction of samples in which a rotation of a grasp was in the band of `coupling.blend`, where the
            forces are not those of eq. (4); None if there are no such samples.
        associated: Fraction of samples in which an object's forces satisfy the associated friction law instead of
            Coulomb's law; None without a coefficient of friction.
        friction_residual: Largest residual of the friction law that was used [N]; None without a coefficient of
            friction.
        grip_margin: Smallest friction margin mu f_n - |f_t| of the touching fingers that have a coefficient of friction
            mu [N], where f_n and f_t are the normal and tangential force; None if no such finger touched.
        friction_needed: Largest |f_t| / f_n of these fingers, which is the coefficient that the recorded forces need.
        leak: Largest energy that was generated in each mode beyond the dissipation of friction, as the maximum over
            objects [J].
        braking: Largest damping that the passivity controller added to each mode [N s/m]; None without a controller.
        braked: Energy that the passivity controller dissipated in each mode [J]; None without a controller.
        ledger_gap: Largest gap in the balance of an object's energy ledger, relative to the ledger's largest entry.
            `leak`, `braking`, `braked` and `ledger_gap` are None unless energies are observed.
        growth: Table for each object with a detected instability; empty without one. Its keys are `object`; `mode`, as
            named in certificates; `rate` of the log amplitude [1/s]; `frequency` [Hz]; `begin` and `end` of the
            interval [s]; `first` and `last`, the amplitudes of a fingertip relative to the object [m]; `sustained`,
            whether the motion continues at the amplitude `last`; `certificate`, with `spectral_radius`, `gain` and
            `limit` [N/m] and `text` (None if the recording has no scene); and `text`, a sentence.
        wall_time, ticks_per_second, tick_cost: Duration of the computation [s], ticks per second [1/s], duration of a
            tick [microseconds].
        engine: Engine of the ticks, "compiled" or "interpreted", or the name that an earlier version used; None if
            unknown.
        faults: Number of faults.
        changes: Number of values that were replaced during the run; None if no value was replaced.
        recorded: Sentence that says which columns or ticks are not recorded; None if all are recorded.

    Args:
        recording: Recording, in memory or on disk.
        growth: Tables for the key `growth`.
    """
    tally = Tally(recording)
    for part in recording.parts():
        rows = part.store if part.store.by_column else part.rows
        tally.add(RowSplit(rows, part.layout, tally.splits or [(0, {})], part.start, tally.friction))
    return tally.result(growth)


class Sizes:
    """Peak of each of several quantities, and their common sum and count. NaN gives NaN results.

    Args:
        count: Number of quantities.
    """

    def __init__(self, count: int = 1) -> None:
        self.largest, self._sums, self.count = np.full(count, -math.inf), list[float](), 0

    def add(self, sizes: FloatArray, where: BoolArray | None = None) -> None:
        """Add sizes (quantities, r), or only those where the mask `where` is True."""
        if not sizes.size:
            return
        some = None if where is None or where.all() else where  # a selection of all would only be copied
        self.count += sizes.size if some is None else int(some.sum())
        peaks, terms = (sizes if some is None else np.where(some, sizes, nothing) for nothing in (-math.inf, 0.0))
        self.largest = np.maximum(self.largest, peaks.max(axis=1))
        self._sums.append(float(terms.sum()))

    @property
    def mean(self) -> float | None:
        """Mean of all sizes; None if no size was added."""
        return _sum(self._sums) / self.count if self.count else None

    @property
    def peaks(self) -> list[float | None]:
        """Largest size of each quantity; None if no size was added."""
        return [None if value == -math.inf else float(value) for value in self.largest]

    @property
    def peak(self) -> float | None:
        """Largest size of all quantities; None if no size was added."""
        return _largest(self.peaks)


class Ledger:
    """Peaks and final values of the energy ledger of one object."""

    def __init__(self) -> None:
        self.leak: FloatArray | None = None
        self.braking: FloatArray | None = None
        self.braked: FloatArray | None = None
        self.gap = self.largest = 0.0

    def add(self, name: str, values: FloatArray) -> None:
        """Add values (..., r) of the ledger's quantity `name`."""
        if name == "balance":
            self.leak = _larger(self.leak, np.maximum(-values, 0.0).max(axis=-1))
        if name == "damping":
            self.braking = _larger(self.braking, values.max(axis=-1))
            return
        if name == "braked":
            self.braked = values[..., -1].copy()
        size = float(np.abs(values).max())
        if name == "gap":
            self.gap = max(self.gap, size)
        else:
            self.largest = max(self.largest, size)


class Tally:
    """Sums and peaks over the rows of a recording, from which its summary is computed.

    Args:
        recording: Complete recording.
    """

    def __init__(self, recording: History) -> None:
        layout = recording.layout
        self.recording, self.layout = recording, layout
        self.divided = bool(recording.header.split) and bool(layout.forces) and self.has("touching", "finger_force")
        self.splits = splits_of(recording.header, recording.outcome.changes) if self.divided else []
        n, self.rows = len(layout.fingers), 0
        self.on, self.limited = np.zeros(n), np.zeros(n)
        self.lawful = 0
        self.friction = coefficients(recording.header, recording.outcome.changes, n)
        self.grip_margin, self.friction_needed = math.inf, 0.0
        self.squeeze, self.depth, self.apart, self.residual = Sizes(), Sizes(n), Sizes(), Sizes(len(layout.objects))
        self.least_apart = math.inf
        self.forces = {name: Sizes(n) for name in ("finger_force", "displayed_force", *HALVES)}
        self.off, self.off_count = list[float](), 0  # squared distances of objects from their fingers' centre
        self.moments: dict[tuple[int, int], tuple[Sizes, Sizes]] = {}
        self.ledgers = {name: Ledger() for name in layout.objects}
        self.energy: FloatArray | None = None
        self.signals: dict[str, int] = {}  # number of components of each signal
        sums = slice(0, n * layout.dimensions), slice(n * layout.dimensions, 2 * n * layout.dimensions)
        self.shaking = Vibration(recording.row_period, len(recording), sums=sums if self.divided else None)

    def has(self, *columns: str) -> bool:
        """Return whether the recording has all of these columns."""
        return all(column in self.layout.columns for column in columns)

    def add(self, block: RowSplit) -> None:
        """Add the rows of a block to the sums and peaks."""
        self.rows += len(block)
        on = np.not_equal(block.column("touching"), 0.0) if self.has("touching") else None
        if on is not None:
            self.on += on.sum(axis=1)
        if self.has("saturated"):
            self.limited += np.not_equal(block.column("saturated"), 0.0).sum(axis=1)
        parts: dict[str, FloatArray] = {}
        if self.divided:
            external, _ = block.external_forces()
            parts = {"internal_force": block.column("finger_force") - external, "external_force": external}
        if on is not None and self.has("contact_normal", "finger_force"):
            margin, needed = block.grip()
            self.grip_margin = float(np.fmin.reduce(margin, initial=self.grip_margin))
            self.friction_needed = max(self.friction_needed, float(needed.max(initial=0.0)))
        self._add_places(block, on)
        self._add_objects(block)
        for name in ("finger_force", "displayed_force"):
            if self.has("finger_force", name):
                self.forces[name].add(_length(block.column(name)))
        for name, values in parts.items():
            self.forces[name].add(_length(values), on)
        if parts and self.has("finger_position"):
            for grasp in block.grasps():
                self._add_moments(block, grasp, parts["internal_force"])
        self._add_signals(block, parts)

    def _add_places(self, block: RowSplit, on: BoolArray | None) -> None:
        """Add penetration depths, distances, and the squeeze of the touching fingers, sqrt(mean |e - mean e|^2)."""
        if on is not None and self.has("gap"):
            self.depth.add(np.maximum(-block.column("gap"), 0.0), on)
        if not self.has("finger_position"):
            return
        p = block.column("finger_position")
        for k, name in enumerate(self.layout.objects):
            fingers = [i for i, owner in enumerate(self.layout.finger_objects) if owner == k]
            if self.recording.header.has_host:
                continue
            if on is not None and self.has("contact_position") and len(fingers) > 1:
                touch = on[fingers]
                e = p[fingers] - block.column("contact_position")[fingers]
                count = np.maximum(touch.sum(axis=0), 1.0)
                if not touch.all():
                    e = np.where(touch[:, None], e, 0.0)
                off = e - e.sum(axis=0) / count
                square = (off * off).sum(axis=1)
                square = (square if touch.all() else np.where(touch, square, 0.0)).sum(axis=0) / count
                self.squeeze.add(np.sqrt(square)[None], (touch.sum(axis=0) >= 2)[None])
            place = f"objects/{name}/position"
            if fingers and self.has(place):
                away = block.column(place) - p[fingers].sum(axis=0) / len(fingers)
                self.off.append(float((away * away).sum()))
                self.off_count += p.shape[2]
        if len(p) == 2:
            apart = _length((p[1] - p[0])[None])
            self.apart.add(apart)
            self.least_apart = float(np.minimum(self.least_apart, apart.min()))

    def _add_objects(self, block: RowSplit) -> None:
        for k, name in enumerate(self.layout.objects):
            at = f"objects/{name}/"
            if self.has(at + "law"):
                self.lawful += int((block.column(at + "law") == 1.0).sum())
            if self.has(at + "residual"):
                self.residual.largest[k] = np.maximum(self.residual.largest[k], block.column(at + "residual").max())
            for column in self.layout.columns:
                if column.startswith(at + "energy/"):
                    self.ledgers[name].add(column.rpartition("/")[2], block.column(column))
        if self.has("device_energy"):
            self.energy = block.column("device_energy")[:, -1].copy()

    def _add_moments(self, block: RowSplit, grasp: GraspRows, force: FloatArray) -> None:
        """Add the moment of the internal forces about an object, and its reference |f| r (see `summarise`).

        Internal forces f at the contacts have no resultant moment. If the forces act on the object at the fingertips,
        they have a resultant moment. Nothing is added if forces react at the contacts, or if the object cannot rotate.
        """
        rows, rule, thing, fingers = grasp
        if rule.reaction == "contact" or not any(rule.rotations):
            return
        where, d = (fingers, slice(None), rows), self.layout.dimensions
        c, f = block.column("contact_position")[where], force[where]
        e = block.column("finger_position")[where] - c
        square = np.zeros(c.shape[2])
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            if rule.rotations[k] and a < d and b < d:
                square += (e[:, a] * f[:, b] - e[:, b] * f[:, a]).sum(axis=0) ** 2
        away = c - c.sum(axis=0) / len(c)
        whole = np.sqrt((f * f).sum(axis=(0, 1)) * (away * away).sum(axis=(0, 1)) / len(c))
        number = sum(first <= block.start + rows.start for first, _ in self.splits)
        moment, push = self.moments.setdefault((thing, number), (Sizes(), Sizes()))
        moment.add(np.sqrt(square)[None])
        push.add(whole[None])

    def _add_signals(self, block: RowSplit, parts: Mapping[str, FloatArray]) -> None:
        tips = "true_position" if self.layout.simulated else "finger_position"
        places = [f"objects/{name}/position" for name in self.layout.objects]
        signals = {f"{name}_vibration": [values] for name, values in parts.items()}
        if not parts and self.has("finger_force"):
            signals["force_vibration"] = [block.column("finger_force")]
        if self.has(tips):
            signals["finger_vibration"] = [block.column(tips)]
        if self.has(*places) and not self.recording.header.has_host:
            signals["object_vibration"] = [block.column(place) for place in places]
        if signals:
            flat = [each.reshape(-1, each.shape[-1]) for values in signals.values() for each in values]
            self.shaking.add(np.concatenate(flat))
            self.signals = {
                name: sum(each.size for each in values) // values[0].shape[-1] for name, values in signals.items()
            }
            if parts:
                self.signals["force_vibration"] = parts["internal_force"].shape[0] * self.layout.dimensions

    def result(self, growth: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        """Return the summary."""
        recording, layout = self.recording, self.layout
        outcome, ticks, wall_time = recording.outcome, recording.ticks, recording.wall_time
        timed = wall_time is not None and wall_time > 0.0 and ticks > 0
        deformed = self.has("finger_position", "contact_position", "touching") and not recording.header.has_host
        sunk = self.has("gap", "touching")
        displayed = "displayed_force" if self.has("displayed_force") else "finger_force"
        pair = len(layout.fingers) == 2 and self.apart.count > 0
        laws = sum(self.has(f"objects/{name}/law") for name in layout.objects)
        return {
            "ticks": ticks,
            "period": float(recording.period),
            "duration": float(ticks * recording.period),
            "touching": self._shares("touching", self.on),
            "internal_deformation_mean": self.squeeze.mean or 0.0 if deformed else None,
            "internal_deformation_peak": self.squeeze.peak or 0.0 if deformed else None,
            "invasion_mean": self.depth.mean or 0.0 if sunk else None,
            "invasion_peak": self.depth.peak or 0.0 if sunk else None,
            "finger_distance_mean": self.apart.mean if pair else None,
            "finger_distance_least": self.least_apart if pair else None,
            "tracking_error": math.sqrt(_sum(self.off) / self.off_count) if self.off_count else None,
            "peak_force": self.forces["finger_force"].peaks if self.has("finger_force") else None,
            "peak_displayed_force": self.forces[displayed].peaks if self.has("finger_force") else None,
            "saturated": self._shares("saturated", self.limited),
            "force_vibration": self._vibration("force_vibration"),
            **self._two_forces("internal_force"),
            **self._two_forces("external_force"),
            "internal_moment": self._moment(),
            "finger_vibration": self._vibration("finger_vibration"),
            "object_vibration": self._vibration("object_vibration"),
            "port_energy": [None] * len(layout.fingers) if self.energy is None else self.energy.tolist(),
            "fade_shortfall": outcome.fade_shortfall or None,
            "blended": outcome.blended / ticks if outcome.blended and ticks else None,
            "associated": self.lawful / (self.rows * laws) if self.rows and laws else None,
            "friction_residual": self.residual.peak,
            "grip_margin": self.grip_margin if math.isfinite(self.grip_margin) else None,
            "friction_needed": self.friction_needed if math.isfinite(self.grip_margin) else None,
            **self._books(),
            "growth": [dict(each) for each in growth],
            "wall_time": wall_time,
            "engine": outcome.engine or None,
            "ticks_per_second": ticks / wall_time if timed and wall_time else None,
            "tick_cost": wall_time / ticks * MICROSECONDS if timed and wall_time else None,
            "faults": len(recording.faults),
            "changes": len(recording.changes) or None,
            "recorded": self._recorded(),
        }

    def _shares(self, column: str, counts: FloatArray) -> list[float | None] | None:
        if not self.has(column):
            return None
        return (counts / self.rows).tolist() if self.rows else [None] * len(counts)

    def _two_forces(self, name: str) -> dict[str, Any]:
        sizes = self.forces[name] if self.divided else None
        return {
            f"{name}_peak": None if sizes is None else sizes.peaks,
            f"{name}_mean": None if sizes is None else sizes.mean,
            f"{name}_vibration": self._vibration(f"{name}_vibration"),
        }

    def _vibration(self, name: str) -> float | None:
        squares, start = self.shaking.mean_squares(), 0
        for each, width in self.signals.items():
            if each == name and squares is not None:
                return math.sqrt(squares[start : start + width].sum() / (width // self.layout.dimensions))
            start += width
        return None

    def _moment(self) -> float | None:
        both = [(moment.peak, whole.peak) for moment, whole in self.moments.values()]
        return max((moment / whole for moment, whole in both if moment is not None and whole), default=None)

    def _books(self) -> dict[str, Any]:
        """Return the values of the summary that come from the energy ledgers of all objects."""
        books = self.ledgers.values()
        leaks, braking, braked = (
            [value for ledger in books if (value := getattr(ledger, name)) is not None]
            for name in ("leak", "braking", "braked")
        )
        gaps = [ledger.gap / ledger.largest if ledger.largest > 0.0 else 0.0 for ledger in books]
        return {
            "leak": np.max(leaks, axis=0).tolist() if leaks else None,
            "braking": np.max(braking, axis=0).tolist() if braking else None,
            "braked": np.sum(braked, axis=0).tolist() if braked else None,
            "ledger_gap": max(gaps) if leaks else None,
        }

    def _recorded(self) -> str | None:
        layout, every = self.layout, self.recording.header.every
        texts = [f"peaks, means and energies are of the recorded rows, one per {every} ticks"] if every > 1 else []
        if layout.omitted:
            texts.append(f"not recorded, and therefore not computed: {', '.join(layout.omitted)}")
        return "; ".join(texts) or None


def _length(vectors: FloatArray) -> FloatArray:
    """Return the lengths of vectors (n, d, r), as (n, r)."""
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=1)))


def _larger(before: FloatArray | None, now: FloatArray) -> FloatArray:
    return now if before is None else np.maximum(before, now)


def _sum(values: Iterable[float]) -> float:
    """Return the sum of numbers without intermediate rounding."""
    return math.fsum(values) if all(map(math.isfinite, values := [*values])) else sum(values)


def _largest(values: Iterable[float | None]) -> float | None:
    """Return the largest number, or NaN if a number is NaN; None if there are no numbers."""
    numbers = [value for value in values if value is not None]
    return float(np.max(numbers)) if numbers else None
