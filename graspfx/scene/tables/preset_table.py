"""Table of a preset: values to replace in a scene, by dotted key, and the reason."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field
from pydantic_core import PydanticCustomError

from graspfx.errors import abbreviate
from graspfx.scene.tables.fields import Table, listed

EXAMPLE = '{ "finger.*.hand.damping" = 0.3 }'


def _stated(value: str) -> str:
    if not value.strip():
        raise PydanticCustomError("reason", "expected a sentence that says what the preset is for")
    return value


def values_by_key(value: Any) -> Any:
    if not isinstance(value, Mapping) or not value:
        text = "expected values by dotted key, as in {example}; given {given}"
        raise PydanticCustomError("set", text, {"example": EXAMPLE, "given": abbreviate(value)})
    if any(str(key).partition(".")[0] == "preset" for key in value):
        raise PydanticCustomError("set", "expected values of the scene; a preset does not change presets")
    return {str(key): _plain(each) for key, each in value.items()}


def _plain(value: Any) -> Any:
    """Copy numbers, text, lists and tables; refuse anything that TOML or JSON cannot hold."""
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
    """Values that replace the scene's, before those of `--set`, if the user names the preset."""

    reason: Annotated[str, AfterValidator(_stated)] = Field(description="purpose of the preset, in a sentence")
    set: Annotated[dict[str, Any], BeforeValidator(values_by_key)] = Field(description=f"by dotted key: {EXAMPLE}")
