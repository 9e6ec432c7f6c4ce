"""Certificate of stability of a grasped object: limits of the gains and assumptions, as data and as text."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from graspfx.card import Card, Carded

if TYPE_CHECKING:
    from graspfx.analysis.passivity.grasp_leak import CouplingLimits

STABLE, NOT_STABLE, NOT_GRASPING = "stable", "NOT STABLE", "not grasping"
STANDING, PUSHING = "standing on", "pushing with "
MOST = 12  # largest number of limits shown on a card
MOST_PUSHING = 3  # largest number of lines about single pushing fingers; more are joined to one line of ranges
MOST_GRIPS = 8  # largest number of fingers whose margins are shown one by one
ROUNDING = 1e-11  # excess of |z| over 1 that rounding causes in a motion of constant size
PLACES = {
    "squeezed": "squeezed",
    "recorded": "in the state at the end of the recording",
    "provisional": "provisional, in a state approximated by one step from the start",
    "start": "at the start, not squeezed",
}
UNITS = {  # names of fields in plain data, with their units
    "gain": "gain_N_per_m",
    "limit": "limit_N_per_m",
    "internal": "internal_N_per_m",
    "external": "external_N_per_m",
    "frequency": "frequency_Hz",
    "fade": "fade_m",
    "present": "present_N_per_m",
}


def is_stable(radius: float) -> bool:
    """Return whether a loop with this spectral radius is stable: at most 1, with a tolerance for rounding errors."""
    return radius <= 1.0 + ROUNDING


@dataclass(frozen=True)
class Limit:
    """Stability limit of one mode of a grasp.

    Attributes:
        mode: Name of the mode: "internal"; "external"; "external translation" and "external rotation", for which kep is
            scaled in translations only and in rotations only; "standing on ...", with the names of supports; or
            "pushing with ...", with the names of the fingers that push while the others exert no force.
        gain: Gain of the scene [N/m]: kip for "internal" and kep for "external..."; nan if that gain is a matrix. For
            "standing on ..." and "pushing with ...", it is the largest eigenvalue of the stiffness matrix.
        limit: Stability limit of the gain [N/m]; inf if every larger gain is stable.
        margin: Limit divided by gain.
        frequency: Frequency of the oscillation at the limit [Hz]; nan if there is no limit.
        exact: True if the limit was computed in closed form for a separate mode; False if it was found by a search over
            factors of the gain in the whole loop.
        difference: Relative difference between the limit in closed form and that of the search; nan unless both were
            computed.
    """

    mode: str
    gain: float
    limit: float
    margin: float
    frequency: float
    exact: bool
    difference: float = math.nan

    @property
    def text(self) -> str:
        """Gain, limit, margin and frequency as text."""
        gain = "present gains" if math.isnan(self.gain) else f"{self.gain:.4g} N/m"
        if math.isinf(self.margin):
            return f"{gain}: no limit"
        limit = "" if math.isnan(self.limit) else f"limit {self.limit:.4g}, "
        lost = "" if math.isnan(self.frequency) else f", lost at {self.frequency:.3g} Hz"
        return f"{gain}: {limit}margin {self.margin:.2f}{lost}"


@dataclass(frozen=True, eq=False, repr=False)
class Certificate(Carded):
    """Stability of the grasp of one object of a scene.

    Attributes:
        object: Name of the object.
        at: State in which the grasp is judged: "squeezed", "recorded", "provisional" or "start" (`certify`).
        spectral_radius: Spectral radius of the sampled loop with the scene's gains. The loop is stable if the spectral
            radius is at most 1, apart from rounding. nan if no finger touches the object.
        limits: Stability limits of all modes of the grasp.
        assumed: Assumptions of the analysis, as sentences.
        passive: Largest gains that are passive for every operator; None if passivity was not analysed.
        why_not_passive: Reason why passivity was not analysed; empty if `passive` is given.
        grip: Tangential force divided by mu times normal force, by name of the finger, in the judged state. The ratio
            is 1 on the edge of the friction cone. Fingers without a coefficient of friction mu are omitted.
        edge: Names of the fingers whose forces lie on the edges of their friction cones. Their contacts are treated as
            sticking.
        notes: Possible consequences if the contacts of the fingers in `edge` slide, and the geometric stiffness that
            the contact forces add to a specified stiffness of the object.
        fade: Two gaps [m]: the gap at which a free finger begins to fade out of the grasp, and the smallest gap at
            which it may begin to do so with the forces of the judged state. None if fingers do not fade.
        gap: Distance from the object to the nearest finger [m] if no finger touches the object; otherwise nan.
    """

    object: str
    at: str
    spectral_radius: float
    limits: tuple[Limit, ...]
    assumed: tuple[str, ...]
    passive: CouplingLimits | None
    why_not_passive: str = ""
    grip: Mapping[str, float] = field(default_factory=dict)
    edge: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    fade: tuple[float, float] | None = None
    gap: float = math.nan

    def _card(self) -> Card:
        limits = [f"{row.mode} {row.text}" for row in self.limits]
        more = [f"and {len(limits) - MOST} more in .limits"] if len(limits) > MOST else []
        rows = [
            ("at", self.at if self.at != "provisional" else "provisional: approximated by one step from the start"),
            ("limits", "\n".join([*limits[:MOST], *more])),
            ("assumed", "; ".join(self.assumed)),
            ("notes", "\n".join(self.notes)),
        ]
        title = f"Certificate of {self.object}: {self.verdict}"
        return Card(title, rows, ".limits, .passive, .grip, .to_dict()")

    @property
    def stable(self) -> bool:
        """Whether the loop is stable with the scene's gains, in the air and, if any, on the support at the start."""
        return is_stable(self.spectral_radius) and all(
            row.margin >= 1.0 for row in self.limits if row.mode.startswith(STANDING)
        )

    @property
    def grasps(self) -> bool:
        """Whether a finger touches the object. If not, there is no grasp whose stability could be judged."""
        return math.isnan(self.gap)

    @property
    def verdict(self) -> str:
        """Result as text: "stable" or "NOT STABLE" with the spectral radius, or "not grasping" with the gap."""
        if not self.grasps:
            where = "at the end of the recording" if self.at == "recorded" else "with the hands closed and still"
            return f"{NOT_GRASPING}: nearest finger {1e3 * self.gap:.3g} mm away from {self.object}, {where}"
        return f"{STABLE if self.stable else NOT_STABLE}, {self.radius_text}"

    @property
    def radius_text(self) -> str:
        """Spectral radius as text. If the grasp is unstable only on the support, the text ends with "in the air"."""
        air = " in the air" if not self.stable and is_stable(self.spectral_radius) else ""
        return f"spectral radius {self.spectral_radius:.6f}{air}"

    def to_dict(self) -> dict[str, Any]:
        """Return the certificate as data for JSON. The keys contain units; inf and nan are replaced by None."""
        fields: dict[str, Any] = plain(self)
        return fields | {"stable": self.stable, "verdict": self.verdict}


def plain(value: Any) -> Any:
    """Convert dataclasses, sequences, arrays and numbers to types of JSON; inf and nan are replaced by None."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        return {UNITS.get(name, name): plain(each) for name, each in fields.items()}
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(each) for each in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


# A certificate as text ----------------------------------------------------------------------------------------------


def lines(certificate: Certificate) -> Iterator[str]:
    """Yield a certificate as lines of text."""
    place = f", {PLACES[certificate.at]}" if certificate.grasps else ""
    yield f"stability of {certificate.object}{place}: {certificate.verdict}"
    if not certificate.grasps:
        yield "  if motions bring the fingers to the object, certify a recording that ends in the grasp"
        return
    yield from (f"  {row}" for row in limit_lines(certificate.limits))
    if any(row.exact for row in certificate.limits):
        differences = [row.difference for row in certificate.limits if not math.isnan(row.difference)]
        checked = f"; the whole loop has the same limits to {max(differences):.0e}" if differences else ""
        yield f"  internal and external limits from separate modes{checked}; pushing limits from the whole loop"
    elif certificate.limits:
        yield "  limits from the whole loop, each for one gain with the others fixed; pushing limits for all gains"
    if any(row.limit == 0.0 for row in certificate.limits):
        yield (
            "  limit 0: with the other gains as they are, no value of this gain is stable; change several gains and "
            "dampings together, the period, or the object's integrator"
        )
    yield f"  {_said_of_passivity(certificate)}"
    if certificate.grip:
        yield f"  {_said_of_grip(certificate.grip, certificate.edge)}"
    if certificate.fade is not None:
        begins, required = (1e3 * gap for gap in certificate.fade)
        short = f": too short by {required - begins:.3g} mm" if required > begins else ""
        yield f"  the fade begins at {begins:.3g} mm; the forces at rest require {required:.3g} mm{short}"
    yield from (f"  note: {note}" for note in certificate.notes)
    if certificate.assumed:
        yield f"  assumptions: {'; '.join(certificate.assumed)}"


def _said_of_passivity(certificate: Certificate) -> str:
    passive = certificate.passive
    if passive is None:
        return f"passivity is not judged: {certificate.why_not_passive}"
    values = {"internal": passive.internal, "external": passive.external}
    if all(value == 0.0 for value in values.values()):
        return "passive for any operator: no gain; friction does not dissipate the energy that sampling creates"
    limits = ", ".join(f"{name} up to {value:.4g} N/m" for name, value in values.items() if value < math.inf)
    return f"passive for any operator: {limits}"


def _said_of_grip(grip: Mapping[str, float], edge: Sequence[str]) -> str:
    """Return a text with the share of the available friction that each finger uses, in descending order."""
    ranked = sorted(grip.items(), key=lambda item: -round(item[1], 6))  # ties keep their order
    margins = ", ".join(f"{name} {margin:.2f}" for name, margin in ranked[:MOST_GRIPS])
    more = f", {len(ranked) - MOST_GRIPS} more down to {ranked[-1][1]:.2f}" if len(ranked) > MOST_GRIPS else ""
    on = f"; on the cone's edge, assumed to stick: {', '.join(edge)}" if edge else ""
    return f"friction in use, f_t/(mu f_n): {margins}{more}{on}"


def limit_lines(limits: Sequence[Limit]) -> Iterator[str]:
    """Yield a line of text for each mode; modes with equal numbers are listed on one line.

    Of the sets of several pushing fingers, only the set with the smallest margin is listed for each number of fingers.
    If single pushing fingers need more than `MOST_PUSHING` lines, one line with the ranges of their numbers replaces
    these lines.
    """
    alike: dict[str, list[Limit]] = {}
    for row in _worth_saying(limits):
        alike.setdefault(row.text, []).append(row)
    single = {text: rows for text, rows in alike.items() if all(_count(row) == 1 for row in rows)}
    folds = len(single) > MOST_PUSHING
    for text, rows in alike.items():
        if folds and text in single:
            if text == next(iter(single)):
                yield _range([row for each in single.values() for row in each])
            continue
        first, *others = (row.mode for row in rows)
        yield f"{' | '.join([first, *(name.removeprefix(PUSHING) for name in others)])} {text}"


def _worth_saying(limits: Sequence[Limit]) -> Iterator[Limit]:
    """Yield all limits, but of the sets of two or more pushing fingers only that with the smallest margin per size."""
    weakest: dict[int, Limit] = {}
    for row in limits:
        count = max(_count(row), 1)
        if count == 1:
            yield row
        elif count not in weakest or row.margin < weakest[count].margin:
            weakest[count] = row
    yield from weakest.values()


def _count(row: Limit) -> int:
    """Return the number of fingers that push in a mode, or 0 if the mode is one of the whole grasp."""
    return row.mode.count(", ") + 1 if row.mode.startswith(PUSHING) else 0


def _range(rows: Sequence[Limit]) -> str:
    weakest = min(rows, key=lambda row: row.margin)
    gains, limits, margins, lost = (
        _span([getattr(row, name) for row in rows], digits)
        for name, digits in (("gain", ".4g"), ("limit", ".4g"), ("margin", ".2f"), ("frequency", ".3g"))
    )
    name = weakest.mode.removeprefix(PUSHING)
    gain = f"{gains} N/m" if gains else "present gains"
    parts = [f"limit {limits}" if limits else "", f"margin {margins}" if margins else "no limit"]
    parts += [f"lost at {lost} Hz" if lost else "", f"smallest with {name}" if margins else ""]
    return f"{PUSHING}one of {len(rows)} fingers {gain}: {', '.join(part for part in parts if part)}"


def _span(values: Sequence[float], digits: str) -> str:
    """Format the range of the finite values; "no limit" is appended if some values are not finite."""
    finite = [value for value in values if math.isfinite(value)]
    if not finite:
        return ""
    ends = dict.fromkeys(f"{value:{digits}}" for value in (min(finite), max(finite)))
    return " ... ".join([*ends, *(["no limit"] if len(finite) < len(values) else [])])
