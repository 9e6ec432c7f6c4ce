"""What commands say, where their pictures may go, and the codes with which they end."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from graspfx.errors import RecordingError

if TYPE_CHECKING:
    from graspfx.loop.record import Recording
    from graspfx.scene.model import Scene

DONE, WRONG, FAULTS, INTERRUPTED = 0, 2, 3, 130


def doubts(scene: Scene) -> list[str]:
    """What is no fault of a scene and yet may not be meant."""
    from graspfx.scene import doubts as notes

    return notes.doubts(scene)


def note(notes: Iterable[str]) -> None:
    for each in notes:
        print(f"note: {each}", file=sys.stderr)


def say_faults(recording: Recording) -> int:
    """Prints a run's faults; the code that goes with them."""
    for fault in recording.faults:
        print(fault, file=sys.stderr)
    return FAULTS if recording.faults else DONE


def name_files(paths: Sequence[Path]) -> None:
    for path in paths:
        print(f"wrote {path}")


def print_json(value: object) -> None:
    import json

    print(json.dumps(value, indent=2, allow_nan=False))


def draw(recordings: Sequence[Recording], picture: Path, otherwise: str = "") -> None:
    from graspfx.show.plot import figure

    require_place(picture)
    with placing(picture, otherwise):
        figure(recordings, picture)


@contextmanager
def placing(picture: Path, otherwise: str = "") -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise RecordingError(f"{picture}: cannot be written; {error.strerror}{otherwise}") from error


def require_place(picture: Path) -> None:
    """No folder may stand where the picture goes: to be known before the run."""
    if picture.is_dir():
        raise RecordingError(f"{picture}: is a folder, where the picture is to go; choose another --out")
