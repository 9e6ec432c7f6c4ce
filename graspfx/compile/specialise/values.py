"""Values of expressions during specialisation: static, dynamic, or references."""

from __future__ import annotations

import ast
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

Number = bool | int | float


@dataclass(frozen=True)
class Static:
    """A number."""

    value: Number

    @property
    def key(self) -> tuple[str, str]:
        return type(self.value).__name__, repr(self.value)  # 1 and 1.0, and 0.0 and -0.0, give different programs


@dataclass(frozen=True)
class Memory:
    """A buffer: a region of one of the program's arrays."""

    array: str
    base: int


@dataclass(frozen=True)
class Reference:
    """A module or one of its functions."""

    of: ModuleType | Callable[..., Any]


@dataclass(frozen=True)
class Dynamic:
    """A number computed by the running program, as an expression."""

    node: ast.expr


@dataclass(frozen=True)
class TupleValue:
    """A tuple with possibly known items; `node` computes all of it, unless it is None."""

    parts: tuple[Static | Dynamic, ...]
    node: ast.expr | None


Value = Static | Memory | Reference | Dynamic | TupleValue


def same(a: Value | None, b: Value | None) -> bool:
    """Tell whether both are static and equal to the last bit."""
    if isinstance(a, Static) and isinstance(b, Static):
        return a.key == b.key
    return isinstance(a, Memory | Reference) and a == b
