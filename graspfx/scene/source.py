"""Where a scene came from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Source:
    """Where a scene came from.

    Attributes:
        name: as it stands in messages.
        text: of the file, verbatim; empty for a scene made in Python.
        path: of the file.
        overrides: by dotted key.
    """

    name: str = "scene"
    text: str = ""
    path: Path | None = None
    overrides: Mapping[str, Any] = field(default_factory=dict)

    @property
    def folder(self) -> Path | None:
        """Where relative paths in the scene start; None for the current folder."""
        return self.path.parent if self.path is not None else None
