"""graspfx check: print a scene's faults, its stability and the limits of its gains; with -v also the plan."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING

from graspfx.commands.arguments import add_operators, add_options, add_scene, add_style, load_scene, picture_name
from graspfx.commands.destination import add_destination, drawing, name_files, require_room
from graspfx.commands.output import REFUSED, SUCCESS, is_quiet, print_json, print_result
from graspfx.errors import InputError
from graspfx.progress import waiting

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

EXAMPLE = """  graspfx check paper-spring --set coupling.external.stiffness=60
  graspfx check paper-waving --operators 'finger.*.hand.stiffness=50:1000' --out out/hands"""


def add_arguments(parser: ArgumentParser) -> None:
    add_scene(parser)
    add_options(
        parser,
        ("--brief", "print the result in one line, after warnings about units"),
        ("--tick", "print the steps of a tick, file and line of each kernel, and the reason for each skipped step"),
        ("--json", "print the report as JSON only"),
        ("--strict", "exit with 1 unless the scene is stable"),
    )
    add_operators(parser)
    add_options(
        parser,
        ("--samples N", "number of random operators (default: 200)", int),
        ("--seed N", "seed of the random operators (default: 0)", int, 0),
    )
    add_destination(
        parser, "DIR", "folder of operators.png and gains.png, drawn with --operators (default: write nothing)"
    )
    add_style(parser)


def execute(options: Namespace) -> int:
    if options.operators is not None:
        return _operators(options)
    if options.out is not None or options.samples is not None:
        name = "--out" if options.out is not None else "--samples"
        raise InputError(name, options.out or options.samples, f"{name} together with --operators")
    with waiting(f"reading {options.scene}"):
        from graspfx.certificate.report import report

        scene = load_scene(options)
    if options.tick:
        lines = _tick(scene)
        if options.json:
            print_json({"tick": lines})
        else:
            print(*lines, sep="\n")
        return SUCCESS
    with waiting(f"finding the limits of {options.scene}"):
        answer = report(scene)
    print_result(answer, answer.head() if options.brief else answer.lines(plan=bool(options.verbose)))
    if not (options.json or options.brief or options.verbose or is_quiet()):
        runs = sum(row.runs for row in answer.plan)
        print(f"a tick runs {runs} steps and skips {len(answer.plan) - runs}: -v lists them, with the reasons")
    return SUCCESS if answer.ok or not options.strict else REFUSED


def _operators(options: Namespace) -> int:
    """Certify the scene for a set of operators, and draw the figures if --out is given; return the exit code."""
    from graspfx.certificate.certify_operators import SAMPLES, certify_operators
    from graspfx.show.certificate_figures import gains_sheet, operators_sheet
    from graspfx.show.style import save

    files = (
        [] if options.out is None else [options.out / picture_name(name, options) for name in ("operators", "gains")]
    )
    require_room(options, files)
    scene = load_scene(options)
    ranges = [text for text in options.operators if text]
    samples = SAMPLES if options.samples is None else options.samples
    answer = certify_operators(scene, ranges or None, samples=samples, seed=options.seed)
    print_result(answer, [answer.sentence] if options.brief else None)
    for file, sheet in zip(files, (operators_sheet, gains_sheet), strict=False):
        with drawing(file) as place:
            save(sheet(answer, options.width), place, options.format or "")
    name_files(files)
    return SUCCESS if answer.stable or not options.strict else REFUSED


def _tick(scene: Scene) -> list[str]:
    """List the steps that a tick of the scene runs, and the steps that it skips."""
    from graspfx.assembly.build import build
    from graspfx.loop.tick_listing import listing

    with build(scene, engine="interpreted") as servo:
        return listing(servo)
