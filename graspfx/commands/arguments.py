"""Arguments that several commands take: a scene, and values of it to replace."""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

SET = "--set"
LISTS = (SET, "--operators", "--over")  # after which several values may follow
FORMATS = ("png", "svg", "pdf")
WIDTHS = ("screen", "page", "column")


def add_scene(parser: ArgumentParser) -> None:
    """Add SCENE, --preset and --set."""
    text = "a scene's name, or the path of a .toml or .py file"
    parser.add_argument("scene", metavar="SCENE", type=scene, help=text)
    add_overrides(parser)


def add_overrides(parser: ArgumentParser) -> None:
    """Add --preset, --set and --trust."""
    text = "take the set of values that the scene states by this name, before those of --set; `check` lists them"
    parser.add_argument("--preset", metavar="NAME", help=text)
    add_values(parser)


def add_values(parser: ArgumentParser) -> None:
    """Add --set and --trust."""
    values = parser.add_argument(SET, metavar="KEY=VALUE", type=override, action="append", default=[])
    values.dest, values.help = "overrides", "replace values of the scene, by dotted keys; several may follow one --set"
    whole = "let the scene name files outside of its folder: what is Python among them runs"
    parser.add_argument("--trust", action="store_true", help=whole)


def add_operators(parser: ArgumentParser, more: str = "") -> None:
    """Add --operators, whose values `operators` reads."""
    text = "a range of a key over operators, KEY=FROM:TO:LAW for log, uniform, normal, lognormal; several may follow"
    usual = "without one, those of the scene's table [operators], or the usual ones"
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
    formats = "of the figure: in pixels, or as lines and text that can be edited"
    parser.add_argument("--format", choices=FORMATS, default=None, help=formats)
    widths = "of the figure: for a screen, or 7.2 or 3.5 inches of a journal, with type that is legible there"
    parser.add_argument("--width", choices=WIDTHS, default="screen", help=widths)


def picture_name(stem: str, options: Namespace) -> str:
    """Name the file of a figure by its format."""
    return f"{stem}.{options.format or FORMATS[0]}"


def scene(text: str) -> str:
    """Take a scene's name or path, and say of a recording what it is for."""
    path = Path(text)
    if text.endswith((".h5", ".part")) or (path.name != text and path.is_dir()):
        drawn = f"`graspfx plot {text}` draws it over time, `graspfx picture {text}` one instant"
        raise ArgumentTypeError(f"{text} is a recording, or the folder of one, not a scene: {drawn}")
    return text


def recording(text: str) -> Path:
    """Take the path of a recording or of its folder, and say of a scene what makes a recording of it."""
    from graspfx.plugins import is_file_name, names

    path = Path(text)
    if is_file_name(text) or (not path.exists() and path.name == text and text in names("scenes")):
        calls = f"`graspfx run {text}` records it, `graspfx picture {text}` runs it and draws one instant"
        raise ArgumentTypeError(f"{text} is a scene, not a recording: run it first; {calls}")
    return path


def separate(words: Sequence[str]) -> Iterator[str]:
    """Put a --set before each value of a command: the first word without `=` after a value ends the list."""
    last, option = "", ""
    for word in words:
        is_value = bool(option) and "=" in word and not word.startswith("-")
        if is_value and last != option:
            yield option
        yield word
        last, option = word, word if word in LISTS else option if is_value else ""


def override(text: str) -> tuple[str, Any]:
    """Parse KEY=VALUE: the value is TOML where it reads as TOML, else the text itself.

    Raises:
        ArgumentTypeError: no key, a value that is too deep, or more than one.
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
        raise ArgumentTypeError(f"{key.strip()} takes {error.expected}: {error.do}; given {text!r}") from None
