"""graspfx list: the scenes, devices, hands and dynamics there are, with a line about each."""

from __future__ import annotations

import ast
import tomllib
from argparse import ArgumentParser, Namespace
from pathlib import Path

from graspfx.commands.output import SUCCESS
from graspfx.plugins import Group, names, source_of

EXAMPLE = """  graspfx list"""
GROUPS: tuple[Group, ...] = ("scenes", "devices", "hands", "dynamics")


def add_arguments(parser: ArgumentParser) -> None:
    """Add no arguments."""


def execute(options: Namespace) -> int:
    for group in GROUPS:
        if origins := names(group):
            width = max(map(len, origins))
            print(group)
            for name, origin in origins.items():
                print(f"  {name:<{width}}  {line_about(source_of(group, name))}[{origin}]")
    return SUCCESS


def line_about(path: Path | None) -> str:
    """Read a scene's title, or the first line of a Python file's docstring; empty where there is none."""
    try:
        text = path.read_text(encoding="utf-8") if path is not None else ""
        if path is not None and path.suffix == ".toml":
            line = str(tomllib.loads(text).get("title", ""))
        else:
            line = (ast.get_docstring(ast.parse(text)) or "").partition("\n")[0]
    except (OSError, ValueError, SyntaxError, RecursionError):  # `check` says what is wrong with it
        return ""
    line = " ".join(line.split()).rstrip(".")
    return f"{line}  " if line else ""
