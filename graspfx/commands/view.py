"""graspfx view: a running scene in the browser, to be looked at and steered; or a recording."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from graspfx.commands.arguments import add_overrides
from graspfx.commands.destination import OUT
from graspfx.commands.interrupt import interruptible
from graspfx.commands.output import SUCCESS, WRONG, doubts, note, warn_of_hardware
from graspfx.commands.recording_page import add_html, is_recording, show_recording, write_run
from graspfx.errors import InputError
from graspfx.progress import waiting
from graspfx.recording.files import new_folder

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

Guide = Literal["hands", "fingers"] | None
EXAMPLE = """  graspfx view paper-waving
  graspfx view sphere-three-fingers --set coupling.internal.stiffness=300 --port 9000
  graspfx view out/latest --html waving.html"""


def add_arguments(parser: ArgumentParser) -> None:
    text = "a scene's name, the path of a .toml or .py file, or a recording"
    parser.add_argument("scene", metavar="SCENE_OR_RECORDING", help=text)
    add_overrides(parser)
    add_page(parser)
    parser.add_argument("--out", metavar="DIR", type=Path, help="folder of recordings (out/SCENE, out/SCENE-2, ...)")
    add_html(parser)


def add_page(parser: ArgumentParser) -> None:
    """Add --port and --seconds."""
    parser.add_argument("--port", metavar="N", type=int, help="on 127.0.0.1 (the first that is free from 8080 on)")
    parser.add_argument("--seconds", metavar="S", type=float, help="after which it ends by itself")


def execute(options: Namespace) -> int:
    from graspfx.live.view.page_server import require_viser

    if options.seconds is not None and not options.seconds > 0.0:
        raise InputError("--seconds", options.seconds, "a time above zero")
    if options.html is None:
        require_viser()
    if is_recording(options.scene):
        with interruptible() as stop:
            return show_recording(options, stop, _tell)
    if options.html is not None:
        return write_run(options)
    from graspfx.assembly.resolve import resolve
    from graspfx.scene.load import load

    with waiting(f"checking {options.scene}"):
        scene = load(options.scene, dict(options.overrides), preset=options.preset)
        parts = resolve(scene)
        notes = doubts(scene)
    note(notes)
    if parts.hardware:
        warn_of_hardware()
    loose: Guide = "fingers" if not parts.hardware else None  # led by itself only where nobody has it in his hand
    return _serve(scene, "hands" if scene.hand else loose, options)


def _serve(scene: Scene, guide: Guide, options: Namespace) -> int:
    """Run a scene and serve its page, until asked to stop."""
    from graspfx.live.live_run import LiveRun
    from graspfx.live.sliders import sliders
    from graspfx.live.view.live_view import LiveView

    with interruptible() as stop, ExitStack() as stack:
        with waiting(f"starting {options.scene}"):
            numbers = sliders(scene)
            run = stack.enter_context(LiveRun(scene, live=[each.key for each in numbers], guide=guide))
            view = LiveView(run, numbers, lambda: _folder(options, scene), port=options.port, tell=_tell)
            page = stack.enter_context(view)
        if run.has_hardware:
            _tell("HARDWARE IS ARMED: the page's gains stay within the certificate")
        _tell(f"{page.server.url}  (this machine only; Ctrl-C ends it)")
        page.serve(stop, options.seconds)
        return WRONG if run.fault is not None or run.cause else SUCCESS


def _folder(options: Namespace, scene: Scene) -> Path:
    """Make the folder of a further recording."""
    if options.out is None:
        return new_folder(OUT, Path(scene.source.name).stem)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    return new_folder(options.out.parent, options.out.name)


def _tell(text: str) -> None:
    print(text)
    sys.stdout.flush()
