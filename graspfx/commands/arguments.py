"""Arguments that several commands take: a scene, and values of it to replace."""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

SET = "--set"


def add_scene(parser: ArgumentParser) -> None:
    text = "a scene's name, or the path of a .toml or .py file"
    parser.add_argument("scene", metavar="SCENE", type=scene, help=text)
    add_overrides(parser)


def add_overrides(parser: ArgumentParser) -> None:
    values = parser.add_argument(SET, metavar="KEY=VALUE", type=override, action="append", default=[])
    values.dest, values.help = "overrides", "replace values of the scene, by dotted keys; several may follow one --set"


def scene(text: str) -> str:
    """A scene's name or path; a recording is told apart, and what to do with it."""
    path = Path(text)
    if text.endswith((".h5", ".part")) or (path.name != text and path.is_dir()):
        drawn = f"`graspfx plot {text}` draws it over time, `graspfx picture {text}` one instant"
        raise ArgumentTypeError(f"{text} is a recording, or the folder of one, not a scene: {drawn}")
    return text


def separate(words: Sequence[str]) -> Iterator[str]:
    """Words of a command with a --set before each value: the first one after a value that has no `=` ends the list."""
    before, inside = "", False
    for word in words:
        value = inside and "=" in word and not word.startswith("-")
        if value and before != SET:
            yield SET
        yield word
        before, inside = word, value or word == SET


def override(text: str) -> tuple[str, Any]:
    """KEY=VALUE as a key and a value: TOML where it reads as TOML, else the text itself."""
    import tomllib

    key, equals, value = text.partition("=")
    if not key.strip() or not equals:
        raise ArgumentTypeError(f"{text!r} is not of the form KEY=VALUE")
    try:
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key.strip(), value
