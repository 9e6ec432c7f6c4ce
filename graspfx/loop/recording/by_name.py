"""Parts by their names, of which an unknown one is told with those that there are."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TypeVar

from graspfx.errors import UnknownNameError

T = TypeVar("T")


def by_name(kind: str, parts: Mapping[str, T]) -> Mapping[str, T]:
    """Make a mapping that cannot be changed, and that raises UnknownNameError, a KeyError, with the names it has."""
    return MappingProxyType(_Parts(kind, parts))


class _Parts(dict[str, T]):
    def __init__(self, kind: str, parts: Mapping[str, T]) -> None:
        super().__init__(parts)
        self._kind = kind

    def __missing__(self, name: object) -> T:
        raise UnknownNameError(self._kind, str(name), self)
