"""Formulas of measures and keys of a scene: parser, evaluation, and comparisons of formulas."""

from __future__ import annotations

import math
import operator
import re
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from graspfx.assembly.live import value_of
from graspfx.certificate.certificate import STANDING
from graspfx.certificate.judgement import Judgement
from graspfx.errors import GraspFXError, InputError, UnknownNameError
from graspfx.scene.model import Scene

TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_]\w*(?:\.(?:\w+|\*))*)|(?P<sign><=|>=|[-+*/()<>]))"
)
FORM = "names, numbers, + - * / and brackets, as in internal.stiffness or 2*depth"
COMPARISON = "a comparison with >= or <=, as in margin >= 1.3"
SIGNS: dict[str, Callable[[float, float], float]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv,
}  # fmt: skip
DEEPEST = 50  # largest depth of nested brackets
LONGEST = 400  # largest number of words; the tree of a sum is half as deep, and Python allows 1000 recursive calls
LEVELS = ("+-", "*/")  # operators by increasing precedence

Tree = float | str | tuple[str, "Tree", "Tree"]


@dataclass(frozen=True)
class Expression:
    """A formula of names and numbers.

    Attributes:
        text: Text of the formula.
        tree: Syntax tree: a number, a name, or an operator with two operands.
    """

    text: str
    tree: Tree

    @property
    def names(self) -> tuple[str, ...]:
        """Distinct names in the formula, in order of occurrence."""
        return tuple(dict.fromkeys(_names(self.tree)))

    def value(self, numbers: Mapping[str, float]) -> float:
        """Evaluate the formula for the given values of its names; the result of a division by zero is NaN."""
        return _value(self.tree, numbers)


@dataclass(frozen=True)
class Constraint:
    """A comparison of two formulas.

    Attributes:
        text: Text of the comparison.
        left, right: Formulas on the two sides.
        is_least: Whether `left` must be at least `right`; otherwise, `left` must be at most `right`.
    """

    text: str
    left: Expression
    right: Expression
    is_least: bool

    @property
    def names(self) -> tuple[str, ...]:
        """Distinct names on both sides, in order of occurrence."""
        return tuple(dict.fromkeys((*self.left.names, *self.right.names)))

    @property
    def room(self) -> Expression:
        """Absolute slack as a formula: the side that must be larger minus the other side."""
        more, less = (self.left, self.right) if self.is_least else (self.right, self.left)
        return Expression(f"({more.text}) - ({less.text})", ("-", more.tree, less.tree))

    def slack(self, numbers: Mapping[str, float]) -> float:
        """Return the slack divided by the magnitude of the right side; a negative slack means a violation.

        If the right side is zero or infinite, the slack is not divided. If a side is NaN, the slack is -inf.
        """
        room, right = self.room.value(numbers), self.right.value(numbers)
        if math.isnan(room):
            return -math.inf
        return room / abs(right) if right and math.isfinite(right) else room


def read_expression(text: str, name: str = "maximise") -> Expression:
    """Parse a formula.

    Args:
        text: Text of the formula.
        name: Name of the argument in error messages.

    Raises:
        InputError: If the text is not a formula.
    """
    words = _words(text, name)
    return Expression(text.strip(), _tree(words, name, text))


def read_constraints(text: object, name: str = "subject_to") -> tuple[Constraint, ...]:
    """Parse comparisons that are separated by commas.

    Args:
        text: Text of the comparisons.
        name: Name of the argument in error messages.

    Raises:
        InputError: If the text is not a list of comparisons.
    """
    if not isinstance(text, str):
        raise InputError(name, text, COMPARISON)
    return tuple(_constraint(part.strip(), name) for part in text.split(",") if part.strip())


def _constraint(text: str, name: str) -> Constraint:
    words = _words(text, name)
    signs = [k for k, word in enumerate(words) if word in ("<=", ">=", "<", ">")]
    if len(signs) != 1:
        raise InputError(name, text, COMPARISON)
    (at,) = signs
    left, right = (
        Expression(" ".join(side), _tree(side, name, text)) for side in (words[:at], words[at + 1 :])
    )  # fmt: skip
    return Constraint(f"{left.text} {words[at][0]}= {right.text}", left, right, words[at][0] == ">")


def _words(text: object, name: str) -> list[str]:
    if not isinstance(text, str) or not text.strip():
        raise InputError(name, text, FORM)
    words, at = [], 0
    while text[at:].strip():
        match = TOKEN.match(text, at)
        if match is None:
            raise InputError(name, text.strip(), f"{FORM}; {text[at:].strip()[0]!r} is unexpected")
        words.append(match.group().strip())
        at = match.end()
    if len(words) > LONGEST:
        expected = f"at most {LONGEST} names, numbers, operators and brackets"
        do = "evaluation is recursive, and every operator needs a further call: use fewer terms"
        raise InputError(name, f"{len(words)} words", expected, do)
    return words


def _tree(words: Sequence[str], name: str, text: str) -> Tree:
    """Parse a formula by recursive descent; operators of equal precedence associate to the left."""
    rest = deque(words)

    def refusal(why: str) -> InputError:
        return InputError(name, text.strip(), f"{FORM}; {why}")

    def terms(depth: int, level: int = 0) -> Tree:
        """Parse a sequence of operands that operators of one precedence level connect."""
        if level == len(LEVELS):
            return factor(depth)
        tree = terms(depth, level + 1)
        while rest and rest[0] in LEVELS[level]:
            tree = (rest.popleft(), tree, terms(depth, level + 1))
        return tree

    def factor(depth: int) -> Tree:
        if depth > DEEPEST:
            raise InputError(name, text, f"at most {DEEPEST} nested brackets")
        if not rest:
            raise refusal("a name or a number is missing at the end")
        first = rest.popleft()
        if first == "-":
            return ("-", 0.0, factor(depth + 1))
        if first == "(":
            tree = terms(depth + 1)
            if not rest or rest.popleft() != ")":
                raise refusal("a bracket is not closed")
            return tree
        if first[0].isdigit() or first[0] == ".":
            return float(first)
        if not (first[0].isalpha() or first[0] == "_"):
            raise refusal(f"{first!r} is unexpected")
        return first

    tree = terms(0)
    if rest:
        raise refusal(f"{rest[0]!r} is unexpected")
    return tree


def _names(tree: Tree) -> Iterator[str]:
    if isinstance(tree, str):
        yield tree
    elif isinstance(tree, tuple):
        yield from _names(tree[1])
        yield from _names(tree[2])


def _value(tree: Tree, numbers: Mapping[str, float]) -> float:
    if isinstance(tree, str):
        return numbers[tree]
    if not isinstance(tree, tuple):
        return tree
    sign, left, right = tree
    a, b = _value(left, numbers), _value(right, numbers)
    return math.nan if sign == "/" and b == 0.0 else SIGNS[sign](a, b)


# Meaning of names ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Measure:
    """A quantity of a judgement that formulas can use.

    Attributes:
        formula: Definition of the quantity in words.
        unit: Unit; empty for a ratio.
        read: Function that returns the value of the quantity in a judgement.
    """

    formula: str
    unit: str
    read: Callable[[Judgement], float]


def _standing(one: Judgement) -> float:
    rows = [row.limit.margin for row in one.limits if row.limit.mode.startswith(STANDING)]
    return min(rows, default=math.inf)


def _frequency(one: Judgement) -> float:
    return math.inf if one.worst is None else one.worst.limit.frequency


MEASURES: dict[str, Measure] = {
    "margin": Measure(
        "smallest ratio of limit to gain over all modes, with all fingers in contact", "", lambda one: one.margin
    ),
    "margin.internal": Measure("ratio of limit to gain for k_ip", "", lambda one: one.margin_of("internal")),
    "margin.external": Measure("ratio of limit to gain for k_ep", "", lambda one: one.margin_of("external")),
    "margin.external_translation": Measure(
        "ratio of limit to gain for k_ep of translations", "", lambda one: one.margin_of("external translation")
    ),
    "margin.external_rotation": Measure(
        "ratio of limit to gain for k_ep of rotations", "", lambda one: one.margin_of("external rotation")
    ),
    "margin.standing": Measure("ratio of limit to gain for an object on its support", "", _standing),
    "margin.pushing": Measure(
        "smallest ratio of limit to gain for groups of fingers that push without the others", "",
        lambda one: min((row.limit.margin for row in one.pushing), default=math.inf),
    ),
    "grip": Measure(
        "ratio of the squeeze at equilibrium to the squeeze required by weight, drag and acceleration", "",
        lambda one: one.grip,
    ),
    "depth": Measure(
        "largest distance of a fingertip from its contact point at equilibrium", "m", lambda one: one.depth
    ),
    "squeeze": Measure("largest internal force of a finger at equilibrium", "N", lambda one: one.squeeze),
    "force": Measure("largest force of a finger at equilibrium", "N", lambda one: one.force),
    "frequency": Measure("frequency of the mode of smallest margin at its stability limit", "Hz", _frequency),
    "spectral_radius": Measure(
        "largest abs(z) of the eigenvalues z of the sampled loop", "", lambda one: one.spectral_radius
    ),
    "displayed.stiffness": Measure(
        "abs(f_i)^2/(f_i.e) at equilibrium, with the internal forces f_i and the vectors e from contact points to "
        "fingertips", "N/m",
        lambda one: one.displayed,
    ),
}  # fmt: skip
GAINS = {
    f"{part}.{kind}": f"coupling.{part}.{kind}"
    for part in ("internal", "external")
    for kind in ("stiffness", "damping")
}


def key_of(scene: Scene, name: str) -> str | None:
    """Return the key of the scene to which a name in a formula refers; None if the name is that of a measure.

    Raises:
        UnknownNameError: If the name is neither that of a measure nor a key.
        InputError: If the value of the key is not a number.
    """
    if name in MEASURES:
        return None
    key = GAINS.get(name, name)
    try:
        value = value_of(scene, key)
    except UnknownNameError as error:
        remedy = str(error) if "." in name else "or use a key of the scene whose value is a number"
        raise UnknownNameError("measure or key", name, (*MEASURES, *GAINS), remedy) from error
    except GraspFXError:
        value = None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(name, value, "a key whose value is a number", "use a measure or another key")
    return key


def numbers_of(keys: Mapping[str, str | None], one: Judgement) -> dict[str, float]:
    """Return the value of each name in a judgement.

    Args:
        keys: For each name, the result of `key_of`.
        one: Judgement.
    """
    return {name: MEASURES[name].read(one) if key is None else _number(one, key) for name, key in keys.items()}


def _number(one: Judgement, key: str) -> float:
    value = one.values[key] if key in one.values or one.scene is None else value_of(one.scene, key)
    return float(value) if isinstance(value, int | float) else math.nan
