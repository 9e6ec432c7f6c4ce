"""Certificate of a scene over a set of operators: in whose hands it is stable, and with which gains."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.card import Card, Carded
from graspfx.certificate.certificate import NOT_GRASPING, NOT_STABLE, STABLE, is_stable, plain
from graspfx.certificate.certify import certificates, name_of
from graspfx.certificate.first_loss import Family, WholeLoop
from graspfx.certificate.judgement import Change, Judge, Judgement, altered
from graspfx.certificate.linearise import Linearised
from graspfx.certificate.operator_set import (
    OperatorRange,
    OperatorSet,
    Ranges,
    are_passive,
    operator_set,
    worst_operator,
)
from graspfx.errors import InputError, UnknownNameError
from graspfx.numeric import count, number
from graspfx.progress import waiting
from graspfx.scene.load import to_scene
from graspfx.scene.model import Scene

if TYPE_CHECKING:
    from graspfx.analysis.passivity.grasp_leak import CouplingLimits

FloatArray = NDArray[np.float64]

SAMPLES = 200
QUANTILES = (0.0, 0.05, 0.5, 0.95)
CONFIDENCE = 0.95
HANDS = 60  # largest number of hands of a population that are judged with other gains
MOST_POINTS = 200  # largest number of points of a region along each key
GRASPING = ("internal", "external", "external translation", "external rotation")  # modes that any grasp may have
LEAST = 0.02  # start of the grid of gains, relative to its span


@dataclass(frozen=True)
class Share:
    """Share of a population that has a property, estimated from a random sample.

    Attributes:
        count: Number of members of the sample that have the property.
        total: Size of the sample.
        low, high: Interval of Clopper and Pearson (1934) with a confidence of at least 95 %.
    """

    count: int
    total: int
    low: float
    high: float

    @property
    def value(self) -> float:
        """Share in the sample."""
        return self.count / self.total

    @property
    def text(self) -> str:
        """Share and its interval in per cent."""
        return f"{100 * self.value:.3g} % (95 % confidence: {100 * self.low:.3g} to {100 * self.high:.3g} %)"


def share_of(count: int, total: int) -> Share:
    """Return the share and its interval; at each end, the count has a binomial tail probability of 2.5 %."""
    from scipy.special import betaincinv

    tail = (1.0 - CONFIDENCE) / 2.0
    low = 0.0 if count == 0 else float(betaincinv(count, total - count + 1, tail))
    high = 1.0 if count == total else float(betaincinv(count + 1, total - count, 1.0 - tail))
    return Share(count, total, low, high)


@dataclass(frozen=True, eq=False, repr=False)
class OperatorCertificate(Carded):
    """Certificate of a scene over a set of operators.

    Attributes:
        scene: Name of the scene.
        operators: Set of operators.
        own: Judgement with the scene's own operator.
        worst: Full judgement of the worst operator that was found, including `pushing`.
        population: Judgements of random operators, drawn from the distributions of the ranges, in the order in which
            they were drawn.
        share: Share of the population that is stable, with its interval.
        box: All judgements of the search for the worst operator, by the operator's point in the unit box.
        passive: Largest gains that are passive for every operator, or None.
        is_passive: True if passivity guarantees stability for the whole set. This requires that gains do not exceed
            `passive`, that only springs, dampers and masses of hands vary, and that no hand reacts with a delay or
            stiffens.
        seed: Seed of the population.
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
        """True if the loop is stable for every operator that was judged."""
        return self.worst.stable and self.share.count == self.share.total

    @property
    def judged(self) -> int:
        """Number of operators that were judged."""
        return len(self.population) + len(self.box)

    @property
    def sentence(self) -> str:
        """Answer to "stable in whose hands?" in one sentence."""
        row = self.worst.worst
        has = f"has {'no gain' if row is None else row.text}"
        has = {"apart": "brings no finger to an object", "": "comes to no rest"}.get(self.worst.at, has)
        worst = f"the worst operator ({numbers(self.worst.values)}) {has}"
        if self.stable:
            sure = "by passivity" if self.is_passive else f"at least {100 * self.share.low:.3g} % of the population"
            return f"stable in every hand of {self.judged} judged, {sure}; {worst}"
        if self.share.count == 0:
            return f"NOT stable in any hand of the {self.share.total} drawn; {worst}"
        drawn = "every hand drawn" if self.share.count == self.share.total else f"{self.share.text} of the hands"
        return f"stable in {drawn}, NOT in all; {worst}"

    def margins(self, mode: str | None = None) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Return the margin of each operator of the population, or its margin of one mode; inf if there is no limit.

        Raises:
            UnknownNameError: If no mode has that name.
        """
        each = self.population
        if mode is not None:
            found = {row.limit.mode for one in each for row in (*one.limits, *one.pushing)}
            if str(mode) not in (known := found | set(GRASPING)):
                raise UnknownNameError("mode", mode, known)
        return np.array([one.margin if mode is None else one.margin_of(mode) for one in each])

    @property
    def modes(self) -> tuple[str, ...]:
        """Names of the modes that have limits."""
        return tuple(dict.fromkeys(row.limit.mode for one in self.population for row in one.limits))

    def region(self, keys: tuple[str, ...] | None = None, points: int = 24) -> OperatorRegion:
        """Compute the stable region over one or two ranges, with the scene's own values for all other keys.

        Args:
            keys: One or two of the operators' keys; the first two if None.
            points: Number of points along each key.

        Raises:
            InputError: If the number of keys, or of points, is out of range.
            UnknownNameError: If a key is not in the set.
        """
        points = count("points", points, 2)
        if points > MOST_POINTS:
            raise InputError("points", points, f"from 2 to {MOST_POINTS}")
        by_key = {each.key: each for each in self.operators.ranges}
        selection = self.operators.keys[:2] if keys is None else tuple(keys) if hasattr(keys, "__iter__") else ()
        if not all(isinstance(key, str) for key in selection) or not 1 <= len(set(selection)) == len(selection) <= 2:
            raise InputError("keys", keys, "one or two different keys of the set")
        for key in selection:
            if key not in by_key:
                raise UnknownNameError("key of the operators", key, by_key)
        ranges = tuple(by_key[key] for key in selection)
        values = tuple(each.between(np.linspace(0.0, 1.0, points)) for each in ranges)
        shape = (points,) * len(ranges)
        margin, stable = np.zeros(shape), np.zeros(shape, dtype=bool)
        judge = Judge(self._made_of)
        with judge.session(), waiting(f"judging hands over {' and '.join(selection)}", margin.size, "hands") as wait:
            for place in np.ndindex(*shape):
                one = judge.judge({key: float(x[i]) for key, x, i in zip(selection, values, place, strict=True)})
                margin[place], stable[place] = one.margin, one.stable
                wait.done += 1
        return OperatorRegion(ranges, values, margin, stable)

    def gains(self, points: int = 40, span: float = 4.0) -> GainRegion:
        """Compute the stable share of the population for gains k_ep and k_ip up to `span` times the scene's gains.

        Each of the first 60 hands is brought to rest once, with the scene's gains. For other gains, contacts are kept,
        and the squeeze is computed from the stiffnesses of hand and k_ip in series (`judgement.altered`). Therefore
        each hand is linearised once, not once per pair of gains.

        Args:
            points: Number of points along each gain.
            span: End of the grid, as a multiple of the scene's gains.

        Raises:
            InputError: If gains are not numbers above zero, or points or span are out of range.
        """
        coupling = self._made_of.coupling
        present = coupling.external.stiffness, coupling.internal.stiffness
        if not all(isinstance(gain, int | float) and gain > 0.0 for gain in present):
            raise InputError("coupling", present, "gains that are positive numbers, for a map over the gains")
        points, span = count("points", points, 2), number("span", span, f"a factor above {LEAST}")
        if points > MOST_POINTS or not span > LEAST:
            raise InputError("points, span", (points, span), f"from 2 to {MOST_POINTS} points and a span above {LEAST}")
        factors = np.linspace(LEAST, 1.0, points) * span
        stable = np.zeros((points, points))
        judge, hands = Judge(self._made_of), [one.values for one in self.population[:HANDS]]
        with judge.session(), waiting("looking at gains", len(hands), "hands") as wait:
            for hand in hands:
                scene, loops = judge.loops(hand)
                stable += np.all([_stable(scene, loop, factors) for loop in loops], axis=0)
                wait.done += 1
        kep, kip = (float(np.asarray(gain)) for gain in present)
        return GainRegion(factors * kep, factors * kip, stable / len(hands), len(hands), (kep, kip))

    def plot(self, path: str | PathLike[str] | None = None, width: str = "screen") -> Any:
        """Plot the distribution of margins, and the region over the first two ranges; a given path saves the figure."""
        from graspfx.show.certificate_figures import operators_sheet
        from graspfx.show.style import save

        drawing = operators_sheet(self, width)
        if path is not None:
            save(drawing, path)
        return drawing

    def lines(self) -> Iterator[str]:
        """Yield the sentence, each mode's margins, and the guarantee."""
        yield f"in whose hands? {self.sentence}"
        yield f"  operators {self.operators.source}: {'; '.join(each.text for each in self.operators.ranges)}"
        own = self.own.worst
        known = STABLE if self.own.stable else NOT_STABLE
        stable = {"apart": NOT_GRASPING, "": "no rest"}.get(self.own.at, known)
        yield f"  the scene's own: {stable}, {'no gain' if own is None else own.text}"
        yield f"  stable: {self.share.count} of {self.share.total} drawn, {self.share.text}"
        for mode in self.modes:
            margins = self.margins(mode)
            figures = ", ".join(
                f"{x:.3g}" if x < math.inf else "none" for x in np.quantile(margins, QUANTILES, method="lower")
            )
            yield f"  {mode}: least margin, and its 5 %, 50 % and 95 % quantiles over the hands {figures}"
        weakest = min(self.worst.pushing, key=lambda row: row.limit.margin, default=None)
        if weakest is not None:
            yield f"  in the worst hands, {weakest.text}"
        loose, restless, apart = (sum(one.at == place for one in self.population) for place in ("start", "", "apart"))
        if loose:
            yield f"  {loose} of {self.share.total} leave a real device's finger off its object: judged at the start"
        if restless:
            yield f"  {restless} of {self.share.total} do not come to rest, and are counted as not stable"
        if apart:
            yield f"  {apart} of {self.share.total} bring no finger to an object, and are counted as not stable"
        yield f"  {self.guarantee}"

    @property
    def guarantee(self) -> str:
        """Sentence about what is guaranteed and what is sampled."""
        if self.is_passive:
            return "guaranteed: the gains are passive for any hand of springs, dampers and masses, whatever the ranges"
        return (
            f"sampled: each of {self.judged} operators is judged in full (corners, points that fill the box, a descent "
            "to the worst, a random population); no bound between them. No gain is guaranteed for every operator"
            + (": passivity is not judged" if self.passive is None else " above the passive ones")
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
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
    """Certify a scene over a set of operators: the worst operator, and the stable share of a population.

    For each operator, the scene gets the operator's values, is brought to rest, and is judged as by `certify`. The
    search for the worst operator covers the whole box of the ranges, not only its corners, because margins are not
    monotonic in a hand's stiffness.

    Args:
        scene: Scene, name of a built-in scene, or path.
        operators: Ranges by key, {"finger.*.hand.stiffness": (50.0, 1000.0)}, with an optional distribution ("law") as
            third item; or texts "KEY=FROM:TO:LAW". If None, the ranges of the scene's table [operators] are used, or
            else the usual ranges of its hands.
        samples: Size of the random population.
        seed: Seed of the population; the same seed gives the same result.

    Returns:
        `OperatorCertificate`, whose `.sentence` states in whose hands the scene is stable.

    Raises:
        InputError: If ranges are invalid, a device does not state its mass or friction, the number of samples is below
            1, or the seed is not a non-negative integer.
        SceneError: If the scene does not accept a key or a value.
    """
    scene_ = to_scene(scene)
    count("samples", samples, 1)
    seed = count("seed", seed)
    set_ = operator_set(scene_, operators)
    judge = Judge(scene_)
    population = []
    with judge.session():
        own = judge.judge({})
        passive = [each.passive for each in certificates(scene_)] if own.at else []
        with waiting("judging operators", samples, "operators") as wait:
            for values in set_.population(samples, seed):
                population.append(judge.judge(values))
                wait.done += 1
        search = worst_operator(set_, judge.judge, lambda one: one.margin)
        least = min(population, key=lambda one: one.margin)
        worst = least if least.margin < search.worst.margin else search.worst
        worst = judge.judge(worst.values, pushing=True)
    share = share_of(sum(one.stable for one in population), samples)
    leak = passive[0] if len(passive) == 1 else None
    is_passive = worst.stable and share.count == samples and are_passive(scene_, set_) and _within(scene_, leak)
    return OperatorCertificate(
        name_of(scene_), set_, own, worst, tuple(population), share, search.every, leak, is_passive, seed, scene_
    )


def _within(scene: Scene, passive: CouplingLimits | None) -> bool:
    """True if the gains are passive for every operator."""
    if passive is None:
        return False
    gains = scene.coupling.external.stiffness, scene.coupling.internal.stiffness
    limits = passive.external, passive.internal
    return all(isinstance(g, int | float) and g <= limit for g, limit in zip(gains, limits, strict=True))


def numbers(values: Mapping[str, float]) -> str:
    """Format values by key."""
    return ", ".join(f"{key} = {value:.4g}" for key, value in values.items())


def judgement_data(one: Judgement) -> dict[str, Any]:
    """Return a judgement as data for JSON."""
    row = one.worst
    return {
        "values": plain(dict(one.values)),
        "stable": one.stable,
        "spectral_radius": plain(one.spectral_radius),
        "margin": plain(one.margin),
        "worst": None if row is None else {"object": row.object, **plain(row.limit)},
        "at": one.at,
    }


# Regions -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class OperatorRegion:
    """Margins over one or two keys of a set of operators, with the scene's values for the others.

    Attributes:
        ranges: One or two ranges, divided evenly, on a logarithmic scale if their law is logarithmic.
        values: Values of each range, (n,).
        margin: Smallest margin of all modes at each point, (n,) or (n1, n2); below 1 if the loop is unstable.
        stable: Mask of the points with a stable loop, with the shape of `margin`.
    """

    ranges: tuple[OperatorRange, ...]
    values: tuple[FloatArray, ...]
    margin: FloatArray
    stable: NDArray[np.bool_]

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return {
            "keys": [each.key for each in self.ranges],
            "values": [each.tolist() for each in self.values],
            "margin": plain(self.margin),
            "stable": self.stable.tolist(),
        }


@dataclass(frozen=True, eq=False)
class GainRegion:
    """Share of a population that is stable with each pair of gains.

    Attributes:
        external: Gains k_ep, (n,) [N/m].
        internal: Gains k_ip, (n,) [N/m].
        share: Share of hands with which the loop is stable, (external, internal), from 0 to 1.
        hands: Number of hands that were judged.
        present: Gains k_ep and k_ip of the scene [N/m].
    """

    external: FloatArray
    internal: FloatArray
    share: FloatArray
    hands: int
    present: tuple[float, float]

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        fields: dict[str, Any] = plain(self)
        return fields


def _stable(scene: Scene, loop: Linearised, factors: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of pairs of factors (external, internal) that are stable."""
    result = np.zeros((len(factors), len(factors)), dtype=bool)
    for j, internal in enumerate(factors.tolist()):
        whole = WholeLoop(altered(scene, loop, Change(internal=internal)), loop.gains)
        family = Family(whole, lambda s, c=internal: loop.stiffness(s, s, c))  # type: ignore[misc]
        radii = np.abs(family.roots(factors)).max(axis=1, initial=0.0)
        result[:, j] = [is_stable(radius) for radius in radii.tolist()]
    return result
