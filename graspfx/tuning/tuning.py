"""The answer of a tuning: gains to start from, what each constraint is there, and why they are no higher."""

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

ROUNDING = 1e-5  # of a bound


@dataclass(frozen=True)
class ConstraintValue:
    """A constraint at the optimum, in the hand that comes nearest to violating it.

    Attributes:
        text: of the constraint.
        left, right: values of its two sides there.
        slack: by how much it is met, over the right side; less than zero where it is not.
        judgement: of that hand.
    """

    text: str
    left: float
    right: float
    slack: float
    judgement: Judgement

    @property
    def holds(self) -> bool:
        """Whether it is met, but for the rounding of tuned values to six digits."""
        return self.slack >= -ROUNDING

    @property
    def reason(self) -> str:
        """The sides' values, and for stability the mode, its limit and frequency."""
        row = self.row
        return f"{self.text} is {self.left:.5g}{f': {row.text}' if row is not None else ''}"

    @property
    def row(self) -> ObjectLimit | None:
        """The limit that the constraint is of: of the mode that it names, else the least; None without a margin."""
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
    """The verification beyond the optimum: the objective 1 % higher.

    Attributes:
        values: by key, that were judged.
        broken: the constraint that does not hold there, as it is in the hand that violates it most; None if all hold.
        key: that is 1 % larger, or smaller; empty where no key makes the objective larger.
    """

    values: Mapping[str, float]
    broken: ConstraintValue | None
    key: str = ""

    @property
    def text(self) -> str:
        """The verification in words."""
        if not self.key:
            return "verified: 1 % more or less of any key alone does not make it larger"
        beyond = f"verified: 1 % beyond, {self.key} = {self.values[self.key]:.6g}"
        return f"{beyond}, all still hold" if self.broken is None else f"{beyond}, breaks it: {self.broken.reason}"


@dataclass(frozen=True, eq=False, repr=False)
class Tuning(Carded):
    """Gains that a laboratory can start from.

    Attributes:
        scene: as it was.
        objective: that was made as large as it can be.
        value: of it at the optimum, in the worst hand.
        before: of it in the scene as it was, in its own hand.
        values: by key, the tuned ones; of a problem that cannot be met, the nearest.
        feasible: whether all constraints hold, judged afresh in full.
        constraints: each at the optimum.
        binding: the one that stops the objective; None where a range's end does, or nothing.
        more: the verification 1 % beyond, for each key that makes the objective larger.
        certificates: of each object at the optimum in the hand that comes nearest to violating a constraint, in full;
            none where it has no rest.
        end: the range at whose end the optimum is; None for none.
        operators: whose hands; None for the scene's own.
        hands: the operators that the optimum was held against.
        reach: by a constraint's text, the best that its left side comes to by itself, of a problem that cannot be met.
        judged: how many judgements that took, those of `reach` among them.
        refutation: why an answer of the search did not stand when it was judged afresh: in which hand, what was tried
            and what to do; empty where it did.
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
        """The weakest set of fingers that push without the others, in that hand; None where none can."""
        rows = [row for each in self.certificates for row in each.limits if row.mode.startswith(PUSHING)]
        return min(rows, key=lambda row: row.margin, default=None)

    @property
    def tuned(self) -> Scene:
        """The scene with the tuned values."""
        return self.scene.replace(self.values)

    @property
    def set_line(self) -> str:
        """Words of a command line that give a scene the tuned values."""
        pairs = [f"{key}={six_digits(value)}" for key, value in self.values.items()]
        words = (f"'{pair}'" if "*" in pair else pair for pair in pairs)
        return f"--set {' '.join(words)}"

    @property
    def sentence(self) -> str:
        """The answer in a sentence."""
        values = ", ".join(f"{key} = {six_digits(value)}" for key, value in self.values.items())
        who = "in every hand of the set" if self.operators is not None else "in the scene's own hand"
        if self.refutation:
            return f"NOT verified {who}: {self.refutation}; what was tried is {values}"
        if not self.feasible:
            return f"NOT possible {who}: {self.obstacle}; the nearest is {values}"
        was = "" if math.isnan(self.before) else f", was {self.before:.5g}"
        return f"{self.objective} = {self.value:.5g}{was}: {values}, {who}"

    @property
    def obstacle(self) -> str:
        """Which constraint cannot be met, and how near it comes, or where the answer failed; empty if all are met."""
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
                return f"{each.text} cannot be met: it comes to {best:.4g} at best"
        return f"not together: {'; '.join(f'{each.text} comes to {each.left:.4g}' for each in unmet)}"

    @property
    def reason(self) -> str:
        """Why the objective is no higher: what binds, in which mode, at which frequency, in whose hand."""
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
                f"{self.end.key} is at the end of its range, {self.end.low:g} to {self.end.high:g}; nothing else binds"
            )
        return "no change of the keys makes it larger"

    @property
    def toml(self) -> str:
        """The tuned values as a preset to put into the scene's file."""
        items = ", ".join(f'"{key}" = {six_digits(value)}' for key, value in self.values.items())
        who = "the scene's own operator"
        if self.operators is not None:
            who = "; ".join(each.text for each in self.operators.ranges)
        conditions = ", ".join(each.text for each in self.constraints)
        lines = [
            f"# {self.scene.source.name}: {self.objective} as large as it can be with {conditions or 'no constraint'}",
            f"# operators: {who}",
            *(f"# {each.reason}" for each in self.constraints),
            f"# {self.reason}",
            "[preset.tuned]",
            f'reason = "{self.objective} as large as it can be with {conditions or "no constraint"}"',
            f"set = {{ {items} }}",
        ]
        return "\n".join(lines) + "\n"

    def lines(self) -> Iterator[str]:
        """Write the answer, each constraint, why no higher, the verification, and what to paste."""
        yield self.sentence
        for each in self.constraints:
            mark = "holds" if each.holds else "FAILS"
            hand = {key: value for key, value in each.judgement.values.items() if key not in self.values}
            yield f"  {mark}  {each.reason}{f'; least at {numbers(hand)}' if hand else ''}"
        if self.feasible:
            yield f"  why no higher: {self.reason}"
            for check in self.more:
                yield f"  {check.text}"
            if self.pushing is not None:
                yield f"  fingers that push alone: {self.pushing.mode} {self.pushing.text}"
        if self.operators is not None:
            ranges = "; ".join(each.text for each in self.operators.ranges)
            yield f"  operators {self.operators.source}: {ranges}; {len(self.hands)} of them shaped the answer"
        yield f"  {self.judged} judgements in full"
        yield f"  {self.set_line}"

    def to_dict(self) -> dict[str, Any]:
        """Write plain data for JSON."""
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
    """Write a tuned value in six digits, rounded towards zero: what was verified is no less."""
    if value == 0.0 or not math.isfinite(value):
        return repr(float(value))
    return repr(float(f"{value:.6g}"))


def _families(modes: tuple[str, ...]) -> tuple[str, ...]:
    """Give how limits begin that a margin names as a whole: of what the object stands on, and of pushing."""
    return tuple(start for start, name in ((STANDING, "standing"), (PUSHING, "pushing")) if name in modes)


def _constraint_data(each: ConstraintValue) -> dict[str, Any]:
    return {
        "text": each.text, "left": plain(each.left), "right": plain(each.right), "slack": plain(each.slack),
        **{f"hand_{key}" if key == "values" else key: value for key, value in judgement_data(each.judgement).items()},
    }  # fmt: skip
