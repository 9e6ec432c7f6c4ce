"""graspfx completion: print a script that completes commands, options, scenes and recordings in a shell."""

from __future__ import annotations

from argparse import SUPPRESS, Action, ArgumentParser, Namespace
from collections.abc import Iterable, Iterator, Sequence
from importlib import import_module
from pathlib import Path

from graspfx.commands.destination import OUT
from graspfx.commands.output import SUCCESS, add_loudness

EXAMPLE = """  graspfx completion fish > ~/.config/fish/completions/graspfx.fish
for bash or zsh, add this line to ~/.bashrc or ~/.zshrc, with the shell's name:
  eval "$(graspfx completion bash)"
"""
SCRIPTS = {
    "bash": """_graspfx() {
    local IFS=$'\\n'
    COMPREPLY=($(graspfx completion --words "${COMP_WORDS[@]:1:COMP_CWORD}" 2>/dev/null))
}
complete -o default -F _graspfx graspfx
""",
    "zsh": """_graspfx() {
    local -a answers
    answers=("${(@f)$(graspfx completion --words "${(@)words[2,CURRENT]}" 2>/dev/null)}")
    [[ -n "${answers[1]}" ]] && compadd -a answers
    [[ "${words[CURRENT]}" == -* ]] || _files
}
compdef _graspfx graspfx
""",
    "fish": """function _graspfx
    graspfx completion --words (commandline -opc)[2..] (commandline -ct) 2>/dev/null
end
complete -c graspfx -a '(_graspfx)'
""",
}
MOST = 50  # largest number of recordings listed from out/


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("shell", metavar="SHELL", nargs="?", choices=tuple(SCRIPTS), help="bash, zsh or fish")
    parser.add_argument("--words", nargs="...", help=SUPPRESS)  # words of a command line; completes the last


def execute(options: Namespace) -> int:
    if options.words is not None:
        print(*answers(options.words, options.commands), sep="\n")
    else:
        print(SCRIPTS[options.shell or "bash"], end="")
    return SUCCESS


def answers(words: Sequence[str], commands: Sequence[str]) -> Iterator[str]:
    """Yield the completions of the last word of a command line; none if the word is a path or another free value.

    Args:
        words: Words of the command line after `graspfx`. The last word is incomplete or empty.
        commands: Names of all commands.
    """
    *before, begun = words or [""]
    command = next((word for word in before if not word.startswith("-")), None)
    if command is None:
        options = () if begun and not begun.startswith("-") else ("--help", "--version")
        yield from _beginning(begun, [*commands, *options])
    elif command in commands:
        parser = ArgumentParser(prog=command)
        import_module(f"graspfx.commands.{command}").add_arguments(parser)
        add_loudness(parser)
        yield from _beginning(begun, _choices(parser._actions, before, begun))


def _choices(actions: Sequence[Action], before: Sequence[str], begun: str) -> Iterator[str]:
    """Yield candidates for the word that follows the words `before` and begins with `begun`.

    The candidates are the values of the preceding option if this has values. Otherwise, they are options if `begun`
    begins with a hyphen, and values of the command's arguments if not.
    """
    by_name = {name: each for each in actions for name in each.option_strings}
    action = by_name.get(before[-1])
    if action is not None and action.nargs != 0 and not begun.startswith("-"):
        yield from map(str, action.choices or ())
        return
    if begun.startswith("-"):
        yield from (name for name, each in by_name.items() if each.help is not SUPPRESS)
        return
    for each in actions:
        if not each.option_strings:
            yield from map(str, each.choices or ())
            yield from _subjects(str(each.metavar))


def _subjects(kind: str) -> Iterator[str]:
    """Yield scenes, experiments or recordings, according to the name `kind` of an argument, such as "SCENE"."""
    if "SCENE" in kind:
        from graspfx import plugins

        yield from plugins.names("scenes")
        yield from (str(path) for path in Path().glob("*.toml"))
    if "EXPERIMENT" in kind:
        from graspfx.experiment.experiment_file import names

        yield from names()
        yield from (str(path) for path in Path().glob("*.toml"))
    if "RECORDING" in kind:
        from graspfx.recording.files import NAME

        yield from (str(path.parent) for path, _ in zip(sorted(OUT.glob(f"*/{NAME}")), range(MOST), strict=False))
        yield from (str(path) for path in Path().glob("*.h5"))


def _beginning(begun: str, names: Iterable[str]) -> Iterator[str]:
    yield from sorted({name for name in names if name.startswith(begun)})
