"""Stability of a scene whose values change: a fast result from the last linearisation, then one from a new one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from graspfx.certificate.certificate import Limit, is_stable
from graspfx.certificate.first_loss import Family, WholeLoop
from graspfx.certificate.judgement import Change, altered, change_of
from graspfx.certificate.linearise import Linearised, linearise
from graspfx.certificate.mode_limits import mode_limits, pushing_limits, spectral_radius, standing_limits
from graspfx.errors import GraspFXError
from graspfx.scene.model import Scene


class MarginRow(NamedTuple):
    """Stability margin of one mode of an object's grasp.

    Attributes:
        mode: "internal", "external", "external translation", "external rotation", "standing on ..." or "pushing with
            ..."; the last names the set of pushing fingers with the smallest margin.
        name: Name of the object.
        gain: Gain of the mode in the scene [N/m]; for "standing on" and "pushing with", the largest stiffness; NaN if
            the gains are matrices.
        limit: Stability limit of the gain [N/m]; infinite if there is none. The limit holds while the other gains are
            fixed; for "standing on" and "pushing with", it holds if all gains change by the same factor.
        margin: Limit divided by gain.
        frequency: Frequency at which stability is lost [Hz]; NaN if there is no limit.
    """

    mode: str
    name: str
    gain: float
    limit: float
    margin: float
    frequency: float

    @property
    def is_mode(self) -> bool:
        """Whether the row describes the whole grasp, which must be stable; False for pushing with some fingers only."""
        return not self.mode.startswith("pushing with ")


@dataclass(frozen=True)
class Verdict:
    """Stability of a scene.

    Attributes:
        values: Changed values by live key; other keys have the values of the scene.
        is_provisional: Whether a full result will follow.
        is_stable: Whether the loops of all objects are stable; None if unknown (see `error`).
        spectral_radius: Largest spectral radius of the loops of all objects; NaN after an error.
        rows: Stability margins of all objects.
        error: Reason why the stability could not be computed; empty if it was computed.
        number: Number of the request.
        stage: 0 if computed from the last linearisation, 1 if computed from a new linearisation but without new limits
            of pushing fingers, 2 if complete.
    """

    values: Mapping[str, Any] = field(default_factory=dict)
    is_provisional: bool = True
    is_stable: bool | None = None
    spectral_radius: float = math.nan
    rows: tuple[MarginRow, ...] = ()
    error: str = ""
    number: int = 0
    stage: int = 0

    @property
    def text(self) -> str:
        """One-line summary: stable or not, provisional or not, and the smallest margin of a whole grasp."""
        if self.is_stable is None:
            return f"not judged: {self.error}" if self.error else "not judged yet"
        text = "stable" if self.is_stable else "NOT STABLE"
        if self.is_provisional:
            text += " (provisional)"
        modes = [row for row in self.rows if row.is_mode and math.isfinite(row.margin)]
        if modes:
            least = min(modes, key=lambda row: row.margin)
            text += f": {least.mode} margin {least.margin:.2f}"
        return text


@dataclass(frozen=True, eq=False)
class _Base:
    """Linearised scene: the loop of each object, the part of each loop that is independent of gains, and the limits."""

    scene: Scene
    loops: tuple[Linearised, ...]
    wholes: tuple[WholeLoop, ...]
    rows: tuple[MarginRow, ...]


class Certifier:
    """Stability of a scene whose live keys take other values.

    Complete results equal those of `gx.certify`. `provisional` and `stages` may run in two threads at the same time.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._base: _Base | None = None

    def provisional(self, values: Mapping[str, Any]) -> Verdict | None:
        """Compute the stability for changed gains and object parameters from the last linearisation.

        The equilibrium and the squeeze are those of the last linearisation. The result is None before the first
        linearisation, if a value is invalid, or if `Change` cannot describe the changes.
        """
        base = self._base
        if base is None:
            return None
        radius = 0.0
        try:
            changes = [change_of(base.scene, loop.objects[0], values) for loop in base.loops]
            for loop, whole, change in zip(base.loops, base.wholes, changes, strict=True):
                if change is None:
                    return None
                radius = max(radius, _altered_radius(base.scene, loop, whole, change))
        except GraspFXError:
            return None
        rows = tuple(_scaled(row, changes[0]) for row in base.rows if changes[0] is not None)
        return Verdict(dict(values), True, _all_stable(radius, rows), radius, rows)

    def stages(self, values: Mapping[str, Any]) -> Iterator[Verdict]:
        """Linearise the scene with these values; yield its stability without and then with new limits of pushing."""
        try:
            yield from self._stages(values)
        except Exception as error:  # noqa: BLE001 - drivers and scenes may raise anything; the page shows it
            text = " ".join(str(error).split())
            name = "" if isinstance(error, GraspFXError) else f"{type(error).__name__}: "
            yield Verdict(dict(values), False, error=name + text, stage=2)

    def _stages(self, values: Mapping[str, Any]) -> Iterator[Verdict]:
        scene = self._scene.replace(values) if values else self._scene
        touched = sorted(set(scene.finger_objects))
        if not touched:
            yield Verdict(dict(values), False, error="no finger touches an object", stage=2)
            return
        loops = tuple(linearise(scene, "squeezed", scene.object[i].name) for i in touched)
        radius = max(spectral_radius(loop.linear) for loop in loops)
        rows = [row for loop in loops for row in _rows(loop, [*mode_limits(scene, loop), *standing_limits(loop)])]
        before = self._pushing_before(scene, values)
        wholes = tuple(WholeLoop(loop.linear, loop.gains) for loop in loops)
        base = self._base = _Base(scene, loops, wholes, (*rows, *before))
        answer = Verdict(dict(values), True, _all_stable(radius, rows), radius, base.rows, stage=1)
        yield answer
        for loop in loops:
            pushing = pushing_limits(scene, loop)
            if pushing:
                rows += _rows(loop, [min(pushing, key=lambda row: row.margin)])
        self._base = replace(base, rows=tuple(rows))
        yield replace(answer, is_provisional=False, rows=tuple(rows), stage=2)

    def _pushing_before(self, scene: Scene, values: Mapping[str, Any]) -> list[MarginRow]:
        """Return the limits of pushing fingers from the last linearisation, scaled to the present gains."""
        if self._base is None:
            return []
        change = change_of(self._base.scene, scene.object[scene.finger_objects[0]].name, values)
        return [_scaled(row, change) for row in self._base.rows if not row.is_mode and change is not None]


def _altered_radius(scene: Scene, loop: Linearised, whole: WholeLoop, change: Change) -> float:
    stiffness = loop.stiffness(change.external, change.external, change.internal)
    if change.is_external:
        return Family(whole, lambda s: stiffness).radius(1.0)
    linear = altered(scene, loop, change)
    return Family(WholeLoop(linear, loop.gains), lambda s: stiffness).radius(1.0)


def _rows(loop: Linearised, limits: Sequence[Limit]) -> list[MarginRow]:
    name = loop.objects[0]
    return [MarginRow(row.mode, name, row.gain, row.limit, row.margin, row.frequency) for row in limits]


def _all_stable(radius: float, rows: Sequence[MarginRow]) -> bool:
    """Return whether all loops are stable by the criterion of `Certificate.stable`."""
    return is_stable(radius) and all(row.margin >= 1.0 for row in rows if row.mode.startswith("standing on"))


def _scaled(row: MarginRow, change: Change) -> MarginRow:
    """Return a row for changed gains.

    For an internal or external mode, the gain is multiplied by the factor of its change. For other modes, the limit is
    divided by the larger of the two factors. The margin is divided in both cases.
    """
    if not row.mode.startswith(("internal", "external")):
        factor = max(change.external, change.internal)
        return row._replace(limit=_over(row.limit, factor), margin=_over(row.margin, factor))
    factor = change.internal if row.mode == "internal" else change.external
    return row._replace(gain=row.gain * factor, margin=_over(row.margin, factor))


def _over(value: float, factor: float) -> float:
    return value / factor if factor > 0.0 else math.inf
