"""Strict types of the fields of a scene: finite numbers, vectors, gains, and tables without unknown keys."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Final, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    PlainSerializer,
    PlainValidator,
    Tag,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
    model_validator,
)
from pydantic_core import PydanticCustomError

from graspfx.errors import InputError, abbreviate, closest
from graspfx.numeric import LARGEST, SMALLEST

DRAFT: Final = {"draft": True}  # validation context that drops invalid fields
INVALID: Final = object()
ROUNDING = 1e-12  # relative tolerance for symmetric and positive semidefinite matrices


class NotValid(AttributeError):
    """Error for access to an invalid field of a draft; checks that depend on the field are skipped."""


class Table(BaseModel):
    """A frozen table. With DRAFT as the validation context, invalid fields are removed instead of reported."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, validate_default=False, defer_build=True
    )

    @model_validator(mode="before")
    @classmethod
    def _tolerate(cls, data: Any, info: ValidationInfo) -> Any:
        if info.context is not DRAFT:
            return data
        values: Mapping[str, Any] = data if isinstance(data, Mapping) else {}
        missing = {name: INVALID for name, field in cls.model_fields.items() if field.is_required()}
        open_ended = cls.model_config["extra"] == "allow"
        return missing | {key: value for key, value in values.items() if open_ended or key in cls.model_fields}

    @field_validator("*", mode="wrap")
    @classmethod
    def _accept(cls, value: Any, handler: Callable[[Any], Any], info: ValidationInfo) -> Any:
        if info.context is not DRAFT:
            return handler(value)
        if value is INVALID:
            return INVALID
        try:
            return handler(value)
        except ValueError:
            return INVALID

    @model_validator(mode="after")
    def _forget(self) -> Self:
        for name in [name for name, value in self.__dict__.items() if value is INVALID]:
            del self.__dict__[name]
        return self

    def __setattr__(self, name: str, value: Any) -> None:
        if not name.startswith("_"):
            raise self._fixed(name, value)
        super().__setattr__(name, value)

    def __delattr__(self, name: str) -> None:
        if not name.startswith("_"):
            raise self._fixed(name, "nothing")
        super().__delattr__(name)

    def _fixed(self, name: str, value: Any) -> InputError:
        do = "use the copy that scene.replace({'coupling.internal.stiffness': 50.0}) returns"
        return InputError(f"{type(self).__name__}.{name}", value, "no assignment or deletion: a scene is frozen", do)

    if not TYPE_CHECKING:  # a visible __getattr__ would hide misspelt names from the type checker

        def __getattr__(self, name: str) -> Any:
            if name in type(self).model_fields:
                raise NotValid(name)
            return super().__getattr__(name)


def listed(value: Any) -> Any:
    """Return an array as nested lists, and any other value unchanged."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _all_listed(value: Any) -> Any:
    """Return a value with all arrays in it converted to nested lists."""
    if isinstance(value, Mapping):
        return {key: _all_listed(each) for key, each in value.items()}
    return [_all_listed(each) for each in value] if isinstance(value, list | tuple) else listed(value)


Setting = Annotated[Any, BeforeValidator(_all_listed)]  # value of a plug-in's own key


def _not_too_large(value: float) -> float:
    if abs(value) > LARGEST:
        raise PydanticCustomError("size", "expected no more than {most} in SI units", {"most": f"{LARGEST:g}"})
    return value


def _not_too_small(value: float) -> float:
    if value < SMALLEST:
        raise PydanticCustomError("size", "expected no less than {least} in SI units", {"least": f"{SMALLEST:g}"})
    return value


Number = Annotated[
    float, Field(strict=True, allow_inf_nan=False), BeforeValidator(listed), AfterValidator(_not_too_large)
]
Positive = Annotated[Number, Field(gt=0), AfterValidator(_not_too_small)]
NotNegative = Annotated[Number, Field(ge=0)]
Count = Annotated[int, Field(strict=True, ge=0)]
Switch = Annotated[bool, Field(strict=True)]
Vector = Annotated[tuple[Number, ...], BeforeValidator(listed)]
Vectors = Annotated[tuple[Vector, ...], BeforeValidator(listed)]
Pair = Annotated[tuple[Number, Number], BeforeValidator(listed)]
Point = Annotated[tuple[Number, Number, Number], BeforeValidator(listed)]
number_or_list = Discriminator(
    lambda value: "<list>" if isinstance(value, list | tuple) or getattr(value, "ndim", None) else "<number>"
)
NumberOrVector = Annotated[Annotated[Number, Tag("<number>")] | Annotated[Vector, Tag("<list>")], number_or_list]
word_or_list = Discriminator(lambda value: "<name>" if isinstance(value, str) else "<list>")
Name = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_-]*$")]

Gains = float | tuple[float, ...] | tuple[tuple[float, ...], ...] | tuple[tuple[tuple[float, ...], ...], ...]


def _gain(value: Any) -> Gains:
    """Return a gain in any of its forms as a number or nested tuples; raise one error if it is invalid."""
    value = listed(value)
    array = _numbers(value)
    square = array is not None and array.ndim in (2, 3) and array.shape[-1] == array.shape[-2]
    if array is None or array.size == 0 or not (array.ndim < 2 or square):
        expected = (
            "a number, a list with one per finger, a d x d matrix, one d x d matrix per finger or an m x m matrix"
        )
        raise PydanticCustomError("gain", "expected {expected}; given {given}", _context(expected, value))
    if not np.isfinite(array).all():
        raise PydanticCustomError("gain", "expected finite numbers; given {given}", {"given": abbreviate(value)})
    if np.abs(array).max() > LARGEST:
        text = "expected no more than {most} N/m or N s/m; given {given}"
        raise PydanticCustomError("gain", text, {"most": f"{LARGEST:g}", "given": abbreviate(value)})
    if array.ndim < 2 and (array < 0).any():
        raise PydanticCustomError("gain", "expected no less than 0; given {given}", {"given": abbreviate(value)})
    if array.ndim >= 2:
        _check_matrices(array.reshape(-1, *array.shape[-2:]))
    frozen: Gains = _frozen(array.tolist())
    return frozen


def _check_matrices(matrices: np.ndarray[Any, np.dtype[np.float64]]) -> None:
    for matrix in matrices:
        scale = float(np.abs(matrix).max())
        if np.abs(matrix - matrix.T).max() > ROUNDING * scale:
            raise PydanticCustomError("gain", "expected a symmetric matrix, because an asymmetric one creates energy")
        least = float(np.linalg.eigvalsh(matrix)[0])
        if least < -ROUNDING * scale:
            raise PydanticCustomError(
                "gain",
                "expected a matrix with no negative eigenvalue; the smallest is {least}",
                {"least": f"{least:.6g}"},
            )


def _numbers(value: Any) -> np.ndarray[Any, np.dtype[np.float64]] | None:
    """Return numbers, possibly in nested lists of equal lengths, as an array; None for any other value."""
    if isinstance(value, list | tuple):
        parts = [_numbers(item) for item in value]
        arrays = [part for part in parts if part is not None]
        if len(arrays) < len(parts) or len({part.shape for part in arrays}) > 1:
            return None
        return np.array(arrays, dtype=np.float64)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return np.array(as_float(value))


def as_float(value: float) -> float:
    """Return a number as a float; infinity if an integer is too large for a float."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def no_negative(values: tuple[float, ...]) -> tuple[float, ...]:
    """Return the numbers of a list after a check that none is negative."""
    if any(value < 0.0 for value in values):
        raise PydanticCustomError("sign", "expected no less than 0; given {given}", {"given": abbreviate(list(values))})
    return values


def _frozen(value: Any) -> Any:
    return tuple(_frozen(item) for item in value) if isinstance(value, list) else value


def _context(expected: str, value: object) -> dict[str, Any]:
    return {"expected": expected, "given": abbreviate(value)}


_NUMBER = {"type": "number", "minimum": 0}
_MATRIX = {"type": "array", "items": {"type": "array", "items": {"type": "number"}}}
Gain = Annotated[
    Gains,
    PlainValidator(_gain),
    PlainSerializer(lambda value: value),
    WithJsonSchema(
        {"anyOf": [_NUMBER, {"type": "array", "items": _NUMBER}, _MATRIX, {"type": "array", "items": _MATRIX}]}
    ),
]


def by_kind(
    kinds: tuple[str, ...], *, field: str, implied: Mapping[str, str] | None = None
) -> tuple[BeforeValidator, Discriminator]:
    """Return validators that choose one of several tables by the key `kind`, and report a missing or unknown kind.

    A table without the key `kind` that contains one of the keys of `implied` has the kind given there.
    """

    def kind_of(value: Any) -> Any:
        if not isinstance(value, Mapping):
            return getattr(value, "kind", None)
        if "kind" in value:
            return value["kind"]
        return next((kind for key, kind in (implied or {}).items() if key in value), None)

    def check(value: Any) -> Any:
        if isinstance(value, Table) or value is None or value is INVALID:
            return value
        if not isinstance(value, Mapping):
            raise PydanticCustomError("kind", "expected a table; given {given}", {"given": abbreviate(value)})
        kind = kind_of(value)
        if not isinstance(kind, str) or kind not in kinds:
            close = closest(kind, kinds) if isinstance(kind, str) else None
            hint = f"; did you mean {close!r}?" if close else ""
            context = {"given": abbreviate(kind), "known": ", ".join(kinds), "what": field, "hint": hint}
            raise PydanticCustomError("kind", "unknown kind of {what} {given}{hint} (known: {known})", context)
        return value

    return BeforeValidator(check), Discriminator(lambda value: f"<{kind_of(value)}>")
