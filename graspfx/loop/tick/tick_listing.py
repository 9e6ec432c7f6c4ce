"""The program of a tick as a person reads it: entries by name, and beside each part the line that it comes from."""

from __future__ import annotations

import re
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import graspfx
from graspfx.compile.program import specialise
from graspfx.compile.specialise.listing import Listing, listings
from graspfx.compile.unfold.writer import Line
from graspfx.loop.parts import Parts
from graspfx.loop.tick.engine_text import texts
from graspfx.loop.tick.names import Names, columns
from graspfx.loop.tick.script import Script, Tick
from graspfx.loop.tick.text import lines_of

WIDTH = 88  # at which the lines of sources stand
ENTRY = re.compile(r"\b([A-Za-z]+\d+)\b(?:\[(\d+)\])?")
CALL = re.compile(r"\b(\w+)(?=\()")
ROW = re.compile(r"\brows\[row(?: \+ (\d+))?\]")


def listing(parts: Parts) -> list[str]:
    """List the specialised program of a tick: first what runs it from top to bottom, then the kernels that it calls.

    A function that serves several memories of a kind says `device.position`, one that serves a single one
    `device[0].position`. Entries that nothing declares stay numbers.
    """
    tick = Tick(Script())
    begin, end = lines_of(parts, tick)
    tick.begin += [line.text for line in begin]
    tick.end += [line.text for line in end]
    script = tick.script
    names, row = Names(parts, tick), columns(parts.layout)
    out: list[str] = []
    for name, text in texts(tick).items():
        program = specialise(text, script.kernels, [*script.arrays, "rows"], script.frozen)
        halves = {"run": [None, None, *begin, *end], "begin": [None, *begin], "end": [None, *end]}
        functions = listings(program)
        words, memories = _Words(names, row, _function_names(functions)), _memories_of(functions)
        for function in functions:
            shared = {parameter for parameter, uses in memories[function.name].items() if len(uses) > 1}
            out += [*_function(function, halves[name] if function.name == name else [], words, shared), ""]
    return out[:-1]


@dataclass(frozen=True)
class _Words:
    """The names that stand in a listing for those of a program."""

    names: Names
    row: Mapping[int, str]  # numbers of a recorded row
    functions: Mapping[str, str]

    def text(self, line: str, shared: Container[str]) -> str:
        """Name what a line names, in a function of which some parameters stand for several memories."""

        def memory(match: re.Match[str]) -> str:
            array, entry = match.groups()
            if array not in self.names.memories:
                return match.group()
            if entry is not None:
                return (self.names.shared if array in shared else self.names.entry)(array, int(entry))
            name = self.names.memories[array]
            return name.partition("[")[0] if array in shared else name

        line = CALL.sub(lambda match: self.functions.get(match.group(1), match.group(1)), ENTRY.sub(memory, line))
        return ROW.sub(lambda match: self.row[int(match.group(1) or 0)], line)


def _function_names(program: Sequence[Listing]) -> dict[str, str]:
    """Name kernels by their own names, with a number where a kernel was specialised several times."""
    kernels: dict[str, list[str]] = {}
    for function in program:
        name = function.name if function.origin is None else function.name.rpartition("_")[0]
        kernels.setdefault(name, []).append(function.name)
    return {
        function: name if len(functions) == 1 else f"{name}_{k}"
        for name, functions in kernels.items()
        for k, function in enumerate(functions, start=1)
    }


def _function(
    function: Listing, sources: Sequence[Line | None], words: _Words, shared: Container[str]
) -> Iterator[str]:
    """List the lines of a function, those of the tick under the name of the stage that wrote them.

    Args:
        function: of the program.
        sources: of the lines of the text that it was made from, if it is the tick's.
        words: of the listing.
        shared: parameters that stand for several memories.
    """
    head = f"def {function.name}({', '.join(function.parameters)}):"
    yield _beside(words.text(head, shared), "" if function.origin is None else _place(*function.origin))
    stage, before = "", 0
    for text, origin in function.lines:
        file, line = origin or ("", 0)
        if file.startswith("<"):  # a text, of which the tick knows its lines' sources
            source = sources[line - 1] if line <= len(sources) else None
            line = 0 if source is None else source.origin.line
            if source is not None and source.origin.stage != stage:
                stage = source.origin.stage
                yield f"{text[: len(text) - len(text.lstrip())]}# {stage}, {_file(source.origin.file)}"
        yield _beside(words.text(text, shared), f"line {line}" if line not in (0, before) else "")
        before = line


def _memories_of(program: Sequence[Listing]) -> dict[str, dict[str, set[str]]]:
    """Find the memories that the parameters of functions stand for, from the first caller on."""
    functions = {function.name: function for function in program}
    memories: dict[str, dict[str, set[str]]] = {
        function.name: {parameter: set() for parameter in function.parameters} for function in program
    }
    calls = [(program[0].name, [(name, {name}) for name in program[0].parameters])]
    while calls:
        name, arguments = calls.pop()
        here = memories[name]
        if all(argument <= here[parameter] for parameter, argument in arguments):
            continue
        for parameter, argument in arguments:
            here[parameter] |= argument
        for callee, expressions in functions[name].calls:
            pairs = zip(functions[callee].parameters, expressions, strict=False)
            calls.append((callee, [(parameter, set(here.get(text, ()))) for parameter, text in pairs]))
    return memories


def _beside(text: str, source: str) -> str:
    return f"{text:<{WIDTH}}  # {source}" if source else text


def _place(file: str, line: int) -> str:
    return f"{_file(file)}:{line}"


def _file(file: str) -> str:
    """Name a file as it stands in the source tree, or in full if it is not GraspFX's."""
    for root in graspfx.__path__:
        folder = Path(root).parent if Path(root).name == "graspfx" else Path(root)
        if Path(file).is_relative_to(folder):
            return Path(file).relative_to(folder).as_posix()
    return file
