"""Memory of programs and their texts, which some variants of a scene leave to the next ones in the same thread."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import TypeVar

from graspfx.batch.groups import Built, Program

T = TypeVar("T")


@dataclass
class PartMemory:
    """A memory for variants that come in parts.

    Attributes:
        programs: by structure.
        bases: a variant that was built for each kind of values of some keys, whose columns were checked.
        texts: what was written from programs, by what it depends on.
    """

    programs: dict[str, Program] = field(default_factory=dict)
    bases: dict[Hashable, Built] = field(default_factory=dict)
    texts: dict[Hashable, object] = field(default_factory=dict)

    def recall(self, key: Hashable, make: Callable[[], T]) -> T:
        """Give what was made for a key, or make it."""
        if key not in self.texts:
            self.texts[key] = make()
        return self.texts[key]  # type: ignore[return-value]
