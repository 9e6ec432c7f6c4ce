"""graspfx list: the scenes, devices, hands and dynamics there are."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from graspfx.commands.output import DONE
from graspfx.plugins import names


def add_arguments(parser: ArgumentParser) -> None:
    """It takes none."""


def execute(chosen: Namespace) -> int:
    for group in ("scenes", "devices", "hands", "dynamics"):
        if found := names(group):
            width = max(map(len, found))
            print(group, *(f"  {name:<{width}}  {origin}" for name, origin in found.items()), sep="\n")
    return DONE
