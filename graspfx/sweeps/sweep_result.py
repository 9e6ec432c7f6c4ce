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
    """Results of a sweep.

    The first axes of each array are the axes of the grid, one per key. If the keys vary together (argument `zip` or
    `sample`), the first axis is the axis of variants instead.

    Attributes:
        values, fault_tick, measures, notes, scene, layout: As for a `Batch`; measures of failed variants are NaN, and
            measures do not contain -0.0.
        failure: For each variant, the reason why it has no measures; empty if it has measures. Array of the shape of
            the grid.
        folder: Folder of the chunks and of `sweep.nc`; None for a sweep in memory.
        about: Description of the sweep, as in the attributes of `sweep.nc`: scene, identity, duration, sample, seed and
            version.
        resumed: Number of variants that were read from the folder instead of being computed.
        seconds: Time of the call, and total computing time of all chunks [s].
        base: Scene in which values were replaced; None if unknown.
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
            else ", keys vary together"
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
        """Mask of the variants with a growing oscillation, in the shape of the grid; False for failed variants.

        None if the quantity "run" was not measured.
        """
        return np.asarray(self[RUN]["unstable"] == 1.0) if RUN in self.measures else None

    def column(self, quantity: str) -> Column:
        """Return the dimensions, the unit and the meaning of a quantity.

        Raises:
            UnknownNameError: If there is no quantity with this name.
        """
        if self.layout is None:
            raise UnknownNameError("measure", quantity, ())
        return column_of(self.layout, quantity)

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Mask of the variants that have failed, in the shape of the grid."""
        return np.asarray(self.failure.astype(str) != "")

    def reasons(self, most: int = 10) -> list[str]:
        """Return up to `most` reasons for failures, each with the number of variants, in order of frequency."""
        texts = Counter(str(text) for text in self.failure.ravel() if text)
        return [f"{times} x {text}" for text, times in texts.most_common(count("most", most))]

    def overrides(self, variant: int) -> dict[str, Any]:
        """Return the values of one variant, by key, for `scene.replace`.

        Args:
            variant: Index of the variant in the flattened grid.

        Raises:
            InputError: If the grid has no such variant.
        """
        k, total = count("variant", variant), self.fault_tick.size
        if k >= total:
            raise InputError("variant", variant, f"an index from 0 to {total - 1}")
        return {key: values.ravel()[k : k + 1].tolist()[0] for key, values in self.values.items()}

    def scalar(self, measure: str = "") -> tuple[str, FloatArray]:
        """Return one number per variant: the entry of a measure with the largest magnitude.

        Args:
            measure: Name of a measure, such as `finger_force.peak`. By default, it is the statistic `growth` of the
                first quantity or, if growth was not measured, the first statistic of this quantity. The quantity `run`
                is skipped if its vibration is NaN in all variants, because the runs are too short.

        Returns:
            Name of the measure; and the numbers in the shape of the grid, NaN where there is none.

        Raises:
            UnknownNameError: If there is no measure with this name.
        """
        quantity, statistic = self.measure_of(measure)
        values = self[quantity][statistic].reshape(*self.shape, -1)
        sizes = np.where(np.isnan(values), -1.0, np.abs(values))
        largest = np.take_along_axis(values, sizes.argmax(axis=-1)[..., None], axis=-1)[..., 0]
        return f"{quantity}.{statistic}", np.asarray(largest)

    def measure_of(self, measure: str = "") -> tuple[str, str]:
        """Return the quantity and the statistic of a measure, whose default is as for `scalar`.

        Raises:
            UnknownNameError: If there is no measure with this name.
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
        """Return the indices of variants in the flattened grid, in ascending order of a measure.

        Variants with a fault, and variants without a finite value of the measure, are omitted.

        Args:
            measure: Name of the measure; the default is as for `scalar`.
        """
        _, values = self.scalar(measure)
        flat = np.where(self.fault_tick.ravel() >= 0, np.nan, values.ravel())
        order = np.argsort(flat, kind="stable")
        return np.asarray(order[: int(np.isfinite(flat).sum())])

    def labels(self) -> Labels:
        """Return all arrays with their dimensions, units and meanings, for files and xarray."""
        labels = batch_labels(self)
        grid, _ = grid_of(self)
        meaning = {"long_name": "reason why the variant has no measures; otherwise empty"}
        variables = {"failure": (grid, self.failure.astype(str), meaning), **labels.variables}
        attributes = {name: value for name, value in self.about.items() if value not in ("", None)}
        return Labels(variables, labels.coordinates, {**attributes, "notes": list(self.notes)})

    def to_xarray(self) -> xarray.Dataset:
        """Convert the results to an xarray Dataset, with the content of `sweep.nc`.

        The dataset has a dimension for each key or, if the keys vary together, the dimension `variant`. The variables
        are `fault_tick`, `failure`, and the measures, with names such as `finger_force_rms` and the attributes `units`
        and `long_name`.

        Raises:
            MissingPackageError: If xarray is not installed: `pip install 'graspfx[data]'`.
        """
        return batch_dataset(self.labels())

    def to_frame(self) -> pandas.DataFrame:
        """Convert the results to a pandas DataFrame with one row per variant.

        The columns are the keys, `failure`, the faults, and each component of each measure, with names such as
        `finger_force.rms.thumb.x`.

        Raises:
            MissingPackageError: If pandas is not installed: `pip install 'graspfx[data]'`.
        """
        frame = batch_frame(self)
        frame.insert(len(self.values), "failure", self.failure.astype(str).ravel())
        return frame

    def to_dict(self) -> dict[str, Any]:
        """Return values, faults, failures and measures as nested lists for JSON, with None instead of NaN."""
        table = {**super().to_dict(), "failure": self.failure.tolist(), "about": dict(self.about)}
        whole: dict[str, Any] = json.loads(json.dumps(table, default=repr), parse_constant=lambda _: None)
        return whole

    def plot(self, *measures: str, width: Literal["screen", "page", "column"] = "screen", slices: int = 3) -> Drawing:
        """Plot measures over the keys.

        The figure contains curves for one key, a map for two keys, and several maps for more keys. If the keys vary
        together, it contains scatter plots over each key.

        Maps show two boundaries: the boundary between decaying and growing runs, if the quantity "run" was measured;
        and the limit of the stability certificate, where its smallest margin is 1. The limit is interpolated between
        certificates at up to 9 x 9 variants, which are computed in the first call. Variants for which there is no
        certificate, such as those without an equilibrium, are marked, and the `notes` of the drawing state the reason.

        Args:
            measures: Names of measures, such as `finger_force.peak`; one name for maps. By default, one measure of each
                of the first three quantities or, for maps, one measure of the first quantity.
            width: "screen", "page" (7.2 inches) or "column" (3.5 inches).
            slices: Number of maps, for different values of a third key; further keys have their middle value.

        Raises:
            UnknownNameError: If there is no measure with a given name.
            InputError: If the width is unknown, there is nothing to plot, or several measures are given for maps.
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
        """Return margins of certificates on a coarse grid of the maps' variants, and notes about missing certificates.

        Results are cached.
        """
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
        """Return the smallest margin of a variant and an empty text, or NaN and the reason why there is no margin."""
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
        """Whether the keys vary together (argument `zip` or `sample`), so that the variants do not form a grid."""
        return len(self.values) > len(self.shape) or bool(self.about.get("sample"))

    @property
    def has_maps(self) -> bool:
        """Whether measures are drawn as maps, one measure per figure."""
        return not self.is_together and len(self.values) > 1

    def drawn(self) -> list[str]:
        """Return the measures that are drawn by default: one measure of each of the first three quantities."""
        return [self.first_of(quantity) for quantity in list(self.measures)[:3]]

    def first_of(self, quantity: str) -> str:
        """Return the name of the measure of a quantity that is drawn by default: growth, peak, or else the first.

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
