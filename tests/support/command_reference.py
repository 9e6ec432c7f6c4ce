"""Every command with its arguments as a page, from the parsers that read them.

`python -m tests.support.command_reference` prints it: docs/reference/commands.md.
"""

from __future__ import annotations

from argparse import SUPPRESS, Action, ArgumentParser
from collections.abc import Iterator
from importlib import import_module

from graspfx.__main__ import COMMANDS
from graspfx.commands.output import add_loudness

HEAD = """# Arguments of the commands

Written from the code by `make reference`; a test holds it against the code. [Commands](../how-to/commands.md) says what
they do and how to name values, files and exit codes. Each also takes those of the last section.
"""


def page() -> str:
    """Write the page."""
    shared = ArgumentParser(add_help=False)
    add_loudness(shared)
    parts = [HEAD]
    for name, summary in COMMANDS.items():
        module = import_module(f"graspfx.commands.{name}")
        parser = ArgumentParser(prog=f"graspfx {name}", add_help=False)
        module.add_arguments(parser)
        parts += [f"## graspfx {name}\n".replace("\\\n", "\n"), f"{summary[0].upper()}{summary[1:]}.\n"]
        parts += _table(parser)
        parts += ["```text", *(line.strip() for line in module.EXAMPLE.strip().splitlines()), "```\n"]
    return "\n".join([*parts, "## All commands\n", *_table(shared), ""]).rstrip("\n") + "\n"


def _table(parser: ArgumentParser) -> list[str]:
    """Write a parser's arguments as a table, or nothing for none."""
    rows = [f"| {' | '.join(cells)} |" for cells in map(_cells, _arguments(parser))]
    return ["| argument | default | what |", "|---|---|---|", *rows, ""] if rows else []


def _arguments(parser: ArgumentParser) -> Iterator[Action]:
    yield from (action for action in parser._actions if action.help is not SUPPRESS)


def _cells(action: Action) -> Iterator[str]:
    """Write an argument, its default, and what it is for."""
    value = ""
    if action.nargs != 0:
        choices = "{" + ",".join(map(str, action.choices)) + "}" if action.choices else ""
        metavar = action.metavar if isinstance(action.metavar, str) else " ".join(action.metavar or ())
        value = metavar or choices or action.dest.upper()
        value = f"[{value} ...]" if action.nargs == "*" else f"{value} [...]" if action.nargs == "+" else value
        value = f"[{value}]" if action.nargs == "?" else value
    names = ", ".join(action.option_strings)
    yield f"`{f'{names} {value}'.strip()}`".replace("|", r"\|")
    plain = action.default is None or action.default in (False, SUPPRESS) or action.default == []
    yield "" if plain or action.nargs == 0 else f"`{action.default}`"
    yield " ".join((action.help or "").replace("%%", "%").split()).replace("|", r"\|")


if __name__ == "__main__":
    print(page(), end="")
