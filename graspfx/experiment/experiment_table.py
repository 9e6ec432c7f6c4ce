"""The tables of an experiment's file: scene, conditions, factors, order, question, staircase, observer."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field
from pydantic_core import PydanticCustomError

from graspfx.errors import abbreviate
from graspfx.scene.tables.fields import Count, Name, NotNegative, Number, Positive, Switch, Table
from graspfx.scene.tables.preset_table import values_by_key

if TYPE_CHECKING:
    from graspfx.scene.model import Scene
    from graspfx.scene.source import Source

Order = Literal["fixed", "random", "blocks", "latin-square"]
WORD = r"^[A-Za-z0-9]+$"  # of a label in the names of files
MOST_TRIALS = 10_000


def label(value: str) -> str:
    """Check a word that stands in names of files."""
    if re.fullmatch(WORD, value) is None:
        text = "expected letters and digits alone, as it stands in names of files; given {given}"
        raise PydanticCustomError("label", text, {"given": abbreviate(value)})
    return value


def _keys(value: Any) -> Any:
    if not isinstance(value, Mapping) or not value:
        raise PydanticCustomError("keys", 'expected answers by key, as in { "1" = "first", "2" = "second" }')
    for key, answer in value.items():
        if len(str(key)) != 1 or not str(key).isprintable() or str(key).isspace():
            text = "expected one letter or digit for each key; given {given}"
            raise PydanticCustomError("keys", text, {"given": abbreviate(key)})
        if not isinstance(answer, str) or not answer.strip() or not answer.isprintable():
            text = "expected an answer in words for each key; given {given}"
            raise PydanticCustomError("keys", text, {"given": abbreviate(answer)})
    return {str(key): answer for key, answer in value.items()}


def as_list(value: Any) -> Any:
    """Take a lone table as a list of one."""
    return [value] if isinstance(value, Mapping) else value


ByKey = Annotated[dict[str, Any], BeforeValidator(values_by_key)]
Whole = Annotated[int, Field(strict=True, ge=1, le=MOST_TRIALS)]
Chance = Annotated[Number, Field(ge=0, lt=0.5)]


class Question(Table):
    """The question that each trial ends in, and the keys that answer it."""

    text: str = Field(description="as it is asked")
    keys: Annotated[dict[str, str], BeforeValidator(_keys)] = Field(description="answers by key of the keyboard")
    when: Literal["after", "during"] = Field(
        default="after", description="the stimulus, or from its beginning on: then an answer ends it"
    )


class Comparison(Table):
    """A trial of two intervals: a value and one that is larger by an increment, in random order."""

    key: str = Field(description="of the scene, with dots, whose value differs between the intervals")
    reference: Positive = Field(description="the smaller value")
    increments: tuple[Positive, ...] = Field(default=(), description="of it, relative; none for a staircase's")


class Condition(Table):
    """A condition: values of the scene, or a comparison of two."""

    name: Name
    set: ByKey = Field(default_factory=dict, description="values of the scene by dotted key")
    answer: str = Field(default="", description="that is right, one of the question's; none where no answer is")
    compare: Comparison | None = None


class Factor(Table):
    """A factor, whose levels are crossed with those of all others and with the conditions."""

    name: Name
    key: str = Field(default="", description="of the scene, with dots, that `levels` are values of")
    levels: tuple[Any, ...] = Field(default=(), description="values of the key")
    level: dict[str, ByKey] = Field(default_factory=dict, description="or levels by name, each values by dotted key")


class Span(Table):
    """Values from a least to a largest one, equally far apart as ratios."""

    least: Positive
    most: Positive
    count: Annotated[int, Field(strict=True, ge=2, le=200)] = 30


class Staircase(Table):
    """Increments that QUEST+ chooses, each where the answer says most; of each condition by itself."""

    increments: Span = Field(description="relative, among which it chooses")
    threshold: Span = Field(description="relative, that are thought possible, each as likely: at 80 % right answers")
    slope: Positive = Field(default=3.5, description="of the Weibull function")
    lapse: Chance = Field(default=0.02, description="rate of answers at random where nobody is in doubt")


class Practice(Table):
    """Trials before the others, which no staircase and no evaluation counts."""

    trials: Count
    increment: Positive | None = Field(default=None, description="of comparisons; the largest if not given")


class Breaks(Table):
    """Pauses that end when the participant presses a key."""

    every: Whole = Field(description="trials")
    text: str = "time for a break"


class Observer(Table):
    """A simulated observer, for `--simulate`."""

    kind: Literal["psychometric", "physical", "guess"] = Field(
        description="answers by a Weibull function of the increment, by what the recordings display, or at random"
    )
    threshold: Positive | dict[str, Positive] = Field(default=0.15, description="relative; or by condition")
    slope: Positive = 3.5
    lapse: Chance = 0.02
    weber: NotNegative | dict[str, NotNegative] = Field(
        default=0.1, description="noise of a stiffness that is felt, a share of it; or by condition"
    )


class ExperimentTable(Table):
    """A whole experiment, each field on its own."""

    name: Annotated[str, AfterValidator(label)] = Field(description="of the task, letters and digits")
    title: str = ""
    scene: str = Field(description="a name, or a path from the file's folder")
    set: ByKey = Field(default_factory=dict, description="values of the scene in every trial, by dotted key")
    duration: Positive | None = Field(default=None, description="of an interval [s]; the scene's if not given")
    gap: NotNegative = Field(default=0.5, description="between two intervals of a trial, at the least [s]")
    order: Order = "random"
    repetitions: Whole = 1
    seed: Count = 0
    ready: Switch = Field(default=False, description="whether each trial waits for a key; with hardware it does")
    page: Literal["question", "scene"] = Field(
        default="question", description="on a page with buttons: the question alone, or the scene with its forces, too"
    )
    question: Question | None = None
    condition: Annotated[tuple[Condition, ...], BeforeValidator(as_list)] = ()
    factor: Annotated[tuple[Factor, ...], BeforeValidator(as_list)] = ()
    staircase: Staircase | None = None
    practice: Practice | None = None
    breaks: Breaks | None = None
    observer: Observer | None = None


class Study:
    """The parts that an experiment is made of.

    Args:
        table: its tables.
        scene: with the values of all trials.
        source: where it came from.
    """

    def __init__(self, table: ExperimentTable, scene: Scene, source: Source) -> None:
        self.table, self.scene, self.source = table, scene, source
