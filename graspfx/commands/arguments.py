"""Arguments that several commands share: a scene, overrides of its values, the format of a figure."""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

SET = "--set"
LISTS = (SET, "--operators", "--over")  # options that take several values
FORMATS = ("png", "svg", "pdf")
WIDTHS = ("screen", "page", "column")


def add_options(parser: ArgumentParser, *rows: tuple[Any, ...]) -> None:
    """Add options, each from a row: "--name METAVAR", help, type and default; a name without metavar is a switch."""
    for spec, text, *others in rows:
        name, _, metavar = spec.partition(" ")
        if metavar:
            kind, default = [*others, None, None][:2]
            parser.add_argument(name, metavar=metavar, help=text, type=kind, default=default)
        else:
            parser.add_argument(name, action="store_true", help=text)


def add_scene(parser: ArgumentParser) -> None:
    """Add SCENE, --preset, --set and --trust."""
    text = "name of a scene, or path of its .toml or .py file"
    parser.add_argument("scene", metavar="SCENE", type=scene, help=text)
    add_overrides(parser)


def add_overrides(parser: ArgumentParser) -> None:
    """Add --preset, --set and --trust."""
    text = "preset of the scene, applied before --set; `graspfx list` names the presets"
    parser.add_argument("--preset", metavar="NAME", help=text)
    add_values(parser)


def add_values(parser: ArgumentParser) -> None:
    """Add --set and --trust."""
    values = parser.add_argument(SET, metavar="KEY=VALUE", type=override, action="append", default=[])
    values.dest, values.help = "overrides", "new value of a scene key, such as object.mass=0.2; accepts several"
    whole = "allow the scene to use files outside its folder; Python files among them are executed"
    parser.add_argument("--trust", action="store_true", help=whole)


def add_operators(parser: ArgumentParser, more: str = "") -> None:
    """Add --operators; `more` is appended to its help."""
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
    """Add --format and --width."""
    formats = "format of the figure: raster (png), or vector with editable text (svg, pdf)"
    parser.add_argument("--format", choices=FORMATS, default=None, help=formats)
    widths = "width of the figure: screen, journal page (7.2 inches) or journal column (3.5 inches)"
    parser.add_argument("--width", choices=WIDTHS, default="screen", help=widths)


def picture_name(stem: str, options: Namespace) -> str:
    """Return the file name of a figure in the chosen format."""
    return f"{stem}.{options.format or FORMATS[0]}"


def scene(text: str) -> str:
    """Accept a scene's name or path; refuse a recording, and name the commands that read recordings."""
    path = Path(text)
    if text.endswith((".h5", ".part")) or (path.name != text and path.is_dir()):
        drawn = f"`graspfx plot {text}` plots it over time, `graspfx picture {text}` draws one instant"
        raise ArgumentTypeError(f"{text} is a recording or its folder, expected a scene; {drawn}")
    return text


def recording(text: str) -> Path:
    """Accept the path of a recording or of its folder; refuse a scene, and name the command that records it."""
    from graspfx.plugins import is_file_name, names

    path = Path(text)
    if is_file_name(text) or (not path.exists() and path.name == text and text in names("scenes")):
        calls = f"`graspfx run {text}` records it, `graspfx picture {text}` runs it and draws one instant"
        raise ArgumentTypeError(f"{text} is a scene, expected a recording; {calls}")
    return path


def separate(words: Sequence[str]) -> Iterator[str]:
    """Repeat an option such as --set before each of its values: a word without `=` ends the list."""
    last, option = "", ""
    for word in words:
        is_value = bool(option) and "=" in word and not word.startswith("-")
        if is_value and last != option:
            yield option
        yield word
        last, option = word, word if word in LISTS else option if is_value else ""


def override(text: str) -> tuple[str, Any]:
    """Parse KEY=VALUE. The value is parsed as TOML; if it is not valid TOML, it is a string.

    Raises:
        ArgumentTypeError: If the key or `=` is missing, the value is nested too deeply, or there are several values.
    """
    import tomllib

    from graspfx.errors import InputError
    from graspfx.scene.budget import excess
    from graspfx.scene.overrides import toml_value

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
