"""Ranges of keys over a population of operators, which a scene states for its certificates."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from graspfx.errors import abbreviate
from graspfx.scene.tables.fields import INVALID, Number, Table

EXAMPLE = '"finger.*.hand.stiffness" = { low = 50.0, high = 1000.0 }'


class OperatorSpan(Table):
    """Range of one key over the operators; a list [low, high] is short for the table."""

    low: Number = Field(description="smallest value")
    high: Number = Field(description="largest value")
    law: Literal["log", "uniform", "normal", "lognormal"] = Field(
        default="log", description="distribution of a population; a bell has 95 % between low and high, then truncated"
    )

    @model_validator(mode="before")
    @classmethod
    def _listed(cls, value: Any) -> Any:
        if isinstance(value, list | tuple):
            if len(value) not in (2, 3):
                text = "expected [low, high] or [low, high, law], as in {example}; given {given}"
                raise PydanticCustomError("range", text, {"example": EXAMPLE, "given": abbreviate(value)})
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
