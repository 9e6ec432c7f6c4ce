"""Output and exit codes of commands: verbosity, notes, results, faults, and interruption by Ctrl-C."""

from __future__ import annotations

import signal
import sys
import threading
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspfx.log import DEBUG, INFO
from graspfx.log import NAME as LOGGER
from graspfx.recording.files import PART, is_part, part_of

if TYPE_CHECKING:
    from graspfx.recording.record import Recording
    from graspfx.scene.model import Scene

SUCCESS, REFUSED, WRONG, FAULTS, INTERRUPTED = 0, 1, 2, 3, 130
CODES = f"""exit codes:
  {SUCCESS}    done
  {REFUSED}    `check --strict`: not stable; `tune`: no feasible gains; `replay`: different bits; `doctor`: not all ok
  {WRONG}    an error, described on standard error: invalid arguments or scene, an existing file, a full disk
  {FAULTS}    the run has a fault, such as a lost device or the end of the servo process; all forces are then zero
  {INTERRUPTED}  interrupted by Ctrl-C; the recording contains the rows up to then"""

_quiet: ContextVar[bool] = ContextVar("quiet", default=False)
_json: ContextVar[bool] = ContextVar("json", default=False)


def add_loudness(parser: ArgumentParser) -> None:
    """Add the options -v and -q."""
    group = parser.add_mutually_exclusive_group()
    meaning = "log the engine, compiled or cached programs, and files to standard error; -vv logs details"
    group.add_argument("-v", "--verbose", action="count", default=0, help=meaning)
    meaning = "print errors and requested answers only: no notes, warnings, file names or summary of a run"
    group.add_argument("-q", "--quiet", action="store_true", help=meaning)


def is_quiet() -> bool:
    """Return whether the option -q was given to the running command."""
    return _quiet.get()


def is_json() -> bool:
    """Return whether the option --json was given to the running command."""
    return _json.get()


@contextmanager
def loudness(options: Namespace) -> Iterator[None]:
    """Apply the options -v, -q and --json within a block."""
    quiet = _quiet.set(bool(getattr(options, "quiet", False)))
    json = _json.set(bool(getattr(options, "json", False)))
    try:
        with _listening(int(getattr(options, "verbose", 0))):
            yield
    finally:
        _quiet.reset(quiet)
        _json.reset(json)


@contextmanager
def _listening(verbose: int) -> Iterator[None]:
    if not verbose:
        yield
        return
    import logging

    logger = logging.getLogger(LOGGER)
    handler, level = logging.StreamHandler(sys.stderr), logger.level
    handler.setFormatter(logging.Formatter("%(message)s" if verbose == 1 else "%(relativeCreated)6d ms  %(message)s"))
    logger.addHandler(handler)
    logger.setLevel(INFO if verbose == 1 else DEBUG)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)


@contextmanager
def interruptible() -> Iterator[Callable[[], bool]]:
    """Yield a function that returns whether Ctrl-C was pressed. A second Ctrl-C ends the process.

    Ctrl-C does not raise KeyboardInterrupt within the block, because the callback of a library could suppress it.
    """

    def ask(number: int, frame: object) -> None:
        signals.append(number)
        signal.signal(number, signal.SIG_DFL)

    signals: list[int] = []
    before = signal.getsignal(signal.SIGINT)
    ours = before is signal.default_int_handler and threading.current_thread() is threading.main_thread()
    if not ours:  # the signal is ignored, as in the background, or has another handler
        yield lambda: False
        return
    signal.signal(signal.SIGINT, ask)
    try:
        yield lambda: bool(signals)
    finally:
        signal.signal(signal.SIGINT, before)


def doubts(scene: Scene) -> list[str]:
    """Return warnings about likely mistakes in a scene."""
    from graspfx.assembly.resolve import resolve
    from graspfx.certificate import notes

    return notes.doubts(resolve(scene))


def note(notes: Iterable[str]) -> None:
    for each in () if is_quiet() else notes:
        print(f"note: {each}", file=sys.stderr)


def warn_of_hardware() -> None:
    """Print a warning that hardware is about to exert forces."""
    print("HARDWARE IS GOING TO BE ARMED: fingers feel forces from now on", flush=True)


def say_faults(recording: Recording) -> int:
    """Print the faults of a run, and return the exit code of a command that made the run."""
    for fault in recording.faults:
        print(fault, file=sys.stderr)
    return FAULTS if recording.faults else SUCCESS


def tell(text: str) -> None:
    """Print a line and flush standard output."""
    print(text, flush=True)


def print_result(result: Any, lines: Iterable[str] | None = None) -> None:
    """Print lines or, if None, those of the result's method `lines`; with --json, print the data of `to_dict`."""
    if is_json():
        print_json(result.to_dict())
    else:
        print(*(result.lines() if lines is None else lines), sep="\n", flush=True)


def print_json(value: object) -> None:
    import json

    print(json.dumps(value, indent=2, allow_nan=False))


def say_source(request: Path, file: Path, recording: Recording) -> None:
    """Print a note if the file that was read is a part file, or if a part file of a later run exists."""
    if is_part(file):
        instead = "" if request == file else f"; {file.name.removesuffix(PART)} does not exist yet"
        note([f"read {recording.end:g} s from {file}; the run has not finished or was killed{instead}"])
    elif part_of(file).is_file():
        note([f"read {file}; {part_of(file).name} beside it is from a later run that has not finished or was killed"])
