"""Values that no argument should swallow silently: NaN, infinities, too large or too small, other kinds and shapes."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from graspfx.errors import GraspFXError

SINGLE: tuple[Any, ...] = (
    math.nan, math.inf, -math.inf, -1.0, 0.0, 1e308, -1e308, 1e200, 1e-200, 1e-308, 5e-324, 10**400, True, 1j,
    "x", b"x", None, object(), [], {}, [math.nan], [None], [[1.0, 2.0], [3.0]], np.zeros((2, 2, 2, 2)), np.array("x"),
)  # fmt: skip
WITHIN = (math.nan, math.inf, -math.inf, 1e308, 1e200, 1e-200, 1e-308)


def bad_values(good: Any) -> Iterator[Any]:
    """Values of every wrong kind; for a good value with entries also those with one entry or all of them spoilt."""
    yield from SINGLE
    if not isinstance(good, list | tuple | np.ndarray):
        return
    try:
        array = np.array(good, dtype=float)
    except (TypeError, ValueError):
        return
    for value in WITHIN:
        for index in {0, array.size - 1} - {-1}:
            spoilt = array.ravel().copy()
            spoilt[index] = value
            yield spoilt.reshape(array.shape)
    with np.errstate(all="ignore"):
        yield from [factor * array for factor in (0.0, 1e200, 1e-200, 1e308, 1e-320)]
    yield from (array[:-1], array.astype(complex), array.astype(object), array.astype(str), array.astype(np.float32))


def outcome(call: Callable[..., Any], arguments: dict[str, Any]) -> str:
    """Empty where a call gives numbers or an error of GraspFX with a text; else what it did instead."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            result = call(**arguments)
        except GraspFXError as error:
            return "" if str(error) and "Traceback" not in str(error) else "an error without a text"
        except Exception as error:  # noqa: BLE001 - whatever else it is, is the fault that is looked for
            return f"{type(error).__name__}: {error}"
    return "" if no_nan(result) else "NaN"


def no_nan(result: Any, depth: int = 0) -> bool:
    """Whether numbers, arrays and tuples of them hold no NaN."""
    if isinstance(result, float | np.floating):
        return not math.isnan(result)
    if isinstance(result, np.ndarray) and result.dtype.kind == "f":
        return not np.isnan(result).any()
    return not isinstance(result, tuple) or depth > 3 or all(no_nan(each, depth + 1) for each in result)
