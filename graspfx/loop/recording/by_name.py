"""Parts by their names, of which an unknown one is told with those that there are."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
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


class PartsOnDemand(Mapping[str, T]):
    """Parts that are made whenever they are asked for.

    Args:
        kind: of a part, for the error of an unknown one.
        keys: by name, what each is made from.
        make: makes it.
    """

    def __init__(self, kind: str, keys: Mapping[str, str], make: Callable[[str], T]) -> None:
        self._kind, self._keys, self._make = kind, keys, make

    def __getitem__(self, name: str) -> T:
        if name not in self._keys:
            raise UnknownNameError(self._kind, str(name), self._keys)
        return self._make(self._keys[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._keys)

    def __len__(self) -> int:
        return len(self._keys)
