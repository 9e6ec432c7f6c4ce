"""The graspfx command: run, check, stability, calibrate, warmup, bench, devices, doctor, list, plot, replay..."""

from __future__ import annotations

import gc
import os
import sys
import warnings
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Collection, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from importlib import import_module
from typing import NoReturn

from graspfx import __version__, progress
from graspfx.commands.arguments import separate
from graspfx.commands.loudness import add_loudness, is_quiet, loudness
from graspfx.commands.output import CODES, INTERRUPTED, WRONG
from graspfx.environment import granted
from graspfx.errors import GraspFXError, InputError, UnknownNameError
from graspfx.plugins import unchanged
from graspfx.system.scheduling import memory_limit

COMMANDS = {  # modules of graspfx.commands, with EXAMPLE, add_arguments(parser) and execute(chosen) -> exit code
    "run": "simulate a scene, record it and sum it up",
    "check": "show a scene's faults, or what each sample will do and why",
    "stability": "say how far gains can go, also over ranges of keys",
    "sweep": "simulate many variants, on many processors or machines; what is killed goes on where it was",
    "tune": "find the largest gains that keep margins in the hands of every operator of a set",
    "replay": "move a recording's fingers again, and compare forces and objects to the bit",
    "calibrate": "measure a scene's hardware: how late its forces are, mass, friction, axes",
    "export": "write a recording as comma-separated text, netCDF or a bag of ROS, for other programs",
    "warmup": "compile scenes before they are needed",
    "bench": "measure run time against error, of a scene's choices or of common calls",
    "completion": "print a script with which a shell completes commands, options, scenes and recordings",
    "devices": "list the drivers, and what is plugged in or installed for them; nothing is opened",
    "doctor": "say whether this machine, and the hardware of a scene, can do a loop in real time",
    "list": "name the scenes, devices, hands and dynamics there are, a line about each",
    "schema": "print the JSON schema of a scene",
    "plot": "draw one recording, or several side by side",
    "picture": "draw one instant: objects, fingers, forces as arrows",
    "view": "show a running scene in the browser, to be steered; or a recording",
    "stream": "run a scene whose states other programs have, by a WebSocket or LSL",
    "experiment": "run trials in a planned order, ask for answers, and record each",
    "touch": "run a scene whose fingers follow fingers on a touch screen; forces are shown, not felt",
}
NEW = 20_000  # objects between two looks for cycles: imports make as many that stay, of which 700 are too few


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; its exit code is one of those in `graspfx.commands.output.CODES`."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    limit = memory_limit()  # now: without memory nothing is imported any more
    try:
        options = parse(words)
        trust = granted(getattr(options, "trust", False))
        with loudness(options), _progress(options), _plain_warnings(), unchanged(), trust:
            code: int = options.command(options)
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
    except (MemoryError, ImportError, OSError, SystemError, RuntimeError) as error:  # where memory ends, any of these
        if not limit or (isinstance(error, RuntimeError) and "thread" not in str(error)):
            raise
        said = f"the memory of this process is limited to {limit}, which does not suffice: lift the limit"
        print(said, type(error).__name__, str(error)[:200], sep="; ", file=sys.stderr)
        return WRONG
    return code


def parse(words: Sequence[str]) -> Namespace:
    """Parse the arguments of a command.

    Raises:
        UnknownNameError: no command or option has that name.
        SystemExit: --help, --version, or arguments that do not fit.
    """
    if not words:
        words = ["--help"]
    word = next((word for word in words if not word.startswith("-")), None)
    if word is not None and word not in COMMANDS:
        raise UnknownNameError("command", word, COMMANDS, "`graspfx --help` says what each does")
    options, others = parser(words).parse_known_args(list(separate(words)))
    if others:
        _refuse(str(word), others, options.options)
    return options


def parser(words: Collection[str] = tuple(COMMANDS)) -> ArgumentParser:
    """Build the parser of every command, with the arguments of those named in `words`: other modules are not loaded."""
    top = ArgumentParser(prog="graspfx", description="Haptic display of grasping.", epilog=CODES)
    top.formatter_class = RawDescriptionHelpFormatter
    top.add_argument("--version", action="version", version=f"graspfx {__version__}")
    commands = top.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name, summary in COMMANDS.items():
        sentence = f"{summary[0].upper()}{summary[1:]}."
        command = commands.add_parser(name, help=summary, description=sentence)
        command.formatter_class = RawDescriptionHelpFormatter
        if name in words:
            module = import_module(f"graspfx.commands.{name}")
            module.add_arguments(command)
            add_loudness(command)
            command.epilog = f"example:\n{module.EXAMPLE}\n\n{CODES}"
            options = tuple(command._option_string_actions)
            command.set_defaults(command=module.execute, options=options, commands=tuple(COMMANDS))
    return top


def _refuse(command: str, words: Sequence[str], options: Sequence[str]) -> NoReturn:
    """Say which word of a command has no place in it, and what comes near."""
    option = next((word.partition("=")[0] for word in words if word.startswith("-")), None)
    if option is not None:
        raise UnknownNameError("option", option, options, f"`graspfx {command} --help` says what each does")
    remedy = "a value of --set is of the form KEY=VALUE" if "--set" in options else ""
    raise InputError(command, " ".join(words), "no further argument", remedy)


def program() -> int:
    """Run `main` for a process that ends with it."""
    gc.set_threshold(NEW, *gc.get_threshold()[1:])
    code = main()
    gc.freeze()  # at its end Python would look through all there is for cycles, twice: a tenth of a short run
    return code


def _progress(options: Namespace) -> AbstractContextManager[None]:
    """Show waits on the terminal where a user looks on: nobody does who asks for JSON, for quiet, or for messages."""
    silent = is_quiet() or getattr(options, "json", False) or getattr(options, "verbose", 0)
    if silent or sys.stderr is None or not sys.stderr.isatty():
        return nullcontext()
    from graspfx.show.progress_line import progress_line

    return progress_line(sys.stderr)


@contextmanager
def _plain_warnings() -> Iterator[None]:
    """Print a warning as one line, once."""
    texts: set[str] = set()

    def show(message: Warning | str, *_: object, **__: object) -> None:
        text = " ".join(str(message).split())
        if text not in texts and not is_quiet():
            texts.add(text)
            progress.clear()
            print(f"warning: {text}", file=sys.stderr)

    with warnings.catch_warnings():
        warnings.showwarning = show
        yield


if __name__ == "__main__":
    sys.exit(program())
