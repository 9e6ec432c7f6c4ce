"""Result of a tuning: tuned gains, the constraints at the optimum, and the constraint that limits the objective."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from graspfx.card import Card, Carded
from graspfx.certificate.certificate import PUSHING, STANDING, Certificate, Limit, plain
from graspfx.certificate.certify_operators import judgement_data, numbers
from graspfx.certificate.judgement import Judgement, ObjectLimit
from graspfx.certificate.operator_set import OperatorRange, OperatorSet
from graspfx.scene.model import Scene

ROUNDING = 1e-5  # tolerance relative to a bound


@dataclass(frozen=True)
class ConstraintValue:
    """Values of a constraint for the hand (the operator's parameters) for which the constraint has the smallest slack.

    Attributes:
        text: Text of the constraint.
        left, right: Values of the two sides.
        slack: Slack divided by the magnitude of the right side; negative if the constraint is violated.
        judgement: Judgement for the hand.
    """

    text: str
    left: float
    right: float
    slack: float
    judgement: Judgement

    @property
    def holds(self) -> bool:
        """Whether the constraint is satisfied, except for the rounding of tuned values to six digits."""
        return self.slack >= -ROUNDING

    @property
    def reason(self) -> str:
        """Text of the constraint and value of its left side; for a stability margin, also the mode and its limit."""
        row = self.row
        return f"{self.text} is {self.left:.5g}{f': {row.text}' if row is not None else ''}"

    @property
    def row(self) -> ObjectLimit | None:
        """Stability limit to which the constraint refers; None if the constraint contains no margin.

        A constraint on `margin` refers to the mode with the smallest margin.
        """
        margins = re.findall(r"\bmargin(?:\.(\w+))?", self.text)
        if not margins:
            return None
        if "" in margins:
            return self.judgement.worst
        modes = tuple(each.replace("_", " ") for each in margins)
        limits = (*self.judgement.limits, *self.judgement.pushing)
        rows = [row for row in limits if row.limit.mode in modes or row.limit.mode.startswith(_families(modes))]
        return min(rows, key=lambda row: row.limit.margin, default=None)


@dataclass(frozen=True)
class Check:
    """Verification with one key changed by 1 % beyond the optimum, in the direction that increases the objective.

    Attributes:
        values: Value of each key.
        broken: Constraint that is violated most, for the hand that violates it most; None if all constraints hold.
        key: Key that is changed; empty if no change of a key increases the objective.
    """

    values: Mapping[str, float]
    broken: ConstraintValue | None
    key: str = ""

    @property
    def text(self) -> str:
        """Result of the verification in a sentence."""
        if not self.key:
            return "verified: changing any single key by 1 % does not increase the objective"
        beyond = f"verified: 1 % beyond, {self.key} = {self.values[self.key]:.6g}"
        if self.broken is None:
            return f"{beyond}, all constraints still hold"
        return f"{beyond}, fails: {self.broken.reason}"


@dataclass(frozen=True, eq=False, repr=False)
class Tuning(Carded):
    """Result of a tuning.

    Attributes:
        scene: Scene before tuning.
        objective: Maximised formula.
        value: Smallest value of the objective at the optimum over all judged hands.
        before: Value of the objective in the scene before tuning, for the scene's own operator.
        values: Tuned value of each key; if the problem is infeasible, the values that violate the constraints least.
        feasible: Whether all constraints hold in the verification.
        constraints: Values of all constraints at the optimum.
        binding: Constraint that limits the objective; None if no constraint limits it.
        more: Verifications 1 % beyond the optimum, one for each key whose change increases the objective.
        certificates: Full certificates of each object at the optimum, for the hand with the smallest slack of a
            constraint; empty if the scene has no equilibrium.
        end: Range of a key whose value is at an end of the range; None if all values are inside their ranges.
        operators: Set of operators; None for the scene's own operator.
        hands: Hands used in the search.
        reach: For an infeasible problem, the best value of the left side of each constraint that is infeasible even
            without the other constraints, by the text of the constraint.
        judged: Number of judgements, including those for `reach`.
        refutation: Description of the constraint that failed in the verification, the hand and a remedy; empty if the
            verification did not fail.
    """

    scene: Scene
    objective: str
    value: float
    before: float
    values: Mapping[str, float]
    feasible: bool
    constraints: tuple[ConstraintValue, ...]
    binding: ConstraintValue | None
    more: tuple[Check, ...]
    certificates: tuple[Certificate, ...]
    end: OperatorRange | None
    operators: OperatorSet | None
    hands: tuple[Mapping[str, float], ...]
    reach: Mapping[str, float]
    judged: int
    refutation: str = ""

    @property
    def pushing(self) -> Limit | None:
        """Smallest limit in `certificates` for fingers that push without the others; None if there is no such limit."""
        rows = [row for each in self.certificates for row in each.limits if row.mode.startswith(PUSHING)]
        return min(rows, key=lambda row: row.margin, default=None)

    @property
    def tuned(self) -> Scene:
        """The scene with the tuned values."""
        return self.scene.replace(self.values)

    @property
    def set_line(self) -> str:
        """Command-line arguments that set the tuned values."""
        pairs = [f"{key}={six_digits(value)}" for key, value in self.values.items()]
        words = (f"'{pair}'" if "*" in pair else pair for pair in pairs)
        return f"--set {' '.join(words)}"

    @property
    def sentence(self) -> str:
        """The result in a sentence."""
        values = ", ".join(f"{key} = {six_digits(value)}" for key, value in self.values.items())
        who = "in every hand of the set" if self.operators is not None else "in the scene's own hand"
        if self.refutation:
            return f"NOT verified {who}: {self.refutation}; the values tried are {values}"
        if not self.feasible:
            return f"NOT feasible {who}: {self.obstacle}; the nearest values are {values}"
        was = "" if math.isnan(self.before) else f", was {self.before:.5g}"
        return f"{self.objective} = {self.value:.5g}{was}: {values}, {who}"

    @property
    def obstacle(self) -> str:
        """Reason why the problem is infeasible, or `refutation` if the verification failed; empty if it is feasible."""
        unmet = [each for each in self.constraints if not each.holds]
        if self.feasible or not unmet:
            return ""
        if self.refutation:
            return self.refutation
        for each in unmet:
            if each.judgement.at in ("", "apart"):
                return f"{each.text} cannot be judged: {each.judgement.assumed[0]}"
            best = self.reach.get(each.text, math.nan)
            if not math.isnan(best):
                return f"{each.text} cannot be satisfied: its best value is {best:.4g}"
        return f"no values satisfy all: {'; '.join(f'{each.text} has left side {each.left:.4g}' for each in unmet)}"

    @property
    def reason(self) -> str:
        """Reason why the objective cannot be larger, such as the binding constraint with its mode and the hand."""
        if not self.feasible:
            return self.obstacle
        if self.binding is not None:
            row = self.binding.row
            hand = {key: value for key, value in self.binding.judgement.values.items() if key not in self.values}
            in_hand = f" in the hand of {numbers(hand)}" if hand else " in the scene's own hand"
            mode = f": {row.text}" if row is not None else ""
            return f"{self.binding.text} binds{in_hand}{mode}"
        if self.end is not None:
            return (
                f"{self.end.key} is at the end of its range, {self.end.low:g} to {self.end.high:g}; "
                "no constraint is binding"
            )
        return "no change of the keys increases the objective"

    @property
    def toml(self) -> str:
        """Preset with the tuned values, as TOML for the scene's file."""
        items = ", ".join(f'"{key}" = {six_digits(value)}' for key, value in self.values.items())
        who = "the scene's own operator"
        if self.operators is not None:
            who = "; ".join(each.text for each in self.operators.ranges)
        conditions = ", ".join(each.text for each in self.constraints)
        lines = [
            f"# {self.scene.source.name}: largest {self.objective} with {conditions or 'no constraint'}",
            f"# operators: {who}",
            *(f"# {each.reason}" for each in self.constraints),
            f"# {self.reason}",
            "[preset.tuned]",
            f'reason = "largest {self.objective} with {conditions or "no constraint"}"',
            f"set = {{ {items} }}",
        ]
        return "\n".join(lines) + "\n"

    def lines(self) -> Iterator[str]:
        """Yield the lines of a report.

        The lines are the result, the constraints, the binding constraint, the verification, the operators, and the
        command-line arguments that set the tuned values.
        """
        yield self.sentence
        for each in self.constraints:
            mark = "holds" if each.holds else "FAILS"
            hand = {key: value for key, value in each.judgement.values.items() if key not in self.values}
            yield f"  {mark}  {each.reason}{f'; worst at {numbers(hand)}' if hand else ''}"
        if self.feasible:
            yield f"  limited by: {self.reason}"
            for check in self.more:
                yield f"  {check.text}"
            if self.pushing is not None:
                yield f"  fingers pushing alone: {self.pushing.mode} {self.pushing.text}"
        if self.operators is not None:
            ranges = "; ".join(each.text for each in self.operators.ranges)
            yield f"  operators {self.operators.source}: {ranges}; {len(self.hands)} used in the search"
        yield f"  {self.judged} full judgements"
        yield f"  {self.set_line}"

    def to_dict(self) -> dict[str, Any]:
        """Return the result as data for JSON."""
        binding = self.binding
        return {
            "scene": self.scene.source.name,
            "objective": self.objective,
            "value": plain(self.value),
            "before": plain(self.before),
            "values": dict(self.values),
            "feasible": self.feasible,
            "sentence": self.sentence,
            "reason": self.reason,
            "constraints": [_constraint_data(each) for each in self.constraints],
            "binding": None if binding is None else _constraint_data(binding),
            "more": [
                {
                    "values": dict(check.values),
                    "broken": None if check.broken is None else _constraint_data(check.broken),
                    "text": check.text,
                }
                for check in self.more
            ],
            "certificates": [each.to_dict() for each in self.certificates],
            "operators": None if self.operators is None else [plain(each) for each in self.operators.ranges],
            "hands": [dict(hand) for hand in self.hands],
            "reach": plain(dict(self.reach)),
            "refutation": self.refutation,
            "judged": self.judged,
            "set": self.set_line,
        }

    def _card(self) -> Card:
        first, *rest = self.lines()
        calls = ".values, .constraints, .reason, .tuned, .set_line, .toml, .to_dict()"
        return Card(f"{self.scene.source.name}: {first}", [("", "\n".join(line.strip() for line in rest))], calls)


def six_digits(value: float) -> str:
    """Return a number, rounded to six significant digits, as text."""
    if value == 0.0 or not math.isfinite(value):
        return repr(float(value))
    return repr(float(f"{value:.6g}"))


def _families(modes: tuple[str, ...]) -> tuple[str, ...]:
    """Return the prefixes of the names of limits to which `margin.standing` and `margin.pushing` refer.

    Args:
        modes: Names after "margin." in a constraint.
    """
    return tuple(start for start, name in ((STANDING, "standing"), (PUSHING, "pushing")) if name in modes)


def _constraint_data(each: ConstraintValue) -> dict[str, Any]:
    return {
        "text": each.text, "left": plain(each.left), "right": plain(each.right), "slack": plain(each.slack),
        **{f"hand_{key}" if key == "values" else key: value for key, value in judgement_data(each.judgement).items()},
    }  # fmt: skip
