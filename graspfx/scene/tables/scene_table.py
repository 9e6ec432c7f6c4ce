"""Table of a whole scene, field by field, in SI units."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field
from pydantic_core import PydanticCustomError

from graspfx.errors import abbreviate
from graspfx.scene.tables.fields import Name, NotValid, Positive, Table, Vector
from graspfx.scene.tables.hands import AnySharedHand
from graspfx.scene.tables.operators_table import OperatorSpan
from graspfx.scene.tables.part_tables import Coupling, Finger, Object, Obstacle, SharedDevice, World
from graspfx.scene.tables.preset_table import Preset
from graspfx.scene.tables.reading import Readable
from graspfx.scene.tables.record_table import Record
from graspfx.scene.tables.safety_table import Safety


def _no_switch(value: Any) -> Any:
    return str(value).lower() if isinstance(value, bool) else value  # in Python, True equals 1


def _writable(value: str) -> str:
    """Check text for a recording's file."""
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
    """A whole scene. Its fields are validated one by one, and then against one another."""

    title: Annotated[str, AfterValidator(_writable)] = Field(default="", description="title of figures and summaries")
    dimensions: Annotated[Literal[1, 2, 3], BeforeValidator(_no_switch)] = Field(
        description="dimension d: 1 for a line, 2 for the plane, 3 for space"
    )
    period: Positive = Field(description="period T of a tick [s]")
    engine: Annotated[Literal["auto", "compiled", "interpreted"], BeforeValidator(_engine)] = Field(
        default="auto",
        description="engine of the ticks: compiled if possible, compiled or an error, or interpreted source",
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
            NotValid: In a draft, the object of a finger does not exist.
        """
        names = {thing.name for thing in self.object}
        if not names or any(finger.object and finger.object not in names for finger in self.finger):
            raise NotValid("finger_objects")
        return super().finger_objects
