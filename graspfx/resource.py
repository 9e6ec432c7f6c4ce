"""Base class of objects that are closed at the end of a `with` block."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Self


class Resource(ABC):
    """Context manager that is open when it is created, and is closed at the end of the `with` block."""

    @abstractmethod
    def close(self) -> None:
        """Close the resource."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()
