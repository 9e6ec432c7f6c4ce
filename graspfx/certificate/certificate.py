"""A certificate of stability: the limits of a grasp's gains, and what is taken for granted."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from graspfx.card import Card, Carded
from graspfx.certificate.plain_data import plain

if TYPE_CHECKING:
    from graspfx.analysis.passivity.grasp_leak import CouplingLimits

STABLE, NOT_STABLE, NOT_GRASPING = "stable", "NOT STABLE", "not grasping"
STANDING = "standing on"
MOST = 12  # limits on a card
ROUNDING = 1e-11  # what |z| of a motion that neither grows nor decays may exceed 1 by


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
