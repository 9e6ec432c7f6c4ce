"""Source of a scene: file, preset and overrides."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from graspfx import environment
from graspfx.environment import resolved, to_path


@dataclass(frozen=True)
class Source:
    """Source of a scene: the file that was read, and the changes that the user made.

    Attributes:
        name: Name of the scene in error messages.
        text: Text of the file, unchanged; empty for a scene that was made in Python.
        path: Path of the file; None if there is no file.
        overrides: Overrides by dotted key, as given by the user.
        preset: Name of the preset that is used; empty if none is used.
        preset_values: Values of this preset, by dotted key.
        is_recorded: Whether the scene was read from a recording. Python files in its folder must then not be run,
            because no user has chosen the folder.
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
        """Values that replace values of the file, by dotted key; overrides take precedence over preset values."""
        first = {key: value for key, value in self.preset_values.items() if key not in self.overrides}
        return first | dict(self.overrides)

    @property
    def folder(self) -> Path | None:
        """Folder to which relative paths in the scene refer; None for the current folder."""
        return self.path.parent if self.path is not None else None

    @property
    def is_trusted(self) -> bool:
        """Whether all files that the scene names may be used: if it is Python code, or if the user allows all files."""
        return self.path is None or self.path.suffix == ".py" or environment.is_granted()

    def is_of_user(self, text: str) -> bool:
        """Return whether a text is the value of an override, or is contained in a list or table that is."""
        return text in texts_in(self.overrides)

    def holds(self, text: str) -> bool:
        """Return whether a path (with links resolved) is in the folder of the scene's file, or is given by an override.

        Raises:
            InputError: If the path does not exist.
        """
        if self.folder is None or self.is_of_user(text):
            return True
        place = resolved("path", to_path("path", text, folder=self.folder))
        return place.is_relative_to(resolved("path", self.folder))


def texts_in(value: Any) -> Iterator[str]:
    """Yield all strings in a value, including those in nested lists and tables."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping | list | tuple):
        for each in value.values() if isinstance(value, Mapping) else value:
            yield from texts_in(each)
