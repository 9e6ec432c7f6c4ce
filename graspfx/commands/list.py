"""graspfx list: list scenes, devices, hands and dynamics, each with a line of description."""

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
                path = source_of(group, name)
                print(f"  {name:<{width}}  {line_about(path)}[{origin}]")
                for preset, reason in presets_of(path).items():
                    print(f"  {'':<{width}}  --preset {preset}: {reason}")
    return SUCCESS


def presets_of(path: Path | None) -> dict[str, str]:
    """Return the reason of each preset of a TOML scene, by name; empty if there are none or the file is invalid."""
    if path is None or path.suffix != ".toml":
        return {}
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8")).get("preset", {})
        return {name: " ".join(str(preset["reason"]).split()) for name, preset in table.items()}
    except (OSError, ValueError, RecursionError, AttributeError, KeyError, TypeError):  # `check` reports the fault
        return {}


def line_about(path: Path | None) -> str:
    """Return the title of a TOML scene, or the first line of a Python file's docstring; empty if there is none."""
    try:
        text = path.read_text(encoding="utf-8") if path is not None else ""
        if path is not None and path.suffix == ".toml":
            line = str(tomllib.loads(text).get("title", ""))
        else:
            line = (ast.get_docstring(ast.parse(text)) or "").partition("\n")[0]
    except (OSError, ValueError, SyntaxError, RecursionError):  # `check` reports the fault
        return ""
    line = " ".join(line.split()).rstrip(".")
    return f"{line}  " if line else ""
