"""Table of a whole scene, field by field, in SI units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from graspfx.errors import abbreviate
from graspfx.scene.tables.fields import INVALID, Name, NotNegative, NotValid, Number, Positive, Table, Vector, listed
from graspfx.scene.tables.hand_tables import AnySharedHand
from graspfx.scene.tables.part_tables import Coupling, Finger, Object, Obstacle, Record, SharedDevice, World
from graspfx.scene.tables.reading import Readable
from graspfx.scene.tables.safety_table import Safety

# Object and coupling of a scene with a host: placeholders, because the host simulates the object.
OBJECT: Mapping[str, Any] = {"name": "host", "mass": 1.0, "viscosity": 0.0}
COUPLING: Mapping[str, Any] = {"contact": "attached", "external": {"stiffness": 0.0}, "internal": {"stiffness": 0.0}}


class Host(Table):
    """Host program whose forces the devices display, in place of an object and its coupling (`gx.Feedback`)."""

    name: Name = Field(description="name under which the host finds the loop: `feedback.connect(name)`")
    predict: Literal["hold", "linear", "model"] = Field(
        default="hold",
        description="forces between two samples: constant, extrapolated linearly, or changed by `push_stiffness` and "
        "`squeeze_stiffness` times the fingers' motion",
    )
    push_stiffness: NotNegative = Field(
        default=0.0,
        description='stiffness that a finger feels if all fingers move together, for `predict = "model"` [N/m]',
    )
    squeeze_stiffness: NotNegative = Field(
        default=0.0, description='stiffness that a finger feels in a squeeze, for `predict = "model"` [N/m]'
    )
    silence: Positive = Field(
        default=0.1,
        description="time without a new sample after which forces fade to zero in 20 ms and a fault follows [s]",
    )
    tank: NotNegative = Field(
        default=0.05, description="initial energy of the push tank and of the squeeze tank [J]; 0 switches both off"
    )
    tank_room: NotNegative = Field(default=0.5, description="largest energy of a tank [J]; at least `tank`")
    speed: Positive = Field(
        default=1.0, description="largest speed of a finger for which the tanks are valid; beyond it is a fault [m/s]"
    )
    largest: Positive = Field(
        default=1e3, description="largest plausible force of a finger from the host; a larger one is a fault [N]"
    )


PRESET_EXAMPLE = '{ "finger.*.hand.damping" = 0.3 }'


def _stated(value: str) -> str:
    if not value.strip():
        raise PydanticCustomError("reason", "expected a sentence about the purpose of the preset")
    return value


def values_by_key(value: Any) -> Any:
    if not isinstance(value, Mapping) or not value:
        text = "expected values by dotted key, as in {example}; given {given}"
        raise PydanticCustomError("set", text, {"example": PRESET_EXAMPLE, "given": abbreviate(value)})
    if any(str(key).partition(".")[0] == "preset" for key in value):
        raise PydanticCustomError("set", "expected values of the scene; a preset does not change presets")
    return {str(key): _plain(each) for key, each in value.items()}


def _plain(value: Any) -> Any:
    """Copy finite numbers, text, true, false, and lists and tables of them; refuse everything else."""
    value = listed(value)
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if not isinstance(value, bool | int | float | str) or (isinstance(value, float) and not math.isfinite(value)):
        text = "expected finite numbers, text, true or false, lists and tables of them; given {given}"
        raise PydanticCustomError("set", text, {"given": abbreviate(value)})
    return value


class Preset(Table):
    """Values that replace the scene's if the user names the preset; values of `--set` are applied afterwards."""

    reason: Annotated[str, AfterValidator(_stated)] = Field(description="purpose of the preset, in a sentence")
    set: Annotated[dict[str, Any], BeforeValidator(values_by_key)] = Field(
        description=f"values by dotted key, as in {PRESET_EXAMPLE}"
    )


RANGE_EXAMPLE = '"finger.*.hand.stiffness" = { low = 50.0, high = 1000.0 }'


class OperatorSpan(Table):
    """Range of one key over the operators; a list [low, high] or [low, high, law] is short for the table."""

    low: Number = Field(description="smallest value")
    high: Number = Field(description="largest value")
    law: Literal["log", "uniform", "normal", "lognormal"] = Field(
        default="log",
        description="distribution over a population, by default uniform if low is not above zero; normal and lognormal "
        "laws have 95 % of the population in the range, to which they are truncated",
    )

    @model_validator(mode="before")
    @classmethod
    def _listed(cls, value: Any) -> Any:
        if isinstance(value, list | tuple):
            if len(value) not in (2, 3):
                text = "expected [low, high] or [low, high, law], as in {example}; given {given}"
                raise PydanticCustomError("range", text, {"example": RANGE_EXAMPLE, "given": abbreviate(value)})
            value = dict(zip(("low", "high", "law"), value, strict=False))
        if isinstance(value, Mapping) and "law" not in value:
            low = value.get("low")
            value = {**value, "law": "log" if isinstance(low, int | float) and low > 0.0 else "uniform"}
        return value

    @model_validator(mode="after")
    def _rising(self) -> OperatorSpan:
        if INVALID in (vars(self).get(name, INVALID) for name in ("low", "high", "law")):
            return self  # a draft
        if not self.low < self.high:
            text = "expected low below high; given {low} and {high}"
            raise PydanticCustomError("range", text, {"low": self.low, "high": self.high})
        if self.law in ("log", "lognormal") and self.low <= 0.0:
            text = "expected values above zero for the law {law}; given {low}"
            raise PydanticCustomError("range", text, {"law": self.law, "low": self.low})
        return self


def _no_switch(value: Any) -> Any:
    return str(value).lower() if isinstance(value, bool) else value  # in Python, True equals 1


def _writable(value: str) -> str:
    """Refuse text with NUL or lone surrogates, which a recording's file cannot hold."""
    if "\0" in value or any("\ud800" <= letter <= "\udfff" for letter in value):
        text = "expected text without NUL and lone surrogates; given {given}"
        raise PydanticCustomError("title", text, {"given": abbreviate(value)})
    return value


def _engine(value: Any) -> Any:
    return "compiled" if value == "generic" else value  # recordings and scenes of earlier versions


def _table_or_list(value: Any) -> Any:
    return [value] if isinstance(value, Mapping | Object) else value


def _columns(value: Any) -> Any:
    return {"columns": value} if isinstance(value, str | list | tuple) else value


class SceneTable(Readable, Table):
    """A whole scene. The fields are validated one by one, and then against one another."""

    title: Annotated[str, AfterValidator(_writable)] = Field(default="", description="title of figures and summaries")
    dimensions: Annotated[Literal[1, 2, 3], BeforeValidator(_no_switch)] = Field(
        description="dimension d: 1 for a line, 2 for the plane, 3 for space"
    )
    period: Positive = Field(description="period T of a tick [s]")
    engine: Annotated[Literal["auto", "compiled", "interpreted"], BeforeValidator(_engine)] = Field(
        default="auto",
        description="engine of the ticks: auto compiles if possible, compiled requires it, interpreted never compiles",
    )
    duration: Positive = Field(description="duration of a run [s]")
    gravity: Vector | None = Field(default=None, description="gravity, (d,) [m/s^2]; none if not given")
    object: Annotated[tuple[Object, ...], BeforeValidator(_table_or_list)] = Field(
        description="object that the fingers touch: a table, or several as [[object]]"
    )
    coupling: Coupling = Field(description="coupling of fingers and objects")
    finger: tuple[Finger, ...] = Field(description="table [[finger]] for each fingertip")
    device: tuple[SharedDevice, ...] = Field(default=(), description="device with several fingers")
    hand: tuple[AnySharedHand, ...] = Field(default=(), description="hand that holds several fingers")
    obstacle: tuple[Obstacle, ...] = Field(default=(), description="fixed obstacle that objects meet")
    world: World = Field(default=World(), description="contact of objects with obstacles and one another")
    safety: Safety | None = Field(
        default=None, description="safety chain between law and devices; none in a simulation without the table"
    )
    host: Host | None = Field(
        default=None,
        description="host program that simulates the object; `object` and `coupling` are then omitted",
    )
    record: Annotated[Record, BeforeValidator(_columns)] = Field(
        default=Record(), description="columns and ticks of a recording"
    )
    preset: dict[Name, Preset] = Field(default_factory=dict, description="values that replace the scene's, by name")
    operators: dict[str, OperatorSpan] = Field(
        default_factory=dict, description="ranges of keys over a population of operators, for certificates"
    )

    @property
    def finger_objects(self) -> tuple[int, ...]:
        """Index of the object that each finger touches.

        Raises:
            NotValid: In a draft, if no object is valid, or a finger names an object that does not exist.
        """
        names = {thing.name for thing in self.object}
        if not names or any(finger.object and finger.object not in names for finger in self.finger):
            raise NotValid("finger_objects")
        return super().finger_objects
