"""Table `safety` of a scene: limits of force, force rate, speed and workspace."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field, PlainSerializer, PlainValidator, Tag, WithJsonSchema
from pydantic_core import PydanticCustomError

from graspfx.errors import abbreviate
from graspfx.scene.tables.fields import Count, NotNegative, Positive, Table, listed, word_or_list

Corners = tuple[tuple[float, ...], tuple[float, ...]]
EXPECTED = "'device', 'none', or two corners [[lower], [upper]] [m], with lower < upper on every axis"


def _corners(value: Any) -> Corners:
    """Return the lower and upper corners of a box as tuples of equal length; raise an error if they are invalid."""
    value = listed(value)
    sides = list(value) if isinstance(value, list | tuple) else []
    if len(sides) != 2 or any(not isinstance(side, list | tuple) for side in sides):
        raise _not_a_box(value)
    lower, upper = sides
    numbers = [*lower, *upper]
    if any(isinstance(x, bool) or not isinstance(x, int | float) or not math.isfinite(x) for x in numbers):
        raise _not_a_box(value)
    if not lower or len(lower) != len(upper) or any(a >= b for a, b in zip(lower, upper, strict=True)):
        raise _not_a_box(value)
    return tuple(map(float, lower)), tuple(map(float, upper))


def _not_a_box(value: Any) -> PydanticCustomError:
    context = {"expected": EXPECTED, "given": abbreviate(value)}
    return PydanticCustomError("workspace", "expected {expected}; given {given}", context)


_SIDE = {"type": "array", "items": {"type": "number"}, "minItems": 1, "maxItems": 3}
Box = Annotated[
    Corners,
    PlainValidator(_corners),
    PlainSerializer(lambda value: value),
    WithJsonSchema({"type": "array", "items": _SIDE, "minItems": 2, "maxItems": 2}),
]
Workspace = Annotated[Annotated[Literal["device", "none"], Tag("<name>")] | Annotated[Box, Tag("<list>")], word_or_list]


class FingerSafety(Table):
    """Limits of one finger, which replace those of the scene."""

    force: Positive | None = Field(
        default=None, description="largest force of the finger [N]; the scene's if not given"
    )
    rate: Positive | None = Field(
        default=None, description="largest rate of growth of the finger's force [N/s]; the scene's if not given"
    )
    speed: Positive | None = Field(
        default=None,
        description="largest speed of the finger [m/s], above which there is a fault; the scene's if not given",
    )
    workspace: Workspace | None = Field(
        default=None,
        description="box, [[lower], [upper]] [m], 'device' or 'none'; forces do not push the finger out of the box; "
        "the "
        "scene's if not given",
    )


class Safety(Table):
    """Limits between the coupling law and the devices; the object receives the limited forces too."""

    force: Positive | None = Field(
        default=None,
        description="largest force of a finger [N]; if not given, 0.6 of the continuous force of its device, or 3 N if "
        "the device does not state its continuous force",
    )
    rate: Positive | None = Field(
        default=None, description="largest rate of growth of a finger's force [N/s]; no limit if not given"
    )
    speed: Positive | None = Field(
        default=None,
        description="largest speed of a finger [m/s], from its velocity or from its positions; above this speed, "
        "forces "
        "decay in 20 ms and a fault follows; no limit if not given",
    )
    hold: Count = Field(
        default=3,
        description="largest tolerated number of consecutive samples without a new reading; after more samples, forces "
        "decay in 20 ms",
    )
    watchdog: Positive | None = Field(
        default=None,
        description="largest lateness of a real-time loop [s]; at a larger lateness, forces decay; five periods if not "
        "given",
    )
    soft_start: NotNegative = Field(
        default=0.5, description="time in which stiffness and damping grow from zero to their values at the start [s]"
    )
    workspace: Workspace = Field(
        default="device",
        description="box out of which forces do not push a finger: [[lower], [upper]] [m]; 'device', the workspace of "
        "the finger's device; or 'none'",
    )
