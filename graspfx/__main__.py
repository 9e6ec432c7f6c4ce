"""The graspfx command: run, check, stability, warmup, bench, list, schema, plot and picture."""

from __future__ import annotations

import gc
import os
import sys
import warnings
from argparse import ArgumentParser
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module

from graspfx import __version__
from graspfx.commands.output import INTERRUPTED, WRONG
from graspfx.errors import GraspFXError
from graspfx.trust import granted

COMMANDS = {  # each is a module of graspfx.commands with add_arguments(parser) and execute(chosen) -> exit code
    "run": "simulate a scene, record it and sum it up",
    "check": "show a scene's faults, or what each sample will do and why",
    "stability": "say how far gains can go, also over ranges of keys",
    "warmup": "compile scenes before they are needed",
    "bench": "measure run time against error, beside peers",
    "list": "name the scenes, devices, hands and dynamics there are",
    "schema": "print the JSON schema of a scene",
    "plot": "draw one recording, or two side by side",
    "picture": "draw one instant: objects, fingers, forces as arrows",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command; the exit code is 0, 2 for an error, 3 for a run with faults, 130 when interrupted."""
    given = sys.argv[1:] if arguments is None else arguments
    chosen = parser(given).parse_args(given)
    try:
        with _plain_warnings(), granted(getattr(chosen, "trust", False)):
            code: int = chosen.command(chosen)
        sys.stdout.flush()
    except BrokenPipeError:  # who reads has left, as in `graspfx schema | head`: nothing more to say, at exit neither
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return WRONG
    except GraspFXError as error:
        print(error, file=sys.stderr)
        return WRONG
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    return code


def parser(given: Collection[str] = tuple(COMMANDS)) -> ArgumentParser:
    """Every command, and the arguments of those that are named in `given`: the others' modules are not loaded."""
    top = ArgumentParser(prog="graspfx", description="Haptic display of grasping.")
    top.add_argument("--version", action="version", version=f"graspfx {__version__}")
    commands = top.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name, summary in COMMANDS.items():
        command = commands.add_parser(name, help=summary)
        if name in given:
            module = import_module(f"graspfx.commands.{name}")
            module.add_arguments(command)
            command.set_defaults(command=module.execute)
    return top


def program() -> int:
    """`main`, for a process that ends with it."""
    code = main()
    gc.freeze()  # at its end Python would look through all there is for cycles, twice: a tenth of a short run
    return code


@contextmanager
def _plain_warnings() -> Iterator[None]:
    """A warning is one line, said once."""
    said: set[str] = set()

    def show(message: Warning | str, *_: object, **__: object) -> None:
        text = " ".join(str(message).split())
        if text not in said:
            said.add(text)
            print(f"warning: {text}", file=sys.stderr)

    with warnings.catch_warnings():
        warnings.showwarning = show
        yield


if __name__ == "__main__":
    sys.exit(program())
