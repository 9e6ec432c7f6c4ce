"""Memory of programs, reused by later variants of a scene in the same thread."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field

from graspfx.batch.groups import Built, Program


@dataclass
class PartMemory:
    """Memory for variants that are run in several parts.

    Attributes:
        programs: Programs by layout.
        bases: Built and verified variant for each kind of values of some keys.
    """

    programs: dict[str, Program] = field(default_factory=dict)
    bases: dict[Hashable, Built] = field(default_factory=dict)
