"""Tuning: the largest gains with which a scene satisfies constraints, such as margins, for a set of operators."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from os import PathLike

from graspfx.certificate.certify import certificates
from graspfx.certificate.certify_operators import numbers
from graspfx.certificate.judgement import Judgement
from graspfx.certificate.operator_set import OperatorSet, Ranges, operator_set
from graspfx.errors import InputError
from graspfx.numeric import count
from graspfx.progress import waiting
from graspfx.scene.load import to_scene
from graspfx.scene.model import Scene
from graspfx.tuning.formulas import COMPARISON, Constraint, numbers_of, read_constraints, read_expression
from graspfx.tuning.search import MET, Answer, Hand, Problem, search
from graspfx.tuning.tuning import Check, ConstraintValue, Tuning, six_digits

OWN = "own"
USUAL = "margin >= 1.5"
MORE = 1.01  # factor on a key for the verification
NEAR = 2e-3  # a constraint with a larger slack is not active
FRESH = 32  # number of random operators for the verification
SAME = 1e-6  # smaller relative increases of the objective are rounding
TIGHTEST = 6  # number of hands for which values beyond the optimum are judged
EDGE = 1e-6  # distance from the end of a range, relative to the range


def tune(
    scene: Scene | str | PathLike[str],
    maximise: str = "internal.stiffness",
    subject_to: str | Sequence[str] = USUAL,
    *,
    over: Ranges | None = None,
    operators: Ranges | str | None = None,
    seed: int = 0,
) -> Tuning:
    """Find the largest gains with which a scene satisfies constraints for every operator of a set.

    A hand is one operator of the set, that is, values of the operator's parameters. The search alternates between two
    steps: it finds the best gains for a finite set of hands, and then the worst hand for these gains among all
    operators. The worst hand is added to the set, in up to eight rounds, until no hand violates a constraint
    (Blankenship and Falk 1976). Gains are found by a grid and bracketing if one key changes, and by sequential
    quadratic programming from several initial points if more keys change.

    A judgement is a certificate at the equilibrium of the scene for given gains and a given hand. The result is
    verified by new judgements, including those for random hands and for gains that are 1 % beyond the optimum.

    Formulas can use the measures `margin`, `margin.internal`, `margin.external`, `margin.external_translation`,
    `margin.external_rotation`, `margin.standing`, `margin.pushing`, `grip`, `depth` [m], `squeeze` [N], `force` [N],
    `frequency` [Hz], `spectral_radius` and `displayed.stiffness` [N/m], which are defined in `formulas.MEASURES`; gains
    such as `internal.stiffness`; and any key of the scene that is a number.

    Args:
        scene: Scene, or its name or path.
        maximise: Formula to maximise, of names, numbers, + - * / and brackets, at most 400 of them.
        subject_to: Constraints, which compare formulas by >= or <=: a text with commas between them, or a sequence.
        over: Ranges of the keys that may change, such as {"internal.stiffness": (50.0, 2000.0)}, or a list of texts
            "KEY=FROM:TO". By default, the keys in `maximise`, or both stiffnesses if `maximise` contains no keys, from
            1/100 to 100 times their values in the scene.
        operators: Set of operators, as for `certify_operators`; "own" for the scene's own operator. By default, the set
            in the scene's table [operators], or else default ranges; if the scene has no hands, the scene's own
            operator.
        seed: Seed of the random hands in the verification.

    Returns:
        Result of the tuning. If no gains satisfy the constraints, the result states this and contains the gains that
        violate the constraints least.

    Raises:
        InputError: If a formula or a range is invalid, or the seed is not a non-negative integer.
        UnknownNameError: If a name in a formula is neither a measure nor a key of the scene.
        SceneError: If the scene rejects a value.
    """
    scene_, seed = to_scene(scene), count("seed", seed)
    texts = [subject_to] if isinstance(subject_to, str) else subject_to
    if not isinstance(texts, Iterable):
        raise InputError("subject_to", subject_to, COMPARISON)
    constraints = tuple(each for text in texts for each in read_constraints(text))
    objective = read_expression(maximise)
    problem = Problem(scene_, objective, constraints, over, _operators(scene_, operators))
    with problem.session(), waiting(f"tuning {scene_.source.name}", None, "judgements", lambda: float(problem.count)):
        answer = search(problem)
        return _verified(problem, answer, seed)


def _operators(scene: Scene, operators: Ranges | str | None) -> OperatorSet | None:
    if isinstance(operators, str):
        if operators != OWN:
            raise InputError("operators", operators, f"ranges by key, or {OWN!r}")
        return None
    if operators is None and not scene.operators and not (scene.hand or any(each.hand for each in scene.finger)):
        return None  # no simulated operator holds the devices
    return operator_set(scene, operators)


def _verified(problem: Problem, answer: Answer, seed: int) -> Tuning:
    """Verify a result by judgements with rounded values, random hands, and values beyond the optimum."""
    values = {key: float(six_digits(value)) for key, value in problem.values(answer.point).items()}
    hands = list(answer.hands)
    if problem.operators is not None:
        hands += problem.operators.population(FRESH, seed)
        if answer.worst is not None:
            hands.append(dict(problem.operators.values(answer.worst.point)))
    values = _rounded_inwards(problem, answer, values, [*answer.hands, hands[-1]])
    ones = [problem.judged_with(values, hand) for hand in hands]
    at = [_nearest(problem, each, k, ones) for k, each in enumerate(problem.constraints)]
    feasible = all(each.holds for each in at)
    objective = min((problem.objective_of(one) for one in ones), default=math.nan)
    own = problem.judged_with({}, {})
    tightest = sorted(range(len(ones)), key=lambda k: problem.least(ones[k]))[:TIGHTEST]
    more: tuple[Check, ...] = ()
    reach, beyond = ({}, 0) if feasible or answer.feasible else _reach(problem, hands)
    if feasible:
        more = tuple(_more(problem, values, [ones[k] for k in tightest], [hands[k] for k in tightest]))
    end = next((each for each, x in zip(problem.over, answer.point, strict=True) if min(x, 1.0 - x) < EDGE), None)
    return Tuning(
        scene=problem.scene,
        objective=problem.objective.text,
        value=objective,
        before=problem.objective_of(own),
        values=values,
        feasible=feasible,
        constraints=tuple(at),
        binding=_binding(at, more) if feasible else None,
        more=more or (Check({}, None),) * feasible,
        certificates=tuple(certificates(problem.scene.replace({**values, **hands[tightest[0]]})))
        if ones[tightest[0]].at
        else (),
        end=end,
        operators=problem.operators,
        hands=tuple(answer.hands),
        reach=reach,
        refutation=_refutation(at, ones, hands, len(answer.hands), seed) if answer.feasible and not feasible else "",
        judged=problem.count + beyond,
    )


def _rounded_inwards(problem: Problem, answer: Answer, values: dict[str, float], hands: list[Hand]) -> dict[str, float]:
    """Return the tuned values, rounded to six digits in a direction in which the constraints hold for all hands.

    If no direction satisfies the constraints, `values` is returned.
    """
    if not answer.feasible:
        return values
    exact = problem.values(answer.point)
    for shrink in (0.0, -5e-7, 5e-7, -1e-6, 1e-6):
        trial = {key: float(six_digits(value * (1.0 + shrink))) for key, value in exact.items()}
        if all(problem.least(problem.judged_with(trial, hand)) >= 0.0 for hand in hands):
            return trial
    return values


def _nearest(problem: Problem, constraint: Constraint, number: int, ones: list[Judgement]) -> ConstraintValue:
    """Return a constraint in the judgement with the constraint's smallest slack.

    Args:
        number: Index of the constraint in the problem.
        ones: Judgements for different hands.
    """
    one = min(ones, key=lambda each: problem.slacks(each)[number])
    measures = numbers_of(problem.keys, one)
    left, right = constraint.left.value(measures), constraint.right.value(measures)
    return ConstraintValue(constraint.text, left, right, constraint.slack(measures), one)


def _binding(at: list[ConstraintValue], more: tuple[Check, ...]) -> ConstraintValue | None:
    """Return the constraint that limits the objective, or None.

    It is the constraint that fails in each check beyond the optimum, or else the constraint with the smallest slack, if
    this slack is at most `NEAR`.
    """
    broken = [check.broken for check in more if check.broken is not None]
    if broken and len(broken) == len(more):
        first = min(broken, key=lambda value: next(each.slack for each in at if each.text == value.text))
        return next(each for each in at if each.text == first.text)
    least = min(at, key=lambda each: each.slack, default=None)
    return least if least is not None and least.slack <= NEAR else None


def _more(
    problem: Problem, values: Mapping[str, float], ones: Sequence[Judgement], hands: Sequence[Hand]
) -> Iterator[Check]:
    """Change each key by 1 % in the direction that increases the objective, and yield the most violated constraint."""
    before = min(problem.objective_of(one) for one in ones)
    for each in problem.over:
        for factor in (MORE, 1.0 / MORE):
            beyond = {**values, each.key: values[each.key] * factor}
            further = [problem.judged_with(beyond, hand) for hand in hands]
            if min(problem.objective_of(one) for one in further) > before + SAME * abs(before):
                worst = [_nearest(problem, c, k, further) for k, c in enumerate(problem.constraints)]
                broken = min(worst, key=lambda value: value.slack, default=None)
                yield Check(beyond, broken if broken is not None and broken.slack < 0.0 else None, each.key)


def _refutation(
    at: Sequence[ConstraintValue], ones: Sequence[Judgement], hands: Sequence[Hand], shaped: int, seed: int
) -> str:
    """Describe the constraint and the hand for which a result of the search fails in the verification, and a remedy.

    Args:
        shaped: Number of hands in the search, which are the first entries of `hands`.
        seed: Seed of the random hands.
    """
    first = min((each for each in at if not each.holds), key=lambda each: each.slack)
    k = next(k for k, one in enumerate(ones) if one is first.judgement)
    origin = "a hand of the search, with values rounded to six digits" if k < shaped else "the worst hand found"
    if shaped <= k < shaped + FRESH and len(hands) > shaped:
        origin = f"one of {FRESH} random hands (seed {seed})"
    where = f" in the hand of {numbers(hands[k])}, {origin}" if hands[k] else " in the scene's own hand"
    count = f" in its {shaped} hands" if shaped > 1 else ""
    before = f"the search satisfied all constraints{count}"
    do = "tighten that constraint slightly, or narrow the ranges of operators or of the keys"
    return f"{before}, but {first.text} has a left side of {first.left:.5g}{where}: {do}"


def _reach(problem: Problem, hands: list[Hand]) -> tuple[dict[str, float], int]:
    """Find the constraints that are infeasible even without the other constraints.

    Returns:
        For the text of each such constraint, the best value of its left side; and the number of judgements.
    """
    result: dict[str, float] = {}
    count = 0
    for each in problem.constraints:
        alone = Problem(problem.scene, each.room, (), list(problem.over), problem.operators)
        with alone.session():
            best = search(alone)
            ones = [alone.judged(best.point, hand) for hand in hands]
            slack = min(each.slack(numbers_of(problem.keys, one)) for one in ones)
            if slack < -MET:
                worst = min(ones, key=lambda one: each.slack(numbers_of(problem.keys, one)))
                result[each.text] = each.left.value(numbers_of(problem.keys, worst))
        count += alone.count
    return result, count
