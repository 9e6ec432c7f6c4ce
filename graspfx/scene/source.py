"""Where a scene came from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from graspfx import environment
from graspfx.environment import resolved, to_path


@dataclass(frozen=True)
class Source:
    """Where a scene came from.

    Attributes:
        name: as it stands in messages.
        text: of the file, verbatim; empty for a scene made in Python.
        path: of the file.
        overrides: by dotted key, as a user gave them.
        preset: the name of the scene's preset in force; empty for none.
        preset_values: that preset's, by dotted key.
        is_recorded: whether a recording says all this: then nobody chose the folder, and no Python in it may run.
    """

    name: str = "scene"
    text: str = ""
    path: Path | None = None
    overrides: Mapping[str, Any] = field(default_factory=dict)
    preset: str = ""
    preset_values: Mapping[str, Any] = field(default_factory=dict)
    is_recorded: bool = False

    @property
    def changes(self) -> dict[str, Any]:
        """All values that replace the file's, by dotted key, in their order: the preset's, then the overrides."""
        first = {key: value for key, value in self.preset_values.items() if key not in self.overrides}
        return first | dict(self.overrides)

    @property
    def folder(self) -> Path | None:
        """Where relative paths in the scene start; None for the current folder."""
        return self.path.parent if self.path is not None else None

    @property
    def is_trusted(self) -> bool:
        """Whether all that the scene names may be used: it is Python, or the user says so."""
        return self.path is None or self.path.suffix == ".py" or environment.is_granted()

    def is_of_user(self, text: str) -> bool:
        """Tell whether an override names this."""
        return text in texts_in(self.overrides)

    def holds(self, text: str) -> bool:
        """Tell whether a path leads into the folder of the scene's file, through all links, or an override names it.

        Raises:
            InputError: a path that leads nowhere.
        """
        if self.folder is None or self.is_of_user(text):
            return True
        place = resolved("path", to_path("path", text, folder=self.folder))
        return place.is_relative_to(resolved("path", self.folder))


def texts_in(value: Any) -> Iterator[str]:
    """List all texts in a value of a table, at every depth."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping | list | tuple):
        for each in value.values() if isinstance(value, Mapping) else value:
            yield from texts_in(each)
