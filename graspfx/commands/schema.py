"""graspfx schema: print the JSON schema of a scene."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from graspfx.commands.output import SUCCESS, print_json

EXAMPLE = """  graspfx schema > scene.schema.json"""


def add_arguments(parser: ArgumentParser) -> None:
    """Add no arguments."""


def execute(options: Namespace) -> int:
    from graspfx.scene.model import schema

    print_json(schema())
    return SUCCESS
