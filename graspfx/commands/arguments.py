"""Arguments that several commands take: a scene, and values of it to replace."""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError
from typing import Any


def add_scene(parser: ArgumentParser) -> None:
    parser.add_argument("scene", metavar="SCENE", help="a scene's name, or the path of a .toml or .py file")
    add_overrides(parser)


def add_overrides(parser: ArgumentParser) -> None:
    values = parser.add_argument("--set", metavar="KEY=VALUE", type=override, action="extend", nargs="+", default=[])
    values.dest, values.help = "overrides", "replace values of the scene, by dotted keys"
    whole = "let the scene name files outside of its folder: what is Python among them runs"
    parser.add_argument("--trust", action="store_true", help=whole)


def override(text: str) -> tuple[str, Any]:
    """KEY=VALUE as a key and a value: TOML where it reads as TOML, else the text itself."""
    import tomllib

    from graspfx.scene.budget import excess

    key, equals, value = text.partition("=")
    if not key.strip() or not equals:
        raise ArgumentTypeError(f"{text!r} is not of the form KEY=VALUE")
    try:
        if fault := excess(text):
            raise ArgumentTypeError(f"{text[:40]}...: {fault.message}")
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key.strip(), value
