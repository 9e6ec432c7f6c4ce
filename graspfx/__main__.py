"""The `graspfx` command: parse the arguments, run one of the commands, and return its exit code."""

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
from graspfx.commands.output import CODES, INTERRUPTED, WRONG, add_loudness, is_quiet, loudness
from graspfx.environment import granted
from graspfx.errors import GraspFXError, InputError, UnknownNameError
from graspfx.plugins import unchanged
from graspfx.system.scheduling import memory_limit

COMMANDS = {  # modules of graspfx.commands; each has EXAMPLE, add_arguments(parser), execute(options) -> exit code
    "run": "simulate a scene, record it and print a summary",
    "check": "print the faults of a scene, whether it is stable, and the stability limits of its gains",
    "stability": "print the stability limits of a scene's gains, optionally for each value of other keys",
    "sweep": "simulate many variants of a scene on many processors or machines; a stopped sweep can be resumed",
    "tune": "find the largest gains of a scene that keep the margins for every operator in a set",
    "replay": "recompute a recording from its finger motion, and compare its forces and object motions bit for bit",
    "calibrate": "measure the delay, mass, friction and axes of a scene's hardware",
    "export": "write a recording as CSV, netCDF or a ROS bag",
    "warmup": "compile kernels before they are needed",
    "bench": "measure run time and error, for the options of a scene or for common calls",
    "completion": "print a script that completes commands, options, scenes and recordings in a shell",
    "devices": "list the drivers and the hardware or software found for each driver, without opening a device",
    "doctor": "test whether this machine, and a device or a scene's hardware, can run a real-time loop",
    "list": "list scenes, devices, hands and dynamics, each with a one-line description",
    "schema": "print the JSON schema of a scene",
    "plot": "draw one recording, or several side by side",
    "picture": "draw one instant: objects, fingers, and forces as arrows",
    "view": "show and control a running scene in the browser, or show a recording",
    "page": "write a page that runs a scene in a browser, without an installation or a server",
    "stream": "run a scene, and stream its states over a WebSocket or LSL",
    "experiment": "run trials in a planned order, ask the participant for answers, and record each trial",
    "touch": "run a scene whose fingers follow a touch screen; forces are drawn, not displayed by a device",
}
NEW = 20_000  # new objects between garbage collections; with the default of 700, imports trigger many


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command, and return its exit code (`graspfx.commands.output.CODES`)."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    limit = memory_limit()  # read now: an import may fail once memory is exhausted
    try:
        options = parse(words)
        trust = granted(getattr(options, "trust", False))
        with loudness(options), _progress(options), _plain_warnings(), unchanged(), trust:
            code: int = options.command(options)
        sys.stdout.flush()
    except BrokenPipeError:  # the pipe is closed, as in `graspfx schema | head`: print nothing, not even at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return WRONG
    except GraspFXError as error:
        print(error, file=sys.stderr)
        return WRONG
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    except (MemoryError, ImportError, OSError, SystemError, RuntimeError) as error:  # any of these where memory ends
        if not limit or (isinstance(error, RuntimeError) and "thread" not in str(error)):
            raise
        text = f"the memory of this process is limited to {limit}, which is not enough: raise the limit"
        print(text, type(error).__name__, str(error)[:200], sep="; ", file=sys.stderr)
        return WRONG
    return code


def parse(words: Sequence[str]) -> Namespace:
    """Parse the arguments of the command line.

    Raises:
        UnknownNameError: If a command or an option is unknown.
        InputError: If there are more arguments than the command accepts.
        SystemExit: For --help and --version, and for other invalid arguments.
    """
    if not words:
        words = ["--help"]
    word = next((word for word in words if not word.startswith("-")), None)
    if word is not None and word not in COMMANDS:
        raise UnknownNameError("command", word, COMMANDS, "`graspfx --help` describes the commands")
    options, others = parser(words).parse_known_args(list(separate(words)))
    if others:
        _refuse(str(word), others, options.options)
    return options


def parser(words: Collection[str] = tuple(COMMANDS)) -> ArgumentParser:
    """Build the parser of all commands; only the modules of commands in `words` are imported to add arguments."""
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
    """Raise the error for arguments that the command does not know; for an unknown option, suggest a close match."""
    option = next((word.partition("=")[0] for word in words if word.startswith("-")), None)
    if option is not None:
        raise UnknownNameError("option", option, options, f"`graspfx {command} --help` describes the options")
    remedy = "values of --set have the form KEY=VALUE" if "--set" in options else ""
    raise InputError(command, " ".join(words), "no further argument", remedy)


def program() -> int:
    """Run `main` in a process that does nothing else, with less garbage collection, and return the exit code."""
    gc.set_threshold(NEW, *gc.get_threshold()[1:])
    code = main()
    gc.freeze()  # otherwise Python collects garbage twice at exit, which takes a tenth of the time of a short run
    return code


def _progress(options: Namespace) -> AbstractContextManager[None]:
    """Show progress on the terminal, unless --json, -q or -v is given."""
    silent = is_quiet() or getattr(options, "json", False) or getattr(options, "verbose", 0)
    if silent or sys.stderr is None or not sys.stderr.isatty():
        return nullcontext()
    from graspfx.show.progress_line import progress_line

    return progress_line(sys.stderr)


@contextmanager
def _plain_warnings() -> Iterator[None]:
    """Print each warning once, on one line."""
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
