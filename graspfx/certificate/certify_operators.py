"""Certificate of a scene for a set of operators: for which hands, and with which gains, the scene is stable."""

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
    """Proportion of a population that has a property, estimated from a random sample.

    Attributes:
        count: Number of members of the sample that have the property.
        total: Size of the sample.
        low, high: Ends of the confidence interval of Clopper and Pearson (1934), with a confidence of at least 95 %.
    """

    count: int
    total: int
    low: float
    high: float

    @property
    def value(self) -> float:
        """Proportion in the sample."""
        return self.count / self.total

    @property
    def text(self) -> str:
        """Proportion and confidence interval as text, in per cent."""
        return f"{100 * self.value:.3g} % (95 % confidence: {100 * self.low:.3g} to {100 * self.high:.3g} %)"


def share_of(count: int, total: int) -> Share:
    """Return the proportion count/total with its confidence interval.

    If the proportion of the population is at an end of the interval, the binomial probability of a count at least as
    extreme as the observed count is 2.5 %.
    """
    from scipy.special import betaincinv

    tail = (1.0 - CONFIDENCE) / 2.0
    low = 0.0 if count == 0 else float(betaincinv(count, total - count + 1, tail))
    high = 1.0 if count == total else float(betaincinv(count + 1, total - count, 1.0 - tail))
    return Share(count, total, low, high)


@dataclass(frozen=True, eq=False, repr=False)
class OperatorCertificate(Carded):
    """Certificate of a scene for a set of operators.

    Attributes:
        scene: Name of the scene.
        operators: Set of operators, as ranges of keys of the scene.
        own: Judgement with the scene's values.
        worst: Judgement of the worst operator that was found, including limits of fingers that push alone.
        population: Judgements of random operators, in the order in which they were drawn.
        share: Proportion of operators with which the scene is stable, estimated from `population`.
        box: Operators that the search for the worst operator judged. Each is given as its point in the unit box
            (fractions of the ranges) and its judgement.
        passive: Largest gains that are passive for every operator; None if passivity was not analysed.
        is_passive: True if passivity guarantees stability for the whole set. This requires that gains do not exceed
            `passive`, that only springs, dampers and masses of hands vary, and that no hand reacts with a delay or
            stiffens with the grip force.
        seed: Seed of the random population.
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
        """Whether the loop is stable for every operator that was judged."""
        return self.worst.stable and self.share.count == self.share.total

    @property
    def judged(self) -> int:
        """Number of operators that were judged."""
        return len(self.population) + len(self.box)

    @property
    def sentence(self) -> str:
        """Sentence that states for which of the judged operators the scene is stable, and which is the worst."""
        row = self.worst.worst
        has = f"has {'no gain' if row is None else row.text}"
        has = {"apart": "brings no finger to an object", "": "reaches no equilibrium"}.get(self.worst.at, has)
        worst = f"the worst operator ({numbers(self.worst.values)}) {has}"
        if self.stable:
            share = f"and in at least {100 * self.share.low:.3g} % of the population"
            return f"stable in all {self.judged} hands judged, {'by passivity' if self.is_passive else share}; {worst}"
        if self.share.count == 0:
            return f"NOT stable in any of {self.share.total} random hands; {worst}"
        is_all = self.share.count == self.share.total
        drawn = f"all {self.share.total} random hands" if is_all else f"{self.share.text} of the hands"
        return f"stable in {drawn}, NOT in all; {worst}"

    def margins(self, mode: str | None = None) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Return the stability margin with each operator of the population (operators,); inf if there is no limit.

        Args:
            mode: Name of the mode whose margin is returned; if None, the smallest margin of all modes is returned.

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
        """Names of the modes that have a limit for at least one operator of the population."""
        return tuple(dict.fromkeys(row.limit.mode for one in self.population for row in one.limits))

    def region(self, keys: tuple[str, ...] | None = None, points: int = 24) -> OperatorRegion:
        """Compute the stable region over the ranges of one or two keys, with the scene's values of all other keys.

        Args:
            keys: One or two keys of the set of operators; if None, the first two keys (or the only one) are used.
            points: Number of values of each key, from 2 to 200.

        Raises:
            InputError: If there are more than two keys, a key occurs twice, or the number of points is out of range.
            UnknownNameError: If the set of operators does not contain a key.
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
        """Compute, for a grid of gains kep and kip, the proportion of hands with which the scene is stable.

        The first 60 operators of the population are used. The equilibrium is computed once per operator, with the
        scene's gains. For other gains, the contacts are those of this equilibrium, and the squeeze is scaled as for
        springs in series with the stiffness of the hand and kip (`judgement.altered`).

        Args:
            points: Number of values of each gain, from 2 to 200.
            span: Largest gains of the grid, as a multiple of the scene's gains; above 0.02.

        Raises:
            InputError: If a gain of the scene is not a positive number, or `points` or `span` is out of range.
        """
        coupling = self._made_of.coupling
        present = coupling.external.stiffness, coupling.internal.stiffness
        if not all(isinstance(gain, int | float) and gain > 0.0 for gain in present):
            raise InputError("coupling", present, "positive numbers as gains, because the region is computed over them")
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
        """Plot the distribution of margins, and the stable region over the first two keys.

        Args:
            path: Path to which the figure is saved; None if it is not saved.
            width: Width of the figure, as for `gx.plot`.
        """
        from graspfx.show.certificate_figures import operators_sheet
        from graspfx.show.style import save

        drawing = operators_sheet(self, width)
        if path is not None:
            save(drawing, path)
        return drawing

    def lines(self) -> Iterator[str]:
        """Yield lines of text: `sentence`, quantiles of the margins of each mode, and `guarantee`."""
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
            yield f"  {mode}: smallest, 5 %, 50 % and 95 % quantile of the margin over the hands: {figures}"
        weakest = min(self.worst.pushing, key=lambda row: row.limit.margin, default=None)
        if weakest is not None:
            yield f"  in the worst hands, {weakest.text}"
        loose, restless, apart = (sum(one.at == place for one in self.population) for place in ("start", "", "apart"))
        if loose:
            yield f"  {loose} of {self.share.total} leave a finger on hardware off the object: judged at the start"
        if restless:
            yield f"  {restless} of {self.share.total} hands do not come to rest, and are counted as not stable"
        if apart:
            yield f"  {apart} of {self.share.total} hands bring no finger to an object, and are counted as not stable"
        yield f"  {self.guarantee}"

    @property
    def guarantee(self) -> str:
        """Sentence that states whether stability is guaranteed for all operators, or only computed for some."""
        if self.is_passive:
            return "guaranteed: the gains are passive for any hand that consists of springs, dampers and masses"
        return (
            f"sampled: {self.judged} operators were judged (corners and points inside the ranges, a descent to the "
            "worst operator, and a random population); other operators may be worse. "
            + (
                "No gain is guaranteed, because passivity is not judged"
                if self.passive is None
                else "Only passive gains are guaranteed for every operator"
            )
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the certificate as data for JSON."""
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
    """Certify a scene for a set of operators: find the worst operator, and the proportion of stable operators.

    An operator is given by values of keys of the scene, such as the stiffness of a hand. The stability of the scene
    with these values is computed as by `certify`. The search for the worst operator also examines the interior of the
    ranges, because margins are not monotonic in the stiffness of a hand.

    Args:
        scene: Scene, name of a built-in scene, or path of a scene file.
        operators: Ranges by key, such as {"finger.*.hand.stiffness": (50.0, 1000.0)}. An optional third item is the
            distribution (`OperatorRange`). A list of texts "KEY=FROM:TO" or "KEY=FROM:TO:LAW" is also accepted. If
            None, the ranges of the scene's table [operators] are used; a scene without this table has default ranges
            for its hands and device masses.
        samples: Number of random operators.
        seed: Seed of the random operators.

    Returns:
        Certificate. Its attribute `sentence` states for which operators the scene is stable.

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
    """Return whether the scene's gains are numbers that do not exceed the largest passive gains."""
    if passive is None:
        return False
    gains = scene.coupling.external.stiffness, scene.coupling.internal.stiffness
    limits = passive.external, passive.internal
    return all(isinstance(g, int | float) and g <= limit for g, limit in zip(gains, limits, strict=True))


def numbers(values: Mapping[str, float]) -> str:
    """Format values by key, such as `hand.0.grip.stiffness = 100`."""
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
    """Stability margins of a scene over one or two keys of a set of operators.

    Attributes:
        ranges: Range of each key.
        values: Values of each key (points,), evenly spaced, or evenly spaced in the logarithm if the law of the range
            is logarithmic.
        margin: Smallest margin of all modes, (points,) or (points, points); below 1 if the loop is unstable.
        stable: Mask of the points at which the loop is stable, with the shape of `margin`.
    """

    ranges: tuple[OperatorRange, ...]
    values: tuple[FloatArray, ...]
    margin: FloatArray
    stable: NDArray[np.bool_]

    def to_dict(self) -> dict[str, Any]:
        """Return the region as data for JSON."""
        return {
            "keys": [each.key for each in self.ranges],
            "values": [each.tolist() for each in self.values],
            "margin": plain(self.margin),
            "stable": self.stable.tolist(),
        }


@dataclass(frozen=True, eq=False)
class GainRegion:
    """Proportion of operators with which a scene is stable, for pairs of gains.

    Attributes:
        external: Values of kep, (points,) [N/m].
        internal: Values of kip, (points,) [N/m].
        share: Proportion of operators with which the loop is stable, from 0 to 1; entry (i, j) belongs to
            `external[i]` and `internal[j]`.
        hands: Number of operators that were judged.
        present: Gains kep and kip of the scene [N/m].
    """

    external: FloatArray
    internal: FloatArray
    share: FloatArray
    hands: int
    present: tuple[float, float]

    def to_dict(self) -> dict[str, Any]:
        """Return the proportions as data for JSON."""
        fields: dict[str, Any] = plain(self)
        return fields


def _stable(scene: Scene, loop: Linearised, factors: FloatArray) -> NDArray[np.bool_]:
    """Return the mask (external, internal) of pairs of factors of kep and kip with which a loop is stable."""
    result = np.zeros((len(factors), len(factors)), dtype=bool)
    for j, internal in enumerate(factors.tolist()):
        whole = WholeLoop(altered(scene, loop, Change(internal=internal)), loop.gains)
        family = Family(whole, lambda s, c=internal: loop.stiffness(s, s, c))  # type: ignore[misc]
        radii = np.abs(family.roots(factors)).max(axis=1, initial=0.0)
        result[:, j] = [is_stable(radius) for radius in radii.tolist()]
    return result
