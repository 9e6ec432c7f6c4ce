"""graspfx calibrate: measure the hardware of a scene, and write settings for the device tables of the scene."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path

from graspfx.commands.arguments import add_options, add_scene, load_scene
from graspfx.commands.destination import name_files
from graspfx.commands.output import SUCCESS, tell
from graspfx.errors import InputError

EXAMPLE = """  graspfx calibrate my-rig.toml --out my-rig-measures.toml"""


def add_arguments(parser: ArgumentParser) -> None:
    add_scene(parser)
    add_options(
        parser,
        ("--out FILE", "output file (default: SCENE-measures.toml)", Path),
        ("--pulses N", "pulses for each device (default: 200)", int, 200),
        ("--share SHARE", "pulse force as a share of the device's largest force (default: 0.02)", float, 0.02),
        ("--overwrite", "replace an existing file"),
        ("--yes", "run without prompts; nobody may hold the devices, and axes and zero are not checked"),
    )


def execute(options: Namespace) -> int:
    from graspfx.assembly.device_calibration import calibrate, require_hardware
    from graspfx.assembly.resolve import resolve

    file = options.out or Path(f"{Path(options.scene).stem}-measures.toml")
    if file.exists() and not options.overwrite:
        raise InputError("--out", str(file), "a new file", "choose another name, or add --overwrite")
    scene = load_scene(options)
    require_hardware(resolve(scene))
    if not options.yes:
        if not sys.stdin.isatty():
            raise InputError("--yes", False, "True without a terminal", "add --yes, or start the command in a terminal")
        input("The devices will move by themselves, a few millimetres. Clear the space around them, then press Enter. ")
    result = calibrate(scene, pulses=options.pulses, share=options.share, prompt=None if options.yes else tell)
    print(*result.lines(), sep="\n")
    file.write_text(result.toml(), encoding="utf-8")
    name_files([file])
    return SUCCESS
