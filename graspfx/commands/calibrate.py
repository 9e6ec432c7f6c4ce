"""graspfx calibrate: measure the hardware of a scene, and write what its devices' tables take over."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path

from graspfx.commands.arguments import add_scene
from graspfx.commands.output import SUCCESS, name_files
from graspfx.errors import InputError
from graspfx.progress import waiting

EXAMPLE = """  graspfx calibrate my-rig.toml --out my-rig-measures.toml"""


def add_arguments(parser: ArgumentParser) -> None:
    add_scene(parser)
    parser.add_argument("--out", metavar="FILE", type=Path, help="where the measures are written (SCENE-measures.toml)")
    parser.add_argument("--pulses", metavar="N", type=int, default=200, help="pulses of each device (200)")
    parser.add_argument(
        "--share", metavar="SHARE", type=float, default=0.02, help="of the largest force that devices are pushed with"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace a file that is there")
    people = "ask nobody: the devices are let go of, and neither axes nor zero are checked"
    parser.add_argument("--yes", action="store_true", help=people)


def execute(options: Namespace) -> int:
    from graspfx.assembly.calibration.device_calibration import calibrate, require_hardware
    from graspfx.assembly.resolve import resolve
    from graspfx.scene.load import load

    file = options.out or Path(f"{Path(options.scene).stem}-measures.toml")
    if file.exists() and not options.overwrite:
        raise InputError("out", str(file), "a file that is not there yet", "take another name, or --overwrite")
    with waiting(f"reading {options.scene}"):
        scene = load(options.scene, dict(options.overrides), preset=options.preset)
    require_hardware(resolve(scene))
    if not options.yes:
        if not sys.stdin.isatty():
            raise InputError("yes", False, "--yes where nobody sits at the terminal", "or start it in one")
        input("The devices will move by themselves by a few millimetres: clear their way, then press Enter. ")
    result = calibrate(
        scene, pulses=options.pulses, share=options.share, prompt=None if options.yes else _prompt
    )  # fmt: skip
    print(*result.lines(), sep="\n")
    file.write_text(result.toml(), encoding="utf-8")
    name_files([file])
    return SUCCESS


def _prompt(text: str) -> None:
    print(text, flush=True)
