"""graspfx stability: print the stability limits of the gains, or plot them as functions of one or two keys."""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from graspfx.commands.arguments import add_options, add_scene, add_style, load_scene, picture_name
from graspfx.commands.destination import add_destination, destination, drawing, name_files, require_room
from graspfx.commands.output import SUCCESS, print_json, print_result
from graspfx.errors import GraspFXError, UnknownNameError
from graspfx.progress import waiting

if TYPE_CHECKING:
    from graspfx.certificate.limit_sweep import Sweep
    from graspfx.scene.model import Scene


PLOTS = ("bode", "nyquist", "z-width")
EXAMPLE = """  graspfx stability paper-spring --sweep coupling.internal.stiffness=20:200:10"""


def add_arguments(parser: ArgumentParser) -> None:
    add_scene(parser)
    parser.add_argument(
        "--sweep",
        metavar="KEY=FROM:TO:COUNT",
        action="append",
        default=[],
        help="range of a key over which limits are plotted; with a second range, the plot is a map",
    )
    parser.add_argument(
        "--plot",
        metavar="NAME",
        type=diagram,
        choices=PLOTS,
        action="append",
        nargs="?",
        const="",
        default=[],
        help="diagram to draw: bode, nyquist or z-width; may be repeated",
    )
    add_destination(
        parser, "DIR", "folder of the figures; --sweep writes stability.png (default: out/SCENE, out/SCENE-2, ...)"
    )
    add_style(parser)
    add_options(parser, ("--json", "print the limits as JSON only"))


def diagram(text: str) -> str:
    """Check and return an argument that is the name of a diagram.

    Raises:
        UnknownNameError: If no diagram has that name.
        ArgumentTypeError: If the name is missing.
    """
    if not text:
        raise ArgumentTypeError(f"expected a diagram: {', '.join(PLOTS[:-1])} or {PLOTS[-1]}")
    if text not in PLOTS:
        raise UnknownNameError("diagram", text, PLOTS)
    return text


def execute(options: Namespace) -> int:
    from graspfx.certificate.limit_sweep import Sweep, limits_of_scene

    sweeps = [Sweep.read(text) for text in options.sweep]
    scene = load_scene(options)
    scene.require_reach()
    if options.plot:
        with destination(options, Path(options.scene).stem) as folder:
            _draw_loops(folder, scene, options)
    if not sweeps:
        if options.json:
            print_json(limits_of_scene(scene).to_dict())
        else:
            _print_certificate(scene)
        return SUCCESS
    with destination(options, Path(options.scene).stem) as folder:
        return _draw_into(folder, scene, sweeps, options)


def _print_certificate(scene: Scene) -> None:
    """Print the certificates of a scene, or the reason why they cannot be computed."""
    from graspfx.certificate.certificate import lines
    from graspfx.certificate.certify import certificates

    try:
        with waiting(f"finding the limits of {scene.source.name}"):
            certificates_ = certificates(scene)
    except GraspFXError as error:
        print(f"stability is not judged: {' '.join(str(error).split())}")
        return
    for certificate in certificates_:
        print(*lines(certificate), sep="\n")


def _draw_loops(folder: Path, scene: Scene, options: Namespace) -> None:
    """Draw the diagrams of --plot for the scene's loop in equilibrium.

    The Z-width is computed for the device of the first finger.
    """
    from graspfx.analysis.passivity.walls import z_width
    from graspfx.analysis.stability.loci import loci
    from graspfx.show import certificate_figures
    from graspfx.show.style import plain

    pictures = {name: folder / picture_name(name, options) for name in dict.fromkeys(options.plot)}
    require_room(options, [*pictures.values()])
    linear = scene.linearise()
    response = loci(linear) if {"bode", "nyquist"} & pictures.keys() else None
    for name, picture in pictures.items():
        if response is not None and name != "z-width":
            draw = certificate_figures.bode if name == "bode" else certificate_figures.nyquist
            sheet = draw(response, options.width, plain(scene.title))
        else:
            mass, damping, delay = float(linear.mass[0]), float(linear.friction[0]), int(linear.delay[0])
            latency = float(linear.latency[0])
            region = z_width(damping, linear.period, mass=mass, delay=delay, latency=latency)
            sheet = certificate_figures.z_width(region, options.width, plain(scene.title))
        with drawing(picture) as file:
            sheet.save(file, options.format)
    name_files(pictures.values())


def _draw_into(folder: Path, scene: Scene, sweeps: list[Sweep], options: Namespace) -> int:
    from graspfx.certificate.limit_sweep import swept_limits
    from graspfx.show.certificate_figures import limits_sheet
    from graspfx.show.style import save

    picture = folder / picture_name("stability", options)
    require_room(options, [picture])
    with waiting(f"finding the limits of {options.scene}"):
        limits = swept_limits(scene, sweeps)
    with drawing(picture) as file:
        save(limits_sheet(limits, scene.title, width=options.width), file)
    print_result(limits)
    name_files([picture])
    return SUCCESS
