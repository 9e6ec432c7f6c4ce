"""Memory of programs, which later variants of a scene in the same thread reuse."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field

from graspfx.batch.groups import Built, Program


@dataclass
class PartMemory:
    """A memory for variants that are run in parts.

    Attributes:
        programs: programs by layout.
        bases: built and verified variant for each kind of values of some keys.
    """

    programs: dict[str, Program] = field(default_factory=dict)
    bases: dict[Hashable, Built] = field(default_factory=dict)
