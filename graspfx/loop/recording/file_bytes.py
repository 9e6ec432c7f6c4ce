"""Recordings between processes: as the bytes of their files, with the checks that these have."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

from graspfx.loop.recording.places import NAME

T = TypeVar("T")


def to_bytes(save: Callable[[Path], object]) -> bytes:
    """Give the bytes of the file that `save` writes."""
    with TemporaryDirectory(prefix="graspfx-") as folder:
        place = Path(folder) / NAME
        save(place)
        return place.read_bytes()


def from_bytes(kind: Callable[..., T], content: bytes, start: int = 0) -> T:
    """Make a recording in memory of the bytes of a file; `start` is the number of its first row in a whole run.

    Raises:
        RecordingError: the bytes were changed since they were written.
    """
    from graspfx.loop.recording.file import read

    with TemporaryDirectory(prefix="graspfx-") as folder:
        place = Path(folder) / NAME
        place.write_bytes(content)
        rows, layout, header, outcome = read(place)
        return kind(rows.read(0, len(rows), slice(0, layout.width)), layout, header, outcome, start=start)
