"""Report on a scene: certificates, warnings, and the plan of a run."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from os import PathLike
from typing import TYPE_CHECKING, Any

from graspfx.card import Card, Carded, listed
from graspfx.certificate.certificate import NOT_GRASPING, NOT_STABLE, PUSHING, STABLE, lines
from graspfx.errors import Fault, GraspFXError, SceneError

if TYPE_CHECKING:
    from graspfx.certificate.certificate import Certificate, Limit
    from graspfx.certificate.plan import PlanRow
    from graspfx.scene.model import Scene
    from graspfx.scene.tables.reading import Readable

MOST_STEPS, MOST_FAULTS = 12, 8  # largest numbers of steps, run or skipped, and of faults on a card
NOT_JUDGED = "not judged"


@dataclass(frozen=True, eq=False, repr=False)
class Report(Carded):
    """Report on a scene.

    Attributes:
        scene: Name of the scene.
        faults: Faults because of which the scene cannot run. If there are any, the report contains nothing else.
        certificates: Certificate of each object that has fingers, the least stable first; empty if certificates cannot
            be computed.
        why: Reason why there are no certificates; empty if there are any.
        notes: Warnings about likely mistakes, except those in `doubts`.
        plan: Steps of a tick that are executed or skipped, with reasons.
        presets: Reason of each preset of the scene, by the name of the preset.
        preset: Name of the active preset; empty if none is active.
        doubts: Warnings about values that are probably not in SI units; they are printed first.
    """

    scene: str
    faults: tuple[Fault, ...] = ()
    certificates: tuple[Certificate, ...] = ()
    why: str = ""
    notes: tuple[str, ...] = ()
    plan: tuple[PlanRow, ...] = ()
    presets: Mapping[str, str] = field(default_factory=dict)
    preset: str = ""
    doubts: tuple[str, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether there are certificates, and all of them are stable."""
        return self.verdict.startswith(STABLE)

    @property
    def verdict(self) -> str:
        """Result for the least stable object, in one line.

        The line begins with "stable", "NOT STABLE", "not grasping" or "not judged".
        """
        if self.faults:
            count = len(self.faults)
            return f"{NOT_JUDGED}: {count} fault{'s' if count > 1 else ''}, the first {self.faults[0].text(self.scene)}"
        if not self.certificates:
            return f"{NOT_JUDGED}: {self.why}"
        worst, *others = self.certificates
        text = _sentence(worst)
        if others:
            unstable = [each.object for each in others if each.grasps and not each.stable]
            apart = [each.object for each in others if not each.grasps]
            rest = [f"not stable either: {', '.join(unstable)}"] if unstable else []
            rest += [f"{NOT_GRASPING}: {', '.join(apart)}"] if apart else []
            text += f"; {'; '.join(rest) or 'the other objects have larger margins'}"
        return text

    def to_dict(self) -> dict[str, Any]:
        """Return the report as data for JSON. The keys of certificates contain units; inf and nan become None."""
        return {
            "scene": self.scene,
            "ok": self.ok,
            "verdict": self.verdict,
            "faults": [fault.text(self.scene) for fault in self.faults],
            "certificates": [each.to_dict() for each in self.certificates],
            "doubts": list(self.doubts),
            "notes": list(self.notes),
            "plan": [{"step": row.step, "runs": row.runs, "why": row.why} for row in self.plan],
            "presets": dict(self.presets),
            "preset": self.preset,
        }

    def lines(self, plan: bool = True) -> Iterator[str]:
        """Yield the report as lines of text.

        Args:
            plan: Whether to include the plan of a run.
        """
        yield from self.head()
        for certificate in self.certificates:
            yield from lines(certificate)
        for note in self.notes:
            yield f"note: {note}"
        for name, reason in self.presets.items():
            yield f"{'preset':<9}{name + (' (active)' if name == self.preset else ''):<24}{reason}"
        for row in self.plan if plan else ():
            yield f"{'runs' if row.runs else 'skipped':<9}{row.step:<24}{row.why}"

    def head(self) -> Iterator[str]:
        """Yield the first lines of the report: warnings about units, and the result."""
        yield from (f"note: {doubt}" for doubt in self.doubts)
        yield self.verdict

    def _card(self) -> Card:
        runs = listed((row.step for row in self.plan if row.runs), MOST_STEPS)
        skipped = listed((row.step for row in self.plan if not row.runs), MOST_STEPS)
        rows = [
            ("check of", self.scene),
            ("faults", "\n".join(fault.text(self.scene) for fault in self.faults[:MOST_FAULTS])),
            *((each.object, "\n".join(lines(each))) for each in self.certificates),
            ("notes", "\n".join([*self.doubts, *self.notes])),
            ("runs", runs),
            ("skipped", skipped),
        ]
        calls = ".ok, .verdict, .certificates, .notes, .plan, .to_dict(); print(*report.lines(), sep='\\n') shows all"
        return Card(self.verdict, rows, calls)


def check(scene: Scene | str | PathLike[str], overrides: Mapping[str, Any] | None = None) -> Report:
    """Report on the stability of a scene's grasps, the limits of its gains, likely mistakes, and the plan of a run.

    Args:
        scene: Name of a built-in scene, path of a .toml or .py file, or Scene.
        overrides: Values that replace those of the scene, by dotted key, as for `load`.

    Returns:
        Report. If the scene has faults, the report lists them.

    Raises:
        UnknownNameError: If no scene has that name.
        InputError: If the file does not exist, or does not contain a scene.
        PluginError: If a Python file cannot be imported, or its `scene()` raises.
    """
    from graspfx.scene.load import to_scene

    try:
        return report(to_scene(scene, overrides))
    except SceneError as error:
        return Report(error.source, error.faults)


def report(scene: Scene) -> Report:
    """Return the report on a valid scene.

    Raises:
        SceneError: If the scene cannot be assembled, for example because a device cannot reach the start of its finger;
            or if a preset has faults.
    """
    from graspfx.assembly.checks.units import unit_notes
    from graspfx.assembly.grasps import axes_notes
    from graspfx.assembly.resolve import resolve
    from graspfx.certificate.certify import certificates
    from graspfx.certificate.notes import blend_notes, other_doubts
    from graspfx.certificate.plan import engine_plan, plan
    from graspfx.scene.load import preset_faults

    if faults := preset_faults(scene):
        raise SceneError(scene.source.name, faults)
    parts = resolve(scene)
    program = engine_plan(scene)  # places the fingers, as a run does
    why, answers = "", []
    try:
        answers = sorted(certificates(scene), key=_room)
        why = "" if answers else "no finger touches an object"
    except GraspFXError as error:
        why = " ".join(str(error).split())
    units = tuple(unit_notes(scene, parts.stock))
    notes = (*other_doubts(parts), *axes_notes(parts), *blend_notes(parts))
    reasons = {name: preset.reason for name, preset in scene.preset.items()}
    rows = (*plan(scene), *program)
    return Report(scene.source.name, (), tuple(answers), why, notes, rows, reasons, scene.source.preset, units)


def _room(certificate: Certificate) -> tuple[bool, bool, float]:
    """Return a key that sorts certificates: unstable grasps, objects without a finger, stable grasps by margin."""
    least = _least(certificate)
    return certificate.stable, not certificate.grasps, math.inf if least is None else least.margin


def _least(certificate: Certificate) -> Limit | None:
    """Return the limit with the smallest margin, except those of fingers that push alone; None if there is none.

    Of equal margins, that of the most specific mode is returned.
    """
    rows = [row for row in certificate.limits if not row.mode.startswith(PUSHING)]
    return min(rows, key=lambda row: (round(row.margin, 6), -len(row.mode)), default=None)


def _lead(stable: bool, least: Limit) -> str:
    """Return the words that precede the smallest margin in a sentence about the result."""
    if stable:
        return "smallest margin: "
    return "no gain exceeds its limit; smallest margin: " if least.margin > 1.0 else ""


def _sentence(certificate: Certificate) -> str:
    """Return the result of a certificate in one line."""
    if not certificate.grasps:
        return certificate.verdict
    least, stable = _least(certificate), certificate.stable
    text = f"{STABLE if stable else NOT_STABLE}: {certificate.object}, {certificate.radius_text}"
    if least is not None:
        text += f"; {_lead(stable, least)}{least.mode} {least.text}"
    if stable:
        pushing = [row for row in certificate.limits if row.mode.startswith(PUSHING) and row.margin < 1.0]
        if pushing:
            weakest = min(pushing, key=lambda row: row.margin)
            text += f"; stable only while all fingers hold the object: {weakest.mode} is not stable, {weakest.text}"
    if certificate.at == "start":
        text += "; judged at the start without a squeeze"
    return text


def beside(scene: Readable) -> Callable[[str, str], dict[str, Any]]:
    """Return a function that takes the names of an object and a mode, and returns the certified limit of the mode.

    The function returns a dictionary with the keys `spectral_radius`, `gain` [N/m], `limit` [N/m], each None if it is
    not known, and `text`. The certificates of the scene are computed on the first call.
    """

    @cache
    def answer() -> dict[str, Certificate] | str:
        from graspfx.certificate.certify import certificates

        try:
            return {each.object: each for each in certificates(whole_scene(scene))}
        except GraspFXError as error:
            return " ".join(str(error).split())

    def say(name: str, mode: str) -> dict[str, Any]:
        if isinstance(why := answer(), str):
            return {"spectral_radius": None, "gain": None, "limit": None, "text": f"no certificate: {why}"}
        return _answer(why[name], mode)

    return say


def whole_scene(scene: Any) -> Scene:
    """Return a scene as a `Scene`. A scene that was read from the cache of tables is built from its tables."""
    from graspfx.scene.model import Scene

    return scene if isinstance(scene, Scene) else Scene(scene.source, **scene.to_dict())


def _answer(certificate: Certificate, mode: str) -> dict[str, Any]:
    row = _row(certificate, mode)
    radius = certificate.spectral_radius
    verdict = f"certificate: {'stable' if certificate.stable else 'NOT STABLE'}, spectral radius {radius:.6f}"
    numbers = (None, None) if row is None else (row.gain, row.limit)
    gain, limit = (value if value is not None and math.isfinite(value) else None for value in numbers)
    text = verdict if row is None else f"{verdict}; {row.mode} {row.text}"
    return {"spectral_radius": radius, "gain": gain, "limit": limit, "text": text}


def _row(certificate: Certificate, mode: str) -> Limit | None:
    """Return the limit of a mode, or of the mode that contains it ("external" for "external rotation"), or None."""
    rows = {row.mode: row for row in certificate.limits}
    return rows.get(mode) or rows.get(mode.split()[0])
