"""Shapes of values: the types of a variable's numbers, and which of them are one for each lane."""

from __future__ import annotations

from typing import NamedTuple

from graspfx.compile.llvm.llvm_arithmetic import BOOL, INT, Number, widest
from graspfx.compile.llvm.llvm_expressions import Value

Kind = tuple[str, bool]  # a number's type, and whether it is one for each lane
Scope = dict[str, Value]
Names = frozenset[str]


class Shape(NamedTuple):
    """Kinds of a variable's numbers: of one, or of several in a tuple."""

    is_tuple: bool
    kinds: tuple[Kind, ...]

    @property
    def varies(self) -> bool:
        return any(varies for _, varies in self.kinds)

    def joined(self, other: Shape) -> Shape:
        """Find the common shape of a variable that two ways leave with different ones."""
        if self.is_tuple != other.is_tuple or len(self.kinds) != len(other.kinds):
            return self
        pairs = zip(self.kinds, other.kinds, strict=True)
        return Shape(self.is_tuple, tuple((widest((a[0], b[0])), a[1] or b[1]) for a, b in pairs))


def number_at(scope: Scope, name: str) -> Number:
    value = scope[name]
    assert isinstance(value, Number)
    return value


def unset(value: Value) -> bool:
    return isinstance(value, Number) and value.text == "undef"


def zero(type_: str) -> str:
    return {BOOL: "false", INT: "0"}.get(type_, "0.0")
