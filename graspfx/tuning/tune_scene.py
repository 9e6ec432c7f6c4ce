"""Tuning: the largest gains of a scene that keep margins for a set of operators, with independent verification."""

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
    """Find the largest gains with which a scene keeps its margins for every operator of a set.

    Constraints must hold in the worst hand. The search alternates between the best gains for a few hands, and the worst
    hand for these gains in the whole box. The worst hand is added to the few hands up to eight times, until no hand
    violates a constraint (Blankenship and Falk 1976). For one key, roots are bracketed by a grid; several keys use
    sequential quadratic programming from points that sample the box. Each judgement is a certificate at the rest with
    the judged values. New judgements verify the result, including judgements for random hands and with each key 1 %
    beyond the optimum.

    Names are `margin`, `margin.internal`, `margin.external`, `margin.external_translation`, `margin.external_rotation`,
    `margin.standing`, `margin.pushing`, `grip`, `depth` [m], `squeeze` [N], `force` [N], `frequency` [Hz],
    `spectral_radius`, `displayed.stiffness` [N/m] (formulas in `formulas.MEASURES`), gains such as
    `internal.stiffness`, and any numeric key of the scene.

    Args:
        scene: Scene, or its name or path.
        maximise: Formula of names, numbers, + - * / and brackets, at most 400 of them.
        subject_to: Comparisons of formulas by >= or <=, as one comma-separated text or a sequence.
        over: Ranges of the keys that may change, {"internal.stiffness": (50.0, 2000.0)} or a list of "KEY=FROM:TO". By
            default the objective's keys, or both stiffnesses if it has none, from 1/100 to 100 times their values.
        operators: Set of operators as for `certify_operators`; "own" for the scene's own operator. By default, the
            ranges of the scene's table [operators], or else the usual ranges; without hands in the scene, "own".
        seed: Seed of the random hands of the verification.

    Returns:
        A `Tuning`. If the problem is infeasible, the result contains the nearest point and states that no point
        satisfies the constraints.

    Raises:
        InputError: If an expression, a range or the objective is invalid, or the seed is not a non-negative integer.
        UnknownNameError: If a name is neither a measure nor a key.
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
    """Judge the result again, with rounded values, and beyond the optimum."""
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
    """Round the tuned values to six digits towards the side where the constraints hold."""
    if not answer.feasible:
        return values
    exact = problem.values(answer.point)
    for shrink in (0.0, -5e-7, 5e-7, -1e-6, 1e-6):
        trial = {key: float(six_digits(value * (1.0 + shrink))) for key, value in exact.items()}
        if all(problem.least(problem.judged_with(trial, hand)) >= 0.0 for hand in hands):
            return trial
    return values


def _nearest(problem: Problem, constraint: Constraint, number: int, ones: list[Judgement]) -> ConstraintValue:
    """Return a constraint in the hand that comes nearest to violating it."""
    one = min(ones, key=lambda each: problem.slacks(each)[number])
    measures = numbers_of(problem.keys, one)
    left, right = constraint.left.value(measures), constraint.right.value(measures)
    return ConstraintValue(constraint.text, left, right, constraint.slack(measures), one)


def _binding(at: list[ConstraintValue], more: tuple[Check, ...]) -> ConstraintValue | None:
    """Return the constraint that fails beyond the optimum, or else a constraint without slack, or None."""
    broken = [check.broken for check in more if check.broken is not None]
    if broken and len(broken) == len(more):
        first = min(broken, key=lambda value: next(each.slack for each in at if each.text == value.text))
        return next(each for each in at if each.text == first.text)
    least = min(at, key=lambda each: each.slack, default=None)
    return least if least is not None and least.slack <= NEAR else None


def _more(
    problem: Problem, values: Mapping[str, float], ones: Sequence[Judgement], hands: Sequence[Hand]
) -> Iterator[Check]:
    """Judge each key 1 % further in the direction of a larger objective, and find the first violated constraint."""
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
    """Describe the hand in which a result of the search fails, and a remedy."""
    first = min((each for each in at if not each.holds), key=lambda each: each.slack)
    k = next(k for k, one in enumerate(ones) if one is first.judgement)
    origin = "a hand of the search, after rounding to six digits" if k < shaped else "the worst hand found"
    if shaped <= k < shaped + FRESH and len(hands) > shaped:
        origin = f"one of {FRESH} random hands (seed {seed})"
    where = f" in the hand of {numbers(hands[k])}, {origin}" if hands[k] else " in the scene's own hand"
    count = f" in its {shaped} hands" if shaped > 1 else ""
    before = f"the search satisfied all constraints{count}"
    do = "tighten that constraint slightly, or narrow the ranges of operators or of the keys"
    return f"{before}, but {first.text} has a left side of {first.left:.5g}{where}: {do}"


def _reach(problem: Problem, hands: list[Hand]) -> tuple[dict[str, float], int]:
    """Return the best left side of each constraint that is infeasible on its own, and the number of judgements."""
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
