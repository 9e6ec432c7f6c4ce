"""Table of a complete scene, in SI units."""

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
    """Program that simulates the object and computes the forces that the devices display (`gx.Feedback`)."""

    name: Name = Field(description="name with which the program connects to the loop: `feedback.connect(name)`")
    predict: Literal["hold", "linear", "model"] = Field(
        default="hold",
        description="forces between two samples of the program: constant, linearly extrapolated, or changed by "
        "`push_stiffness` and `squeeze_stiffness` times the motion of the fingers",
    )
    push_stiffness: NotNegative = Field(
        default=0.0,
        description='stiffness against a common motion of all fingers, for `predict = "model"` [N/m]',
    )
    squeeze_stiffness: NotNegative = Field(
        default=0.0, description='stiffness against a squeeze of the fingers, for `predict = "model"` [N/m]'
    )
    silence: Positive = Field(
        default=0.1,
        description="longest time without a new sample [s]; after it, forces decay to zero in 20 ms and a fault "
        "follows",
    )
    tank: NotNegative = Field(
        default=0.05, description="initial energy of the push tank and of the squeeze tank [J]; 0 disables both tanks"
    )
    tank_room: NotNegative = Field(default=0.5, description="largest energy of a tank [J]; at least `tank`")
    speed: Positive = Field(
        default=1.0,
        description="largest speed of a finger [m/s], up to which the tanks are valid; above it there is a fault",
    )
    largest: Positive = Field(
        default=1e3, description="largest force of a finger that the program may send [N]; a larger force is a fault"
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
    """Return a copy of finite numbers, texts and booleans in nested lists and tables; refuse any other value."""
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
    """Values that replace values of the scene if the preset is chosen; `--set` can replace them again."""

    reason: Annotated[str, AfterValidator(_stated)] = Field(description="purpose of the preset, as a sentence")
    set: Annotated[dict[str, Any], BeforeValidator(values_by_key)] = Field(
        description=f"values by dotted key, as in {PRESET_EXAMPLE}"
    )


RANGE_EXAMPLE = '"finger.*.hand.stiffness" = { low = 50.0, high = 1000.0 }'


class OperatorSpan(Table):
    """Range of a key over a population of operators; [low, high] or [low, high, law] is equivalent to the table."""

    low: Number = Field(description="smallest value")
    high: Number = Field(description="largest value")
    law: Literal["log", "uniform", "normal", "lognormal"] = Field(
        default="log",
        description="distribution over the population; the default is uniform if `low` is zero or negative; normal and "
        "lognormal distributions have 95 % of the population in the range, and are truncated to the range",
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
    """Return a text after a check that a recording's file can contain it: no NUL, no lone surrogates."""
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
    """A complete scene. Each field is validated, and then the fields are checked against one another."""

    title: Annotated[str, AfterValidator(_writable)] = Field(default="", description="title in figures and summaries")
    dimensions: Annotated[Literal[1, 2, 3], BeforeValidator(_no_switch)] = Field(
        description="number of dimensions d: 1 for a line, 2 for the plane, 3 for space"
    )
    period: Positive = Field(description="period T of a tick [s]")
    engine: Annotated[Literal["auto", "compiled", "interpreted"], BeforeValidator(_engine)] = Field(
        default="auto",
        description="engine of the ticks: auto compiles if possible, compiled requires a compiler, interpreted uses "
        "none",
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
    world: World = Field(default=World(), description="contact of objects with obstacles and with one another")
    safety: Safety | None = Field(
        default=None,
        description="limits of the forces of the coupling law; without the table, a simulation has no such limits",
    )
    host: Host | None = Field(
        default=None,
        description="program that simulates the object; `object` and `coupling` are then omitted",
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
