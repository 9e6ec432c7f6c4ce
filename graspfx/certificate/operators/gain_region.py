"""The share of a population of operators in whose hands each pair of gains k_ep and k_ip is stable."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspfx.certificate.altered_loop import Change, altered
from graspfx.certificate.certificate import is_stable
from graspfx.certificate.judgement import Judge
from graspfx.certificate.linearise import Linearised
from graspfx.certificate.whole_loop import Family, WholeLoop
from graspfx.errors import InputError
from graspfx.progress import waiting
from graspfx.scene.model import Scene

FloatArray = NDArray[np.float64]

HANDS = 60  # of a population that are looked at
MOST_POINTS = 200
LEAST = 0.02  # of the span: where the grid begins


@dataclass(frozen=True, eq=False)
class GainRegion:
    """The share of a population that is stable with each pair of gains.

    Attributes:
        external: k_ep, (n,) [N/m].
        internal: k_ip, (n,) [N/m].
        share: of the hands with which the loop is stable, (external, internal), from 0 to 1.
        hands: how many were looked at.
        present: k_ep and k_ip of the scene [N/m].
    """

    external: FloatArray
    internal: FloatArray
    share: FloatArray
    hands: int
    present: tuple[float, float]

    def to_dict(self) -> dict[str, Any]:
        """Write plain data for JSON."""
        return {
            "external_N_per_m": self.external.tolist(),
            "internal_N_per_m": self.internal.tolist(),
            "share": self.share.tolist(),
            "hands": self.hands,
            "present_N_per_m": list(self.present),
        }


def gain_region(scene: Scene, hands: Sequence[Mapping[str, float]], points: int = 40, span: float = 4.0) -> GainRegion:
    """Tell for a grid of gains in how many of the hands the whole loop is stable.

    Each hand is brought to rest once, with the scene's gains; with others its contacts stay, and its squeeze becomes
    that of hand and k_ip in series (`altered_loop`). So a map takes a linearisation for each hand, not for each pair.

    Args:
        scene: with its gains, which the span is of.
        hands: values by key; of more than 60 the first 60.
        points: along each gain.
        span: times the scene's gain, where the grid ends.

    Raises:
        InputError: gains that are no numbers above zero, points or a span out of range.
    """
    present = tuple(part.stiffness for part in (scene.coupling.external, scene.coupling.internal))
    if not all(isinstance(gain, int | float) and gain > 0.0 for gain in present):
        raise InputError("coupling", present, "gains that are numbers above zero, for a map of them")
    if not 2 <= points <= MOST_POINTS or not span > LEAST:
        raise InputError("points, span", (points, span), f"from 2 to {MOST_POINTS} points and a span above {LEAST}")
    factors = np.linspace(LEAST, 1.0, points) * span
    count = np.zeros((points, points))
    judge = Judge(scene)
    looked_at = list(hands)[:HANDS]
    with judge.session(), waiting("looking at gains", len(looked_at), "hands") as wait:
        for hand in looked_at:
            altered_scene, loops = judge.loops(hand)
            count += np.all([_stable(altered_scene, loop, factors) for loop in loops], axis=0)
            wait.done += 1
    kep, kip = (float(np.asarray(gain)) for gain in present)
    return GainRegion(factors * kep, factors * kip, count / max(len(looked_at), 1), len(looked_at), (kep, kip))


def _stable(scene: Scene, loop: Linearised, factors: FloatArray) -> NDArray[np.bool_]:
    """Tell which pairs of factors (external, internal) are stable."""
    result = np.zeros((len(factors), len(factors)), dtype=bool)
    for j, internal in enumerate(factors.tolist()):
        whole = WholeLoop(altered(scene, loop, Change(internal=internal)), loop.gains)
        family = Family(whole, lambda s, c=internal: loop.stiffness(s, s, c))  # type: ignore[misc]
        radii = np.abs(family.roots(factors)).max(axis=1, initial=0.0)
        result[:, j] = [is_stable(radius) for radius in radii.tolist()]
    return result
