"""graspfx check: whether a scene is stable, how far its gains can go, its faults, and what each sample will do."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING

from graspfx.commands.arguments import add_scene
from graspfx.commands.output import REFUSED, SUCCESS, print_json
from graspfx.progress import waiting

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

EXAMPLE = """  graspfx check paper-spring --set coupling.external.stiffness=60"""


def add_arguments(parser: ArgumentParser) -> None:
    add_scene(parser)
    parser.add_argument("--brief", action="store_true", help="print the verdict alone, one line")
    parser.add_argument(
        "--tick", action="store_true", help="print the program of one tick, with names, and the source of each part"
    )
    parser.add_argument("--json", action="store_true", help="print the report as JSON, and nothing else")
    parser.add_argument(
        "--strict", action="store_true", help="end with 1 unless the verdict is that the scene is stable"
    )


def execute(options: Namespace) -> int:
    with waiting(f"reading {options.scene}"):
        from graspfx.build.scene_memory import SceneMemory
        from graspfx.certificate.verdict import report
        from graspfx.scene.load import load
        from graspfx.scene.table_memory import remembering

        with remembering(SceneMemory()):
            scene = load(options.scene, dict(options.overrides), preset=options.preset)
    if options.tick:
        lines = _tick(scene)
        if options.json:
            print_json({"tick": lines})
        else:
            print(*lines, sep="\n")
        return SUCCESS
    with waiting(f"finding the limits of {options.scene}"):
        answer = report(scene)
    if options.json:
        print_json(answer.to_dict())
    else:
        print(*([answer.verdict] if options.brief else answer.lines()), sep="\n")
    return SUCCESS if answer.ok or not options.strict else REFUSED


def _tick(scene: Scene) -> list[str]:
    """List the program that a run of the scene would run, line by line."""
    from graspfx.build.build import build
    from graspfx.loop.tick.tick_listing import listing

    with build(scene, hardware=False) as servo:
        return listing(servo.parts)
