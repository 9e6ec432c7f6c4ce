"""Base class of objects that a `with` statement closes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Self


class Resource(ABC):
    """Context manager that is open from its creation, and closed when its block ends."""

    @abstractmethod
    def close(self) -> None:
        """Close the resource."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()
