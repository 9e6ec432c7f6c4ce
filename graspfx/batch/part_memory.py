"""Memory of programs, which some variants of a scene leave to the next ones in the same thread."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field

from graspfx.batch.groups import Built, Program


@dataclass
class PartMemory:
    """A memory for variants that come in parts.

    Attributes:
        programs: by structure.
        bases: a variant that was built for each kind of values of some keys, whose columns were checked.
    """

    programs: dict[str, Program] = field(default_factory=dict)
    bases: dict[Hashable, Built] = field(default_factory=dict)
