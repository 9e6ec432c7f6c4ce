"""Limits of a certificate of which the later ones are computed when somebody looks at them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, overload

if TYPE_CHECKING:
    from graspfx.certificate.certificate import Limit


class LimitList(Sequence["Limit"]):
    """A sequence of limits.

    Args:
        first: the limits that are there, which an index below their number asks for alone.
        more: computes the others, once.
    """

    def __init__(self, first: Iterable[Limit], more: Callable[[], Iterable[Limit]]) -> None:
        self.first, self._more = tuple(first), more

    @cached_property
    def all(self) -> tuple[Limit, ...]:
        """All of them."""
        return (*self.first, *self._more())

    @overload
    def __getitem__(self, index: int) -> Limit: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[Limit, ...]: ...

    def __getitem__(self, index: int | slice) -> Limit | tuple[Limit, ...]:
        if isinstance(index, int) and 0 <= index < len(self.first):
            return self.first[index]
        return self.all[index]

    def __len__(self) -> int:
        return len(self.all)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and self.all == tuple(other)

    __hash__ = None  # type: ignore[assignment] # as of what it is equal to only in part

    def __reduce__(self) -> tuple[Any, ...]:
        return tuple, (self.all,)

    def __repr__(self) -> str:
        return repr(self.all)
