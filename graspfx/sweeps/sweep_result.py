"""Results of a sweep: measures, faults and failures of every variant."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from graspfx.batch.batch import Batch
from graspfx.card import Card, counted, listed
from graspfx.certificate.judgement import Judge
from graspfx.errors import InputError, UnknownNameError
from graspfx.numeric import count
from graspfx.progress import waiting
from graspfx.show.conversions import Labels, batch_dataset, batch_frame, batch_labels, grid_of
from graspfx.sweeps.chunk import RUN, column_of, reason

if TYPE_CHECKING:
    import pandas
    import xarray

    from graspfx.loop.columns import Column
    from graspfx.scene.model import Scene
    from graspfx.show.style import Drawing
    from graspfx.show.variant_figures import Margins

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]

MOST_JUDGED, LEAST_JUDGED = 9, 3  # values along an axis at which certificates are computed: of one map, of many maps


@dataclass(frozen=True, repr=False)
class SweepResult(Batch):
    """Results of a sweep. Each array begins with the axes of the grid, or with one axis of variants (zip, samples).

    Attributes:
        values, fault_tick, measures, notes, scene, layout: As for a `Batch`; measures of failed variants are NaN, and
            every zero is positive.
        failure: Reason why a variant has no measures, otherwise empty, in the grid's shape.
        folder: Folder of the chunks and `sweep.nc`; None for a sweep in memory.
        about: Description of the sweep in its file: scene, identity, duration, sample, seed, version.
        resumed: Number of variants that had been computed before.
        seconds: Time of this call, and total time of all chunks [s].
        base: Scene whose values were replaced; None if unknown.
    """

    failure: NDArray[Any] = field(default_factory=lambda: np.empty(0, dtype=object))
    folder: Path | None = None
    about: dict[str, Any] = field(default_factory=dict)
    resumed: int = 0
    seconds: tuple[float, float] = (0.0, 0.0)
    base: Scene | None = field(default=None, compare=False)
    _judged: dict[int, tuple[Margins | None, tuple[str, ...]]] = field(default_factory=dict, compare=False)

    def _card(self) -> Card:
        grid = f" ({' x '.join(map(str, self.shape))})" if len(self.shape) > 1 else ""
        how = (
            f", {self.about['sample']}"
            if self.about.get("sample")
            else ", values taken together"
            if self.is_together
            else ""
        )
        rows = [
            *((key, _extent(values)) for key, values in self.values.items()),
            *((name, listed(by_name, len(by_name))) for name, by_name in self.measures.items()),
            ("faults", _of(int((self.fault_tick >= 0).sum()))),
            ("failures", "\n".join([_of(int(self.failed.sum())), *self.reasons(3)])),
            ("files", str(self.folder) if self.folder is not None else ""),
            ("time", self._time()),
            ("notes", "\n".join(self.notes)),
        ]
        calls = "[quantity][statistic], .ranking(measure), .plot(), .to_xarray(), .to_frame(), .overrides(variant)"
        return Card(f"Sweep of {self.scene}: {counted(len(self), 'variant')}{grid}{how}", rows, calls)

    def _time(self) -> str:
        again = f"; {counted(self.resumed, 'variant')} had been computed before" if self.resumed else ""
        return f"{self.seconds[0]:.3g} s, {self.seconds[1]:.3g} s in chunks{again}"

    @property
    def unstable(self) -> NDArray[np.bool_] | None:
        """Whether each run grows, in the grid's shape, False for failed variants; None if not measured."""
        return np.asarray(self[RUN]["unstable"] == 1.0) if RUN in self.measures else None

    def column(self, quantity: str) -> Column:
        """Return the description of a quantity: dimensions, unit and meaning.

        Raises:
            UnknownNameError: If the quantity does not exist.
        """
        if self.layout is None:
            raise UnknownNameError("measure", quantity, ())
        return column_of(self.layout, quantity)

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Whether each variant has failed, in the grid's shape."""
        return np.asarray(self.failure.astype(str) != "")

    def reasons(self, most: int = 10) -> list[str]:
        """List the reasons for failures with their counts, the most frequent first, `most` at most."""
        texts = Counter(str(text) for text in self.failure.ravel() if text)
        return [f"{times} x {text}" for text, times in texts.most_common(count("most", most))]

    def overrides(self, variant: int) -> dict[str, Any]:
        """Return the values of one variant, by its index in the flattened grid, for `scene.replace`.

        Raises:
            InputError: If the grid has no such variant.
        """
        k, total = count("variant", variant), self.fault_tick.size
        if k >= total:
            raise InputError("variant", variant, f"an index from 0 to {total - 1}")
        return {key: values.ravel()[k : k + 1].tolist()[0] for key, values in self.values.items()}

    def scalar(self, measure: str = "") -> tuple[str, FloatArray]:
        """Return one number per variant, in the grid's shape: the entry of a measure with the largest magnitude.

        Args:
            measure: Name of a measure, such as `finger_force.peak`. By default it is the growth of the first quantity,
                or else that quantity's first statistic: `run.vibration` if `run` is the first quantity. If the runs
                are too short for a vibration, `run` is skipped.

        Returns:
            Full name of the measure, and the numbers; NaN for missing numbers.

        Raises:
            UnknownNameError: If the measure does not exist.
        """
        quantity, statistic = self.measure_of(measure)
        values = self[quantity][statistic].reshape(*self.shape, -1)
        sizes = np.where(np.isnan(values), -1.0, np.abs(values))
        largest = np.take_along_axis(values, sizes.argmax(axis=-1)[..., None], axis=-1)[..., 0]
        return f"{quantity}.{statistic}", np.asarray(largest)

    def measure_of(self, measure: str = "") -> tuple[str, str]:
        """Split the name of a measure into quantity and statistic.

        Raises:
            UnknownNameError: If the measure does not exist.
        """
        names = [f"{quantity}.{name}" for quantity, by_name in self.measures.items() for name in by_name]
        if not measure:
            told = [name for name in self.measures if name != RUN or np.isfinite(self[RUN]["vibration"]).any()]
            first = (told or list(self.measures))[0]
            own = self.measures[first]
            return first, "growth" if "growth" in own else next(iter(own))
        if measure not in names:
            raise UnknownNameError("measure", measure, names)
        quantity, _, name = measure.rpartition(".")
        return quantity, name

    def ranking(self, measure: str = "") -> IndexArray:
        """Return the variants' indices in the flattened grid, in ascending order of a measure.

        Variants without the measure and variants with a fault are omitted. The argument is as for `scalar`.
        """
        _, values = self.scalar(measure)
        flat = np.where(self.fault_tick.ravel() >= 0, np.nan, values.ravel())
        order = np.argsort(flat, kind="stable")
        return np.asarray(order[: int(np.isfinite(flat).sum())])

    def labels(self) -> Labels:
        """Collect all arrays with their dimensions, units and meanings, for files and xarray."""
        labels = batch_labels(self)
        grid, _ = grid_of(self)
        meaning = {"long_name": "reason why the variant has no measures; otherwise empty"}
        variables = {"failure": (grid, self.failure.astype(str), meaning), **labels.variables}
        attributes = {name: value for name, value in self.about.items() if value not in ("", None)}
        return Labels(variables, labels.coordinates, {**attributes, "notes": list(self.notes)})

    def to_xarray(self) -> xarray.Dataset:
        """Convert to an xarray Dataset with one dimension per key, or `variant`, as in `sweep.nc`.

        Measures become variables such as `finger_force_rms`, each with `units` and `long_name`, in addition to
        `fault_tick` and `failure`.

        Raises:
            MissingPackageError: If xarray is not installed: `pip install 'graspfx[data]'`.
        """
        return batch_dataset(self.labels())

    def to_frame(self) -> pandas.DataFrame:
        """Convert to a pandas DataFrame with one row per variant, and one column per key and component.

        Components have names such as `finger_force.rms.thumb.x`.

        Raises:
            MissingPackageError: If pandas is not installed: `pip install 'graspfx[data]'`.
        """
        frame = batch_frame(self)
        frame.insert(len(self.values), "failure", self.failure.astype(str).ravel())
        return frame

    def to_dict(self) -> dict[str, Any]:
        """Return values, faults, failures and measures as nested lists, for JSON; None stands for NaN."""
        table = {**super().to_dict(), "failure": self.failure.tolist(), "about": dict(self.about)}
        whole: dict[str, Any] = json.loads(json.dumps(table, default=repr), parse_constant=lambda _: None)
        return whole

    def plot(self, *measures: str, width: Literal["screen", "page", "column"] = "screen", slices: int = 3) -> Drawing:
        """Plot measures over the keys: curves for one key, maps for two, slices for more, marginals for samples.

        Maps show the line beyond which runs grow, if measured, and the certificate's limit, the line at which its
        smallest margin is 1. The limit is interpolated between certificates at no more than 9 x 9 of the sweep's
        points, which are computed on the first call. Points without a rest or a grasp are not judged; see `notes` of
        the drawing.

        Args:
            measures: Names of measures, such as `finger_force.peak`; by default one measure of each of the first three
                quantities, or for maps of the first quantity. Maps show a single measure.
            width: "screen", or a journal's width of 7.2 ("page") or 3.5 ("column") inches.
            slices: Number of values of a third key that have their own map; further keys are set to their middle value.

        Raises:
            UnknownNameError: If a measure does not exist.
            InputError: If the width is unknown, there is nothing to plot, or maps of several measures are asked for.
        """
        from graspfx.show.style import Drawing
        from graspfx.show.variant_figures import Surface, variants_sheet

        if not self.measures:
            raise InputError("measures", (), "a sweep with measures")
        names = measures or tuple(self.drawn()[:1] if self.has_maps else self.drawn())
        if self.has_maps and len(names) > 1:
            raise InputError("measures", names, "one measure for maps", "plot the others separately")
        surfaces = []
        for name in names:
            whole, values = self.scalar(name)
            quantity, statistic = self.measure_of(name)
            unit = "" if statistic in ("growth", "unstable") else self.column(quantity).unit
            surfaces.append(Surface(whole, unit, values, self.unstable))
        bad = self.failed | (self.fault_tick >= 0)
        margins, notes = self._margins(slices) if self.has_maps else (None, ())
        sheet = variants_sheet(
            self.values, surfaces, bad, f"{self.scene}", width, slices, together=self.is_together, margins=margins
        )
        return Drawing(sheet, notes)

    def _margins(self, slices: int) -> tuple[Margins | None, tuple[str, ...]]:
        """Compute certificates on a coarse grid of the maps' variants once, and report points that are not judged."""
        if slices not in self._judged:
            self._judged[slices] = self._judge(slices)
        return self._judged[slices]

    def _judge(self, slices: int) -> tuple[Margins | None, tuple[str, ...]]:
        from graspfx.show.variant_figures import Margins, drawn_maps, picks_of

        if self.base is None:
            return None, ("the certificate's limit is not drawn: the scene is unknown",)
        try:
            judge = Judge(self.base)
        except InputError as error:
            return None, (f"the certificate's limit is not drawn: {reason(error)}",)
        maps, rest = drawn_maps(self.shape, slices)
        along = max(MOST_JUDGED // round(len(maps) ** 0.5), LEAST_JUDGED)
        places = tuple(picks_of(size, along) for size in self.shape[:2])
        values = np.full((*map(len, places), len(maps)), np.nan)
        why: Counter[str] = Counter()
        with judge.session(), waiting("judging the certificate's limit", values.size, "variants") as wait:
            for i, j, k in np.ndindex(*values.shape):
                whole = (places[0][i], places[1][j], *((maps[k], *rest) if len(self.shape) > 2 else ()))
                values[i, j, k], text = self._margin(judge, int(np.ravel_multi_index(whole, self.shape)))
                why.update([text] if text else [])
                wait.done += 1
        unknown = int(np.isnan(values).sum())
        where = f"at {unknown} of {values.size} points"
        notes = [f"certificate: not judged {where}: {text}" for text, _ in why.most_common(1)]
        if unknown < values.size and (np.nanmin(values) >= 1.0 or np.nanmax(values) < 1.0):
            side = "above" if np.nanmin(values) >= 1.0 else "below"
            extent = f"{np.nanmin(values):.3g} to {np.nanmax(values):.3g}"
            notes.append(f"certificate: no limit within the map, margins are {side} 1: {extent}")
        return Margins(places, values), tuple(notes)

    def _margin(self, judge: Judge, variant: int) -> tuple[float, str]:
        """Return a variant's smallest margin, or NaN and the reason; failed variants are not tried."""
        if failure := str(self.failure.ravel()[variant]):
            return np.nan, failure
        try:
            one = judge.judge(self.overrides(variant))
        except Exception as error:  # noqa: BLE001 - third-party code may raise anything
            return np.nan, reason(error)
        if not np.isfinite(one.spectral_radius):
            return np.nan, " ".join(one.assumed)
        return one.margin, ""

    @property
    def is_together(self) -> bool:
        """Whether the keys' values are combined one to one, without a grid."""
        return len(self.values) > len(self.shape) or bool(self.about.get("sample"))

    @property
    def has_maps(self) -> bool:
        """Whether measures are drawn as maps, one measure per figure."""
        return not self.is_together and len(self.values) > 1

    def drawn(self) -> list[str]:
        """List the measures that are drawn by default: one measure of each of the first three quantities."""
        return [self.first_of(quantity) for quantity in list(self.measures)[:3]]

    def first_of(self, quantity: str) -> str:
        """Return the most informative measure of a quantity: growth or peak, or else the first.

        Raises:
            UnknownNameError: If the quantity was not measured.
        """
        names = self[quantity]
        return f"{quantity}.{next((name for name in ('growth', 'peak') if name in names), next(iter(names)))}"


def _of(count: int) -> str:
    return f"in {counted(count, 'variant')}" if count else "none"


def _extent(values: NDArray[Any]) -> str:
    texts = list(dict.fromkeys(f"{each:.6g}" if isinstance(each, float) else f"{each}" for each in values.ravel()))
    if values.dtype.kind == "f" and len(texts) > 6:
        return f"{len(texts)} values from {values.min():.6g} to {values.max():.6g}"
    return listed(texts)
