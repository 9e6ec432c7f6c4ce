"""The table of a whole scene, field by field; SI units."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field
from pydantic_core import PydanticCustomError

from graspfx.errors import abbreviate
from graspfx.scene.tables.fields import Name, Positive, Table, Vector
from graspfx.scene.tables.hands import AnySharedHand
from graspfx.scene.tables.part_tables import Coupling, Finger, Object, Obstacle, SharedDevice, World
from graspfx.scene.tables.preset_table import Preset
from graspfx.scene.tables.reading import Readable
from graspfx.scene.tables.record_table import Record
from graspfx.scene.tables.safety_table import Safety


def _no_switch(value: Any) -> Any:
    return str(value).lower() if isinstance(value, bool) else value  # true equals 1 to Python


def _writable(value: str) -> str:
    """Check text for a recording's file."""
    if "\0" in value or any("\ud800" <= letter <= "\udfff" for letter in value):
        text = "expected text without NUL and lone surrogates; given {given}"
        raise PydanticCustomError("title", text, {"given": abbreviate(value)})
    return value


def _table_or_list(value: Any) -> Any:
    return [value] if isinstance(value, Mapping | Object) else value


def _columns(value: Any) -> Any:
    return {"columns": value} if isinstance(value, str | list | tuple) else value


class SceneTable(Readable, Table):
    """A whole scene, each field on its own; what the fields must be to one another is checked elsewhere."""

    title: Annotated[str, AfterValidator(_writable)] = ""
    dimensions: Annotated[Literal[1, 2, 3], BeforeValidator(_no_switch)] = Field(description="d")
    period: Positive = Field(description="T [s]")
    engine: Literal["auto", "generic", "compiled", "interpreted"] = Field(
        default="auto",
        description="what runs the ticks: kernels that all scenes share, a program of this scene, the script itself",
    )
    duration: Positive = Field(description="[s]")
    gravity: Vector | None = Field(default=None, description="(d,) [m/s^2]; none if not given")
    object: Annotated[tuple[Object, ...], BeforeValidator(_table_or_list)]
    coupling: Coupling
    finger: tuple[Finger, ...]
    device: tuple[SharedDevice, ...] = ()
    hand: tuple[AnySharedHand, ...] = ()
    obstacle: tuple[Obstacle, ...] = ()
    world: World = World()
    safety: Safety | None = Field(
        default=None, description="the chain between law and devices; none in a simulation without the table"
    )
    record: Annotated[Record, BeforeValidator(_columns)] = Record()
    preset: dict[Name, Preset] = Field(default_factory=dict, description="by name")
