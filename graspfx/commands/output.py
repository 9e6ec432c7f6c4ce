"""Messages of commands, places for their pictures, and their exit codes."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspfx.commands.loudness import is_quiet
from graspfx.errors import RecordingError
from graspfx.progress import waiting
from graspfx.recording.files import PART, is_part, part_of, placing

if TYPE_CHECKING:
    from graspfx.recording.record import Recording
    from graspfx.scene.model import Scene

SUCCESS, REFUSED, WRONG, FAULTS, INTERRUPTED = 0, 1, 2, 3, 130
CODES = f"""exit codes:
  {SUCCESS}    done
  {REFUSED}    `check --strict` of a scene that is not stable; a `replay` with other bits; `doctor` with remedies
  {WRONG}    an error, said on standard error: bad arguments or scene, a file in the way, a disk that is full
  {FAULTS}    the run has faults, as of a device that broke off: from there on every force is zero
  {INTERRUPTED}  interrupted by Ctrl-C; a run's rows so far are in its recording"""


def doubts(scene: Scene) -> list[str]:
    """List warnings about likely mistakes in a scene."""
    from graspfx.assembly.resolve import resolve
    from graspfx.certificate import notes

    return notes.doubts(resolve(scene))


def note(notes: Iterable[str]) -> None:
    for each in () if is_quiet() else notes:
        print(f"note: {each}", file=sys.stderr)


def warn_of_hardware() -> None:
    """Say that hardware is about to exert forces, before it does: whoever has a finger in it is to know."""
    print("HARDWARE IS GOING TO BE ARMED: its fingers feel forces from now on", flush=True)


def say_faults(recording: Recording) -> int:
    """Print a run's faults; return the exit code that goes with them."""
    for fault in recording.faults:
        print(fault, file=sys.stderr)
    return FAULTS if recording.faults else SUCCESS


def name_files(paths: Sequence[Path]) -> None:
    for path in () if is_quiet() else paths:
        print(f"wrote {path}")


def print_json(value: object) -> None:
    import json

    print(json.dumps(value, indent=2, allow_nan=False))


def draw(recordings: Sequence[Recording], picture: Path, otherwise: str = "", **options: Any) -> None:
    """Draw recordings as `graspfx.show.plot.figure` does with these options."""
    require_place(picture)
    with waiting(f"drawing {picture.name}"), placing(picture, otherwise) as file:
        from graspfx.show.plot import figure

        figure(recordings, file, **options)


def say_source(request: Path, file: Path, recording: Recording) -> None:
    """Note which file was read where that is not what was asked for, or not all there is."""
    if is_part(file):
        seconds = recording.end
        note([f"{file} is read, of a run that goes on or was killed: {seconds:g} s of it" + _instead_of(request, file)])
    elif part_of(file).is_file():
        note([f"{file} is read; {part_of(file).name} beside it is of a later run, which goes on or was killed"])


def _instead_of(request: Path, file: Path) -> str:
    return "" if request == file else f"; {file.name.removesuffix(PART)} is not there yet"


def require_place(picture: Path) -> None:
    """Refuse a folder where the picture goes, before the run."""
    if picture.is_dir():
        raise RecordingError(f"{picture}: is a folder, where the picture is to go; choose another --out")
