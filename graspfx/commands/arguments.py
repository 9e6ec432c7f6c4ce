"""Arguments that several commands share: scenes with overrides of their values, recordings, and formats of figures."""

from __future__ import annotations

import math
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspfx.commands.output import doubts, note
from graspfx.errors import InputError
from graspfx.progress import waiting

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

SET = "--set"
LISTS = (SET, "--operators", "--over")  # options that take several values
FORMATS = ("png", "svg", "pdf")
WIDTHS = ("screen", "page", "column")


def add_options(parser: ArgumentParser, *rows: tuple[Any, ...]) -> None:
    """Add options to a parser.

    Args:
        parser: Parser of a command.
        rows: One tuple for each option: "--name METAVAR", help text, type (default: text), default value. An option
            whose name has no metavar takes no value.
    """
    for spec, text, *others in rows:
        name, _, metavar = spec.partition(" ")
        if metavar:
            kind, default = [*others, None, None][:2]
            parser.add_argument(name, metavar=metavar, help=text, type=kind, default=default)
        else:
            parser.add_argument(name, action="store_true", help=text)


def add_scene(parser: ArgumentParser) -> None:
    """Add the argument SCENE and the options --preset, --set and --trust."""
    text = "name of a scene, or path of its .toml or .py file"
    parser.add_argument("scene", metavar="SCENE", type=scene, help=text)
    add_overrides(parser)


def add_overrides(parser: ArgumentParser) -> None:
    """Add the options --preset, --set and --trust."""
    text = "preset of the scene, applied before --set; `graspfx list` names the presets"
    parser.add_argument("--preset", metavar="NAME", help=text)
    add_values(parser)


def add_values(parser: ArgumentParser) -> None:
    """Add the options --set and --trust."""
    values = parser.add_argument(SET, metavar="KEY=VALUE", type=override, action="append", default=[])
    values.dest, values.help = "overrides", "new value of a scene key, such as object.mass=0.2; accepts several"
    whole = "allow the scene to use files outside its folder; Python files among them are executed"
    parser.add_argument("--trust", action="store_true", help=whole)


def add_operators(parser: ArgumentParser, more: str = "") -> None:
    """Add the option --operators; the text `more` is appended to the help."""
    text = "range of a key over operators; LAW in KEY=FROM:TO:LAW is log, uniform, normal or lognormal; accepts several"
    usual = "without a range: the scene's table [operators], or the default operators"
    parser.add_argument(
        "--operators",
        metavar="KEY=FROM:TO",
        action="append",
        nargs="?",
        const="",
        help="; ".join(filter(None, [text, usual, more])),
    )


def add_style(parser: ArgumentParser) -> None:
    """Add the options --format and --width of a figure."""
    formats = "format of the figure: raster (png), or vector with editable text (svg, pdf)"
    parser.add_argument("--format", choices=FORMATS, default=None, help=formats)
    widths = "width of the figure: screen, journal page (7.2 inches) or journal column (3.5 inches)"
    parser.add_argument("--width", choices=WIDTHS, default="screen", help=widths)


def load_scene(options: Namespace) -> Scene:
    """Load the scene that SCENE, --preset and --set specify."""
    from graspfx.scene.load import load

    with waiting(f"reading {options.scene}"):
        return load(options.scene, dict(options.overrides), preset=options.preset)


def checked_scene(options: Namespace) -> Scene:
    """Load the scene as `load_scene` does, and print warnings about likely mistakes."""
    scene = load_scene(options)
    with waiting(f"checking {options.scene}"):
        notes = doubts(scene)
    note(notes)
    return scene


def seconds_of(options: Namespace) -> float:
    """Return the value of --seconds [s], or infinity if the option is not given.

    Raises:
        InputError: If the value is not above zero.
    """
    if options.seconds is not None and not options.seconds > 0.0:
        raise InputError("--seconds", options.seconds, "a time above zero")
    return math.inf if options.seconds is None else float(options.seconds)


def picture_name(stem: str, options: Namespace) -> str:
    """Return the file name of a figure: `stem` with the format as ending, which is png without --format."""
    return f"{stem}.{options.format or FORMATS[0]}"


def scene(text: str) -> str:
    """Check and return an argument that is the name or path of a scene.

    Raises:
        ArgumentTypeError: If the text is the path of a recording or of a folder.
    """
    path = Path(text)
    if text.endswith((".h5", ".part")) or (path.name != text and path.is_dir()):
        drawn = f"`graspfx plot {text}` plots it over time, `graspfx picture {text}` draws one instant"
        raise ArgumentTypeError(f"{text} is a recording or its folder, expected a scene; {drawn}")
    return text


def recording(text: str) -> Path:
    """Check an argument that is the path of a recording or of its folder, and return it as a `Path`.

    Raises:
        ArgumentTypeError: If the text is the name or path of a scene.
    """
    from graspfx.plugins import is_file_name, names

    path = Path(text)
    if is_file_name(text) or (not path.exists() and path.name == text and text in names("scenes")):
        calls = f"`graspfx run {text}` records it, `graspfx picture {text}` runs it and draws one instant"
        raise ArgumentTypeError(f"{text} is a scene, expected a recording; {calls}")
    return path


def recorded(options: Namespace) -> Path | None:
    """Return the path of a recording if the argument SCENE is a recording or its folder; None if it is a scene.

    The argument is a scene if it ends in .toml or .py. A name without a slash is also a scene, unless it is the name of
    a recording file or of a folder that contains a recording.

    Raises:
        InputError: If a recording is given with --set or --preset.
    """
    from graspfx.recording.files import NAME, is_part, recording_file

    path = Path(options.scene)
    is_file = path.suffix == ".h5" or is_part(path)
    if path.suffix in (".toml", ".py") or not (is_file or path.parent != Path() or recording_file(path).is_file()):
        return None
    for option, value in (("--set", dict(options.overrides)), ("--preset", options.preset)):
        if value:
            raise InputError(option, value, "a scene instead of a recording", f"{path} is a recording")
    return path if is_file or path.exists() else path / NAME


def separate(words: Sequence[str]) -> Iterator[str]:
    """Yield the words of a command line, with options such as --set repeated before each of their values.

    Words with `=` that follow such an option are its values, up to the first word without `=` or with a leading `-`.
    """
    last, option = "", ""
    for word in words:
        is_value = bool(option) and "=" in word and not word.startswith("-")
        if is_value and last != option:
            yield option
        yield word
        last, option = word, word if word in LISTS else option if is_value else ""


def override(text: str) -> tuple[str, Any]:
    """Parse a text KEY=VALUE. The value is parsed as TOML; a value that is not valid TOML is used as a string.

    Raises:
        ArgumentTypeError: If the key or `=` is missing, the value is nested too deeply, or the text has several values.
    """
    import tomllib

    from graspfx.scene.overrides import toml_value
    from graspfx.scene.toml_text import excess

    key, equals, value = text.partition("=")
    if not key.strip() or not equals:
        raise ArgumentTypeError(f"{text!r} is not of the form KEY=VALUE")
    try:
        if fault := excess(text):
            raise ArgumentTypeError(f"{text[:40]}...: {fault.message}")
        return key.strip(), toml_value(value, SET)
    except tomllib.TOMLDecodeError:
        return key.strip(), value
    except InputError as error:
        raise ArgumentTypeError(f"{key.strip()}: expected {error.expected}; {error.do}; given {text!r}") from None
