"""Tables of an experiment file: scene, conditions, factors, order, question, staircase, observer."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field
from pydantic_core import PydanticCustomError

from graspfx.errors import abbreviate
from graspfx.scene.tables.fields import Count, Name, NotNegative, Number, Positive, Switch, Table
from graspfx.scene.tables.scene_table import values_by_key

if TYPE_CHECKING:
    from graspfx.scene.model import Scene
    from graspfx.scene.source import Source

Order = Literal["fixed", "random", "blocks", "latin-square"]
WORD = r"^[A-Za-z0-9]+$"  # labels in file names
MOST_TRIALS = 10_000


def label(value: str) -> str:
    """Check that a label can be part of file names, and return it."""
    if re.fullmatch(WORD, value) is None:
        text = "expected letters and digits only, because the label is part of file names; given {given}"
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
    """Convert a single table to a list of one table."""
    return [value] if isinstance(value, Mapping) else value


ByKey = Annotated[dict[str, Any], BeforeValidator(values_by_key)]
Whole = Annotated[int, Field(strict=True, ge=1, le=MOST_TRIALS)]
Chance = Annotated[Number, Field(ge=0, lt=0.5)]


class Question(Table):
    """Question of each trial, and the keys of its answers."""

    text: str = Field(description="text of the question")
    keys: Annotated[dict[str, str], BeforeValidator(_keys)] = Field(description="answers, by key of the keyboard")
    when: Literal["after", "during"] = Field(
        default="after",
        description="when to answer: after the stimulus, or during it (an answer then ends the stimulus)",
    )


class Comparison(Table):
    """Comparison of two intervals in random order: one value is the reference, the other is larger by an increment."""

    key: str = Field(description="dotted key of the value that differs between intervals")
    reference: Positive = Field(description="smaller value")
    increments: tuple[Positive, ...] = Field(
        default=(), description="relative increments; none if a staircase chooses them"
    )


class Condition(Table):
    """Condition of trials: values of the scene, or a comparison of two values."""

    name: Name
    set: ByKey = Field(default_factory=dict, description="values of the scene by dotted key")
    answer: str = Field(default="", description="correct answer, one of the question's; empty for none")
    compare: Comparison | None = None


class Factor(Table):
    """Factor, whose levels are crossed with the conditions and with the levels of all other factors."""

    name: Name
    key: str = Field(default="", description="dotted key of the scene that takes the values in `levels`")
    levels: tuple[Any, ...] = Field(default=(), description="values of the key")
    level: dict[str, ByKey] = Field(default_factory=dict, description="or named levels, each with values by dotted key")


class Span(Table):
    """Logarithmically spaced values."""

    least: Positive
    most: Positive
    count: Annotated[int, Field(strict=True, ge=2, le=200)] = 30


class Staircase(Table):
    """QUEST+ staircase of each condition; it chooses the increment whose answer is expected to be most informative."""

    increments: Span = Field(description="relative increments to choose from")
    threshold: Span = Field(description="possible relative thresholds (80 % correct), equally likely at first")
    slope: Positive = Field(default=3.5, description="slope of the Weibull function")
    lapse: Chance = Field(default=0.02, description="lapse rate: share of random answers to easy trials")


class Practice(Table):
    """Practice trials before the session; neither the staircase nor the evaluation uses them."""

    trials: Count
    increment: Positive | None = Field(default=None, description="increment of comparisons (default: the largest)")


class Breaks(Table):
    """Breaks that end when the participant presses a key."""

    every: Whole = Field(description="number of trials between breaks")
    text: str = "time for a break"


class Observer(Table):
    """Simulated observer for `--simulate`."""

    kind: Literal["psychometric", "physical", "guess"] = Field(
        description="model of the answers: a Weibull function, the recorded stiffness, or chance"
    )
    threshold: Positive | dict[str, Positive] = Field(
        default=0.15, description="relative threshold, or one per condition"
    )
    slope: Positive = 3.5
    lapse: Chance = 0.02
    weber: NotNegative | dict[str, NotNegative] = Field(
        default=0.1, description="noise of a perceived stiffness (Weber fraction), or one per condition"
    )


class ExperimentTable(Table):
    """Tables of an experiment file; each field is checked individually."""

    name: Annotated[str, AfterValidator(label)] = Field(description="name of the task, letters and digits")
    title: str = ""
    scene: str = Field(description="name of a scene, or path relative to this file")
    set: ByKey = Field(default_factory=dict, description="values of the scene in all trials, by dotted key")
    duration: Positive | None = Field(default=None, description="duration of an interval [s] (default: the scene's)")
    gap: NotNegative = Field(default=0.5, description="shortest pause between the intervals of a trial [s]")
    order: Order = "random"
    repetitions: Whole = 1
    seed: Count = 0
    ready: Switch = Field(default=False, description="whether each trial waits for a key; always with hardware")
    page: Literal["question", "scene"] = Field(
        default="question",
        description="answer page: the question only, or also the scene with its forces",
    )
    question: Question | None = None
    condition: Annotated[tuple[Condition, ...], BeforeValidator(as_list)] = ()
    factor: Annotated[tuple[Factor, ...], BeforeValidator(as_list)] = ()
    staircase: Staircase | None = None
    practice: Practice | None = None
    breaks: Breaks | None = None
    observer: Observer | None = None


class Study:
    """Tables, scene and source of an experiment.

    Args:
        table: Tables of the file.
        scene: Scene with the values that all trials share.
        source: Source of the tables.
    """

    def __init__(self, table: ExperimentTable, scene: Scene, source: Source) -> None:
        self.table, self.scene, self.source = table, scene, source
