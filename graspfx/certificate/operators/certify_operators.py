"""The certificate of a scene over a set of operators: in whose hands is it stable?"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from graspfx import plugins
from graspfx.analysis.arguments import count
from graspfx.card import Card, Carded
from graspfx.certificate.certificate import NOT_GRASPING, NOT_STABLE, STABLE
from graspfx.certificate.certificates import certificates
from graspfx.certificate.judgement import Judge, Judgement
from graspfx.certificate.operators.operator_set import OperatorSet, Ranges, operator_set
from graspfx.certificate.operators.passive_set import are_passive
from graspfx.certificate.operators.share import Share, share_of
from graspfx.certificate.operators.worst_operator import Search, worst_operator
from graspfx.certificate.plain_data import plain
from graspfx.progress import waiting
from graspfx.scene.load import to_scene
from graspfx.scene.model import Scene

if TYPE_CHECKING:
    from graspfx.analysis.passivity.grasp_leak import CouplingLimits
    from graspfx.certificate.operators.gain_region import GainRegion
    from graspfx.certificate.operators.operator_region import OperatorRegion

SAMPLES = 200
QUANTILES = (0.0, 0.05, 0.5, 0.95)


@dataclass(frozen=True, eq=False, repr=False)
class OperatorCertificate(Carded):
    """The certificate of a scene over a set of operators.

    Attributes:
        scene: its name.
        operators: the set.
        own: the judgement with the scene's own operator.
        worst: the judgement of the worst operator that was met, in full; `pushing` as well.
        population: judgements of operators drawn at random by the laws of the ranges, in their order.
        share: of the population that is stable, with its interval.
        box: every judgement of the search for the worst, by its point in the unit box.
        passive: largest gains that are passive to any operator, or None.
        is_passive: whether stability is guaranteed by passivity for the whole set: the scene's gains are no larger than
            `passive`, ranges are of springs, dampers and masses of hands alone, and no hand reacts late or stiffens.
        seed: that the population was drawn with.
    """

    scene: str
    operators: OperatorSet
    own: Judgement
    worst: Judgement
    population: tuple[Judgement, ...]
    share: Share
    box: tuple[tuple[tuple[float, ...], Judgement], ...]
    passive: CouplingLimits | None
    is_passive: bool
    seed: int
    _made_of: Scene

    @property
    def stable(self) -> bool:
        """Whether it is stable in the hands of every operator that was judged."""
        return self.worst.stable and self.share.count == self.share.total

    @property
    def judged(self) -> int:
        """Number of operators that were judged."""
        return len(self.population) + len(self.box)

    @property
    def sentence(self) -> str:
        """The answer to "stable in whose hands?" in a sentence."""
        row = self.worst.worst
        has = f"has {'no gain' if row is None else row.text}"
        if self.worst.at == "apart":
            has = "brings no finger to an object"
        worst = f"the worst operator ({numbers(self.worst.values)}) {has}"
        if self.stable:
            sure = "by passivity" if self.is_passive else f"at least {100 * self.share.low:.3g} % of the population"
            return f"stable in every hand of {self.judged} judged, {sure}; {worst}"
        if self.share.count == 0:
            return f"NOT stable in any hand of the {self.share.total} drawn; {worst}"
        drawn = "every hand drawn" if self.share.count == self.share.total else f"{self.share.text} of the hands"
        return f"stable in {drawn}, NOT in all; {worst}"

    def margins(self, mode: str | None = None) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Give the margin of each operator of the population; of one mode, inf where it has no limit."""
        each = self.population
        return np.array([one.margin if mode is None else one.margin_of(mode) for one in each])

    @property
    def modes(self) -> tuple[str, ...]:
        """The modes that have limits."""
        return tuple(dict.fromkeys(row.limit.mode for one in self.population for row in one.limits))

    def region(self, keys: tuple[str, ...] | None = None, points: int = 24) -> OperatorRegion:
        """Judge a grid over two of the ranges, the scene's own values for the rest: the stable region, to be drawn.

        Args:
            keys: one or two of the operators' keys; the first two if None.
            points: along each.
        """
        from graspfx.certificate.operators.operator_region import operator_region

        return operator_region(self._made_of, self.operators, keys, points)

    def gains(self, points: int = 40, span: float = 4.0) -> GainRegion:
        """Tell for gains k_ep and k_ip up to `span` times the scene's which share of the population is stable."""
        from graspfx.certificate.operators.gain_region import gain_region

        return gain_region(self._made_of, [one.values for one in self.population], points, span)

    def plot(self, path: str | PathLike[str] | None = None, width: str = "screen") -> Any:
        """Draw the margins' distribution and the region over the first two ranges; write it where a path is given."""
        return plugins.upward("OperatorCertificate.plot")(self, path, width)

    def lines(self) -> Iterator[str]:
        """Write the sentence, each mode's margins, and what is guaranteed and what is sampled."""
        yield f"in whose hands? {self.sentence}"
        yield f"  operators {self.operators.source}: {'; '.join(each.text for each in self.operators.ranges)}"
        own = self.own.worst
        stable = STABLE if self.own.stable else NOT_GRASPING if self.own.at == "apart" else NOT_STABLE
        yield f"  the scene's own: {stable}, {'no gain' if own is None else own.text}"
        yield f"  stable: {self.share.count} of {self.share.total} drawn, {self.share.text}"
        for mode in self.modes:
            margins = self.margins(mode)
            figures = ", ".join(
                f"{x:.3g}" if x < math.inf else "none" for x in np.quantile(margins, QUANTILES, method="lower")
            )
            yield f"  {mode}: margin at its least, in 5 %, 50 % and 95 % of the hands {figures}"
        weakest = min(self.worst.pushing, key=lambda row: row.limit.margin, default=None)
        if weakest is not None:
            yield f"  in the worst hands, {weakest.text}"
        loose, restless, apart = (sum(one.at == place for one in self.population) for place in ("start", "", "apart"))
        if loose:
            yield f"  {loose} of {self.share.total} rest without touching: judged at the start"
        if restless:
            yield f"  {restless} of {self.share.total} come to no rest: they count as not stable"
        if apart:
            yield f"  {apart} of {self.share.total} bring no finger to an object: they count as not stable"
        yield f"  {self.guarantee}"

    @property
    def guarantee(self) -> str:
        """A sentence that says what is guaranteed and what is sampled."""
        if self.is_passive:
            return "guaranteed: the gains are passive to any hand of springs, dampers and masses, whatever the ranges"
        return (
            f"sampled: each of {self.judged} operators is judged in full (corners, points that fill the box, a descent "
            "to the worst, a random population); no bound between them. No gain is guaranteed for every operator"
            + (": passivity is not judged" if self.passive is None else " above the passive ones")
        )

    def to_dict(self) -> dict[str, Any]:
        """Write plain data for JSON."""
        return {
            "scene": self.scene,
            "sentence": self.sentence,
            "stable": self.stable,
            "operators": [plain(each) for each in self.operators.ranges],
            "own": judgement_data(self.own),
            "worst": judgement_data(self.worst),
            "share": plain(self.share) | {"value": self.share.value},
            "seed": self.seed,
            "judged": self.judged,
            "is_passive": self.is_passive,
            "margins": {mode: plain(self.margins(mode)) for mode in self.modes},
            "population": [judgement_data(one) for one in self.population],
        }

    def _card(self) -> Card:
        first, *rest = self.lines()
        calls = ".worst, .population, .share, .margins(mode), .region(), .gains(), .plot(path), .to_dict()"
        return Card(f"{self.scene}: {first}", [("", "\n".join(line.strip() for line in rest))], calls)


def certify_operators(
    scene: Scene | str | PathLike[str],
    operators: Ranges | None = None,
    *,
    samples: int = SAMPLES,
    seed: int = 0,
) -> OperatorCertificate:
    """Certify a scene over a set of operators: the worst of them, and the share of a population that is stable.

    Every operator is a scene with other values, at a rest of its own, judged as `certify` does. The worst is sought
    over the whole box of the ranges, not at its corners alone, since margins are not monotone in a hand's stiffness.

    Args:
        scene: from `load`, or made in Python; or its name, or a path.
        operators: ranges by key, {"finger.*.hand.stiffness": (50.0, 1000.0)}, with a law as third item; texts
            "KEY=FROM:TO:LAW"; the scene's table [operators], else the usual ranges of its hands, if None.
        samples: of the random population.
        seed: of it; the same seed gives the same answer.

    Returns:
        An `OperatorCertificate`, whose `.sentence` says in whose hands the scene is stable.

    Raises:
        InputError: ranges that are none, a device that does not tell its mass or friction, samples below 1, a
            seed that is no whole number from zero.
        SceneError: a key or a value that the scene does not take.
    """
    scene_ = to_scene(scene)
    count("samples", samples, 1)
    seed = count("seed", seed)
    set_ = operator_set(scene_, operators)
    judge = Judge(scene_)
    population = []
    with judge.session():
        own = judge.judge({})
        passive = [each.passive for each in certificates(scene_)]
        with waiting("judging operators", samples, "operators") as wait:
            for values in set_.population(samples, seed):
                population.append(judge.judge(values))
                wait.done += 1
        search: Search = worst_operator(set_, judge.judge, lambda one: one.margin)
        least = min(population, key=lambda one: one.margin)
        worst = least if least.margin < search.worst.margin else search.worst
        worst = judge.judge(worst.values, pushing=True)
    share = share_of(sum(one.stable for one in population), samples)
    leak = passive[0] if len(passive) == 1 else None
    is_passive = worst.stable and share.count == samples and are_passive(scene_, set_) and _within(scene_, leak)
    name = (
        scene_.title or scene_.source.name if scene_.source.path is None else scene_.source.path.stem.replace("_", "-")
    )
    return OperatorCertificate(
        name, set_, own, worst, tuple(population), share, search.every, leak, is_passive, seed, scene_
    )


def _within(scene: Scene, passive: CouplingLimits | None) -> bool:
    """Tell whether the gains are passive to any operator."""
    if passive is None:
        return False
    gains = scene.coupling.external.stiffness, scene.coupling.internal.stiffness
    limits = passive.external, passive.internal
    return all(isinstance(g, int | float) and g <= limit for g, limit in zip(gains, limits, strict=True))


def numbers(values: Mapping[str, float]) -> str:
    """Write values by key."""
    return ", ".join(f"{key} = {value:.4g}" for key, value in values.items())


def judgement_data(one: Judgement) -> dict[str, Any]:
    """Write a judgement for JSON."""
    row = one.worst
    return {
        "values": plain(dict(one.values)),
        "stable": one.stable,
        "spectral_radius": plain(one.spectral_radius),
        "margin": plain(one.margin),
        "worst": None if row is None else {"object": row.object, **plain(row.limit)},
        "at": one.at,
    }
