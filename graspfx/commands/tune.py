"""graspfx tune: maximise gains of a scene under constraints, such as stability margins, for a set of operators."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from time import perf_counter

from graspfx.commands.arguments import add_operators, add_options, add_scene, load_scene
from graspfx.commands.destination import add_destination, name_files, require_room
from graspfx.commands.output import REFUSED, SUCCESS, print_result
from graspfx.recording.files import make_folder, placing

EXAMPLE = """  graspfx tune paper-waving --maximise internal.stiffness --subject-to "margin >= 1.3, grip >= 1.2"
  graspfx tune mug --over internal.stiffness=100:3000 --operators 'hand.*.arm.stiffness=50:1000'"""
FILE = "tuned.toml"


def add_arguments(parser: ArgumentParser) -> None:
    add_scene(parser)
    add_options(
        parser,
        (
            "--maximise FORMULA",
            "formula of measures and keys to maximise, such as external.stiffness + internal.stiffness "
            "(default: internal.stiffness)",
            str,
            "internal.stiffness",
        ),
    )
    parser.add_argument(
        "--subject-to", metavar="COMPARISONS", action="append", default=[],
        help="constraints, separated by commas, such as 'margin >= 1.3, grip >= 1.2' (default: margin >= 1.5)",
    )  # fmt: skip
    parser.add_argument(
        "--over", metavar="KEY=FROM:TO", action="append", default=[],
        help="key to vary, with its range; may be repeated (default: the gains in the formula)",
    )  # fmt: skip
    add_operators(parser, "own: only the scene's operator")
    add_options(parser, ("--seed N", "seed of the operators that verify the result (default: 0)", int, 0))
    add_destination(parser, "DIR", f"folder of {FILE}, a preset with the tuned values (default: write nothing)")
    add_options(parser, ("--json", "print the result as JSON only"))


def execute(options: Namespace) -> int:
    from graspfx.tuning.tune_scene import USUAL, tune

    file = None if options.out is None else options.out / FILE
    if file is not None:
        require_room(options, [file])
    scene = load_scene(options)
    ranges = [text for text in options.operators or [] if text]
    began = perf_counter()
    answer = tune(
        scene, options.maximise, options.subject_to or USUAL, over=options.over or None,
        operators="own" if ranges == ["own"] else ranges or None, seed=options.seed,
    )  # fmt: skip
    print_result(answer, [*answer.lines(), f"  {perf_counter() - began:.2g} s"])
    if file is not None and answer.feasible:
        make_folder(file.parent)
        with placing(file) as place:
            place.write_text(answer.toml, encoding="utf-8")
        name_files([file])
    return SUCCESS if answer.feasible else REFUSED
