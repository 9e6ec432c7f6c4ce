"""graspfx devices: list the drivers, and the hardware or software that was found for each, without opening devices."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from dataclasses import asdict

from graspfx.commands.arguments import add_options
from graspfx.commands.output import SUCCESS, print_json
from graspfx.machine.plugged import sightings

EXAMPLE = """  graspfx devices"""
TITLES = "driver", "found", "in a scene"


def add_arguments(parser: ArgumentParser) -> None:
    add_options(parser, ("--json", "print the table as JSON only"))


def execute(options: Namespace) -> int:
    listing = sightings()
    if options.json:
        print_json([asdict(each) for each in listing])
        return SUCCESS
    rows = [TITLES, *((each.driver, each.sight, each.device and f"device = {each.device}") for each in listing)]
    widths = [max(len(row[i]) for row in rows) for i in range(2)]
    for row in rows:
        print(f"{row[0]:<{widths[0]}}  {row[1]:<{widths[1]}}  {row[2]}".rstrip())
    return SUCCESS
