"""What a kernel's expression is known to be before the program runs."""

from __future__ import annotations

import ast
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

Number = bool | int | float


@dataclass(frozen=True)
class Known:
    """A number."""

    value: Number

    @property
    def key(self) -> tuple[str, str]:
        return type(self.value).__name__, repr(self.value)  # 1 and 1.0, 0.0 and -0.0 are not the same program


@dataclass(frozen=True)
class Memory:
    """A buffer: a region of one of the program's arrays."""

    array: str
    base: int


@dataclass(frozen=True)
class Named:
    """A module, or a function of one."""

    of: ModuleType | Callable[..., Any]


@dataclass(frozen=True)
class Later:
    """What only the running program knows: the expression that computes it."""

    node: ast.expr


@dataclass(frozen=True)
class Several:
    """A tuple of which some may be known; `node` computes all of it, unless it is None."""

    parts: tuple[Known | Later, ...]
    node: ast.expr | None


Value = Known | Memory | Named | Later | Several


def same(a: Value | None, b: Value | None) -> bool:
    """Whether both are known to be the same, to the last bit."""
    if isinstance(a, Known) and isinstance(b, Known):
        return a.key == b.key
    return isinstance(a, Memory | Named) and a == b
