"""graspfx check: whether a scene is stable, how far its gains can go, its faults; with -v what each sample will do."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING

from graspfx.commands.arguments import add_operators, add_scene, add_style, picture_name
from graspfx.commands.destination import add_destination, require_room
from graspfx.commands.loudness import is_quiet
from graspfx.commands.output import REFUSED, SUCCESS, name_files, print_json, require_place
from graspfx.errors import InputError
from graspfx.progress import waiting

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

EXAMPLE = """  graspfx check paper-spring --set coupling.external.stiffness=60
  graspfx check paper-waving --operators 'finger.*.hand.stiffness=50:1000' --out out/hands"""


def add_arguments(parser: ArgumentParser) -> None:
    add_scene(parser)
    parser.add_argument(
        "--brief", action="store_true", help="print the verdict alone, one line, below doubts about units"
    )
    parser.add_argument(
        "--tick",
        action="store_true",
        help="print what a tick runs, with the source of each kernel, what it skips, and why",
    )
    parser.add_argument("--json", action="store_true", help="print the report as JSON, and nothing else")
    parser.add_argument(
        "--strict", action="store_true", help="end with 1 unless the verdict is that the scene is stable"
    )
    add_operators(parser)
    parser.add_argument("--samples", metavar="N", type=int, help="operators that are drawn at random (200)")
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="of the random operators (0)")
    add_destination(
        parser, "DIR", "folder of operators.png and gains.png, drawn with --operators; nothing is written if not given"
    )
    add_style(parser)


def execute(options: Namespace) -> int:
    if options.operators is not None:
        return _operators(options)
    if options.out is not None or options.samples is not None:
        name = "--out" if options.out is not None else "--samples"
        raise InputError(name, options.out or options.samples, f"{name} with --operators alone")
    with waiting(f"reading {options.scene}"):
        from graspfx.assembly.scene_cache import SceneMemory
        from graspfx.certificate.report import report
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
        print(*(answer.head() if options.brief else answer.lines(plan=bool(options.verbose))), sep="\n")
        if not (options.brief or options.verbose or is_quiet()):
            runs = sum(row.runs for row in answer.plan)
            print(f"a tick runs {runs} steps and skips {len(answer.plan) - runs}: -v lists them, with the reasons")
    return SUCCESS if answer.ok or not options.strict else REFUSED


def _operators(options: Namespace) -> int:
    """Certify over a set of operators, and draw it where a folder is named."""
    from graspfx.certificate.certify_operators import SAMPLES, certify_operators
    from graspfx.recording.files import make_folder, placing
    from graspfx.scene.load import load
    from graspfx.show.certificate_figures import gains_sheet, operators_sheet
    from graspfx.show.style import save

    files = (
        [] if options.out is None else [options.out / picture_name(name, options) for name in ("operators", "gains")]
    )
    for file in files:
        require_place(file)
    require_room(options, files)
    with waiting(f"reading {options.scene}"):
        scene = load(options.scene, dict(options.overrides), preset=options.preset)
    ranges = [text for text in options.operators if text]
    samples = SAMPLES if options.samples is None else options.samples
    answer = certify_operators(scene, ranges or None, samples=samples, seed=options.seed)
    if options.json:
        print_json(answer.to_dict())
    else:
        print(*([answer.sentence] if options.brief else answer.lines()), sep="\n")
    if files:
        make_folder(options.out)
        for file, draw in zip(files, (operators_sheet, gains_sheet), strict=True):
            with placing(file) as place:
                save(draw(answer, options.width), place, options.format or "")
        if not options.json:
            name_files(files)
    return SUCCESS if answer.stable or not options.strict else REFUSED


def _tick(scene: Scene) -> list[str]:
    """List what ticks of the scene run, and what they skip."""
    from graspfx.assembly.build import build
    from graspfx.loop.tick_listing import listing

    with build(scene, engine="interpreted") as servo:
        return listing(servo)
