"""A certificate of stability: the limits of a grasp's gains, what it assumes, and how it reads."""

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
MOST = 12  # limits on a card
MOST_PUSHING = 3  # lines about fingers that push alone: more become a range
MOST_GRIPS = 8  # fingers whose margins stand one by one
ROUNDING = 1e-11  # what |z| of a motion that neither grows nor decays may exceed 1 by
PLACES = {
    "squeezed": "squeezed",
    "recorded": "at the rest that the recording ends with",
    "provisional": "provisional, squeezed by one step from the start",
    "start": "at the start, not squeezed",
}
UNITS = {  # keys of plain data that have one
    "gain": "gain_N_per_m",
    "limit": "limit_N_per_m",
    "internal": "internal_N_per_m",
    "external": "external_N_per_m",
    "frequency": "frequency_Hz",
    "fade": "fade_m",
}


def is_stable(radius: float) -> bool:
    """Tell whether a spectral radius is that of a stable loop: margins are sought with the same band of rounding."""
    return radius <= 1.0 + ROUNDING


@dataclass(frozen=True)
class Limit:
    """One mode of a grasp.

    Attributes:
        mode: "internal", "external" (k_ep as it stands in the scene), "external translation" and "external rotation"
            (as if shifts and turns each had a k_ep of their own), "standing on ..." or "pushing with ...".
        gain: as the scene has it: kip, kep, and of standing and pushing the stiffest that is left [N/m]; nan for
            matrices.
        limit: of that gain [N/m]; inf where none is too large.
        margin: limit over gain.
        frequency: at which stability is lost [Hz]; nan without a limit.
        exact: from a mode in closed form, which the whole loop confirms to `difference`; else from the whole loop.
        difference: of the two, relative; nan where there is only one.
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
        """Gain, limit, margin, and the frequency at which stability is lost, in words."""
        gain = "gains as they are" if math.isnan(self.gain) else f"{self.gain:.4g} N/m"
        if math.isinf(self.margin):
            return f"{gain}: no limit"
        limit = "" if math.isnan(self.limit) else f"limit {self.limit:.4g}, "
        lost = "" if math.isnan(self.frequency) else f", lost at {self.frequency:.3g} Hz"
        return f"{gain}: {limit}margin {self.margin:.2f}{lost}"


@dataclass(frozen=True, eq=False, repr=False)
class Certificate(Carded):
    """The certificate of one object of a scene.

    Attributes:
        object: its name.
        at: "squeezed", "recorded", "provisional" or "start".
        spectral_radius: of the loop as it is; up to 1, give or take rounding, it is stable (`is_stable`); nan where no
            finger touches the object, and nothing is judged.
        limits: of every mode.
        assumed: what that takes for granted.
        passive: largest gains that are passive to any operator, or None.
        why_not_passive: in a few words, where there is None.
        grip: f_t/(mu f_n) at rest by the finger's name, 1 on the cone's edge; of fingers with a coefficient.
        edge: the fingers on their cones' edges, which count as sticking.
        notes: what sliding of those could do.
        fade: where free fingers begin to leave the split, and where the forces at rest ask it to [m]; None for neither.
        gap: from the object to the nearest finger where none touches it [m]; else nan.
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
            ("at", self.at if self.at != "provisional" else "provisional: one step from the start; no rest was sought"),
            ("limits", "\n".join([*limits[:MOST], *more])),
            ("granted", "; ".join(self.assumed)),
            ("notes", "\n".join(self.notes)),
        ]
        title = f"Certificate of {self.object}: {self.verdict}"
        return Card(title, rows, ".limits, .passive, .grip, .to_dict()")

    @property
    def stable(self) -> bool:
        """Whether the loop is stable as it is, and also with the object on what carries it at the start."""
        return is_stable(self.spectral_radius) and all(
            row.margin >= 1.0 for row in self.limits if row.mode.startswith(STANDING)
        )

    @property
    def grasps(self) -> bool:
        """Whether a finger touches the object: else there is no grasp to judge."""
        return math.isnan(self.gap)

    @property
    def verdict(self) -> str:
        """The verdict in words: "stable", "NOT STABLE" or "not grasping", and the figure behind it."""
        if not self.grasps:
            where = "at the end of the recording" if self.at == "recorded" else "with the hands closed and still"
            return f"{NOT_GRASPING}: nearest finger {1e3 * self.gap:.3g} mm away from {self.object}, {where}"
        return f"{STABLE if self.stable else NOT_STABLE}, spectral radius {self.spectral_radius:.6f}"

    def to_dict(self) -> dict[str, Any]:
        """Write the certificate for JSON, with units in the names of keys; what is infinite, or no number, is None."""
        fields: dict[str, Any] = plain(self)
        return fields | {"stable": self.stable, "verdict": self.verdict}


def plain(value: Any) -> Any:
    """Write dataclasses, tuples, arrays and numbers as JSON has them; what is infinite, or no number, is None."""
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
    """Write a certificate as lines: one per mode, fingers that push alike in one, of larger sets the weakest."""
    place = f", {PLACES[certificate.at]}" if certificate.grasps else ""
    yield f"stability of {certificate.object}{place}: {certificate.verdict}"
    if not certificate.grasps:
        yield "  where motions bring the fingers to it, certify a recording that ends in the grasp"
        return
    yield from (f"  {row}" for row in limit_lines(certificate.limits))
    if any(row.exact for row in certificate.limits):
        differences = [row.difference for row in certificate.limits if not math.isnan(row.difference)]
        checked = f"; the whole loop has the same limits to {max(differences):.0e}" if differences else ""
        yield f"  internal and external modes by themselves{checked}; pushing by the whole loop"
    elif certificate.limits:
        yield "  by the whole loop, each gain with the others as they are; pushing, what is left of them together"
    yield f"  {_said_of_passivity(certificate)}"
    if certificate.grip:
        yield f"  {_said_of_grip(certificate.grip, certificate.edge)}"
    if certificate.fade is not None:
        begins, required = (1e3 * gap for gap in certificate.fade)
        short = f": too short by {required - begins:.3g} mm" if required > begins else ""
        yield f"  the fade begins at {begins:.3g} mm; the forces at rest ask for {required:.3g} mm{short}"
    yield from (f"  note: {note}" for note in certificate.notes)
    if certificate.assumed:
        yield f"  taken for granted: {'; '.join(certificate.assumed)}"


def _said_of_passivity(certificate: Certificate) -> str:
    passive = certificate.passive
    if passive is None:
        return f"passivity is not judged: {certificate.why_not_passive}"
    values = {"internal": passive.internal, "external": passive.external}
    if all(value == 0.0 for value in values.values()):
        return "passive for any operator: no gain; friction of devices and object does not cover what damping leaks"
    limits = ", ".join(f"{name} up to {value:.4g} N/m" for name, value in values.items() if value < math.inf)
    return f"passive for any operator: {limits}"


def _said_of_grip(grip: Mapping[str, float], edge: Sequence[str]) -> str:
    """Say how near the fingers are to sliding, the nearest first."""
    ranked = sorted(grip.items(), key=lambda item: -round(item[1], 6))  # equal ones in their order
    margins = ", ".join(f"{name} {margin:.2f}" for name, margin in ranked[:MOST_GRIPS])
    more = f", {len(ranked) - MOST_GRIPS} more down to {ranked[-1][1]:.2f}" if len(ranked) > MOST_GRIPS else ""
    on = f"; on the cone's edge, and sticking: {', '.join(edge)}" if edge else ""
    return f"friction in use, f_t/(mu f_n): {margins}{more}{on}"


def limit_lines(limits: Sequence[Limit]) -> Iterator[str]:
    """Write one line for each mode; modes with the same figures in one, of sets of fingers that push the weakest."""
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
    """Select all but the sets of several fingers that push with more room than another set of as many."""
    weakest: dict[int, Limit] = {}
    for row in limits:
        count = max(_count(row), 1)
        if count == 1:
            yield row
        elif count not in weakest or row.margin < weakest[count].margin:
            weakest[count] = row
    yield from weakest.values()


def _count(row: Limit) -> int:
    """Count the fingers that push; 0 for a mode of the whole grasp."""
    return row.mode.count(", ") + 1 if row.mode.startswith(PUSHING) else 0


def _range(rows: Sequence[Limit]) -> str:
    weakest = min(rows, key=lambda row: row.margin)
    gains, limits, margins, lost = (
        _span([getattr(row, name) for row in rows], digits)
        for name, digits in (("gain", ".4g"), ("limit", ".4g"), ("margin", ".2f"), ("frequency", ".3g"))
    )
    name = weakest.mode.removeprefix(PUSHING)
    gain = f"{gains} N/m" if gains else "gains as they are"
    parts = [f"limit {limits}" if limits else "", f"margin {margins}" if margins else "no limit"]
    parts += [f"lost at {lost} Hz" if lost else "", f"the least with {name}" if margins else ""]
    return f"{PUSHING}one of {len(rows)} fingers {gain}: {', '.join(part for part in parts if part)}"


def _span(values: Sequence[float], digits: str) -> str:
    """Write the least and the largest of the finite numbers, as one number where they read the same."""
    finite = [value for value in values if math.isfinite(value)]
    if not finite:
        return ""
    ends = dict.fromkeys(f"{value:{digits}}" for value in (min(finite), max(finite)))
    return " ... ".join([*ends, *(["no limit"] if len(finite) < len(values) else [])])
