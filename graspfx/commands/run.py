"""graspfx run: simulate a scene, record it and print a summary."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from graspfx import log
from graspfx.commands.arguments import add_options, add_scene, add_style, load_scene, picture_name
from graspfx.commands.destination import add_destination, destination, draw, name_files, require_room, require_room_of
from graspfx.commands.output import INTERRUPTED, doubts, interruptible, is_quiet, note, print_json, say_faults
from graspfx.loop.realtime.process import NAMES as SIGNALS
from graspfx.progress import waiting
from graspfx.recording.files import NAME

if TYPE_CHECKING:
    from graspfx.scene.model import Scene
    from graspfx.scene.tables.reading import Readable


PICTURE = "figure"
EXAMPLE = """  graspfx run paper-waving --set coupling.internal.stiffness=50 --out out/stiff"""


def add_arguments(parser: ArgumentParser) -> None:
    add_scene(parser)
    add_options(
        parser,
        ("--duration S", "simulated time [s] (default: the scene's)", float),
        ("--real-time", "run in real time, as scenes with hardware require"),
    )
    add_destination(parser, "DIR", "folder of recording.h5 and figure.png (default: out/SCENE, out/SCENE-2, ...)")
    add_options(parser, ("--no-figure", "draw no figure"))
    add_style(parser)
    add_options(parser, ("--json", "print the summary as JSON only"))


def execute(options: Namespace) -> int:
    from graspfx.assembly.scene_cache import cached, place

    if options.out is not None:  # before anything is loaded
        if not options.no_figure:
            require_room(options, [options.out / picture_name(PICTURE, options)])
        require_room_of(options, options.out / NAME)
    where = place(options.scene, dict(options.overrides), options.preset)
    entry = cached(where) if where is not None else None
    scene, notes = entry or _checked(options)
    note(notes)
    with destination(options, Path(options.scene).stem, latest=True) as folder:
        code, complete = _run_into(folder, scene, options)
    if complete and where is not None and entry is None:
        from graspfx.assembly.scene_cache import keep

        keep(where, scene, notes)
    return code


def _run_into(folder: Path, scene: Scene, options: Namespace) -> tuple[int, bool]:
    """Run a scene, and write the recording and the figure to a folder.

    Returns:
        Exit code, and whether the run is complete.
    """
    from graspfx.assembly.run_scene import run
    from graspfx.show.summary_table import print_summary, remarks

    if log.is_heard():
        _log_plan(scene)
    with interruptible() as stop:
        recording = run(
            scene, duration=options.duration, out=folder, overwrite=options.overwrite, stop=stop,
            real_time=options.real_time,
        )  # fmt: skip
    if not recording.outcome.complete:
        simulated, duration = recording.end, options.duration or scene.duration
        is_asked_for = recording.outcome.cause in ("", *SIGNALS)
        how = "interrupted" if is_asked_for else "ended"
        print(f"{how} after {simulated:g} of {duration:g} s; the recording is {folder / NAME}", file=sys.stderr)
        return INTERRUPTED if is_asked_for else say_faults(recording) or INTERRUPTED, False
    file = folder / NAME
    if options.json:
        print_json(recording.summary())
    elif not is_quiet():
        print_summary([recording])
        name_files([file])
    note(remarks(recording))
    if recording.outcome.engine == "interpreted" and find_spec("llvmlite") is None and scene.engine == "auto":
        note(
            ["ticks are interpreted, with equal results: the package 'llvmlite' is not installed; pip install llvmlite"]
        )
    code = say_faults(recording)
    if options.no_figure:
        return code, True
    if find_spec("matplotlib") is None:
        note(["no figure: the package 'matplotlib' is not installed; pip install matplotlib, or add --no-figure"])
    else:  # last, because loading matplotlib takes longer than most runs
        sys.stdout.flush()
        picture = folder / picture_name(PICTURE, options)
        draw([recording], picture, f"; the recording is in {file}", width=options.width)
        name_files([picture])
    return code, True


def _log_plan(scene: Readable) -> None:
    from graspfx.certificate.plan import plan
    from graspfx.certificate.report import whole_scene

    for row in plan(whole_scene(scene)):
        if not row.runs:
            log.info("skipped: %s: %s", row.step, row.why)


def _checked(options: Namespace) -> tuple[Scene, list[str]]:
    """Load the scene of the command, and return it together with warnings about likely mistakes."""
    with waiting(f"checking {options.scene}"):
        scene = load_scene(options)
        return scene, doubts(scene)
