"""The ranges of keys over a set of operators that a scene states for its certificates."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from graspfx.errors import abbreviate
from graspfx.scene.tables.fields import INVALID, Number, Table

EXAMPLE = '"finger.*.hand.stiffness" = { low = 50.0, high = 1000.0 }'


class OperatorSpan(Table):
    """The values of one key over the operators who may hold the devices; a list [low, high] is the same."""

    low: Number = Field(description="the least value")
    high: Number = Field(description="the largest value")
    law: Literal["log", "uniform", "normal", "lognormal"] = Field(
        default="log", description="how a population is spread between; bells have 95 % between the ends, and are cut"
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
            text = "expected an end above the beginning; given {low} and {high}"
            raise PydanticCustomError("range", text, {"low": self.low, "high": self.high})
        if self.law in ("log", "lognormal") and self.low <= 0.0:
            text = "expected ends above zero for the law {law}; given {low}"
            raise PydanticCustomError("range", text, {"law": self.law, "low": self.low})
        return self
