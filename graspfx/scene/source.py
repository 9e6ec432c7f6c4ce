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
    """Source of a scene.

    Attributes:
        name: Name in messages.
        text: Text of the file, verbatim; empty for a scene made in Python.
        path: Path of the file.
        overrides: Overrides by dotted key, as given by the user.
        preset: Name of the active preset; empty for none.
        preset_values: Values of the active preset, by dotted key.
        is_recorded: True for a scene from a recording; no user chose its folder, so its Python files must not run.
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
        """Values that replace values of the file, by dotted key: first values of the preset, then overrides."""
        first = {key: value for key, value in self.preset_values.items() if key not in self.overrides}
        return first | dict(self.overrides)

    @property
    def folder(self) -> Path | None:
        """Folder to which relative paths in the scene refer; None for the current folder."""
        return self.path.parent if self.path is not None else None

    @property
    def is_trusted(self) -> bool:
        """True if all files that the scene names may be used: the scene is Python code, or the user allows them."""
        return self.path is None or self.path.suffix == ".py" or environment.is_granted()

    def is_of_user(self, text: str) -> bool:
        """True if this text is, or is part of a list or table in, the value of an override."""
        return text in texts_in(self.overrides)

    def holds(self, text: str) -> bool:
        """True if a path, with links resolved, is in the folder of the scene's file, or if an override gives it.

        Raises:
            InputError: If the path does not exist.
        """
        if self.folder is None or self.is_of_user(text):
            return True
        place = resolved("path", to_path("path", text, folder=self.folder))
        return place.is_relative_to(resolved("path", self.folder))


def texts_in(value: Any) -> Iterator[str]:
    """List all strings in a value, at every depth."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping | list | tuple):
        for each in value.values() if isinstance(value, Mapping) else value:
            yield from texts_in(each)
