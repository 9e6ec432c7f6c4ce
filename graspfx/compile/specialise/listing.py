"""Lists a specialised program: its functions in the order in which they are called, lines beside their sources."""

from __future__ import annotations

import ast
from collections.abc import Container, Iterator
from dataclasses import dataclass

from graspfx.compile.lower.lowering import written_lines
from graspfx.compile.specialise.specialise import Program
from graspfx.compile.specialise.syntax import unparsed_statements

Origin = tuple[str, int]  # file and line


@dataclass(frozen=True)
class Listing:
    """One function of a program.

    Attributes:
        name: in the program.
        parameters: arrays first.
        origin: of the kernel that it was made from; None for the text that calls them all.
        lines: of its body, each with the line that it was made from, if that is known.
        calls: the program's functions that it calls, with their arguments' texts.
    """

    name: str
    parameters: tuple[str, ...]
    origin: Origin | None
    lines: tuple[tuple[str, Origin | None], ...]
    calls: tuple[tuple[str, tuple[str, ...]], ...]


def listings(program: Program) -> list[Listing]:
    """List the functions of a program, each before those that it calls first."""
    functions = {node.name: node for node in program.definitions()}
    order: dict[str, Listing] = {}

    def visit(node: ast.FunctionDef) -> None:
        if node.name in order:
            return
        order[node.name] = listing = _listing(node, functions.keys())
        for name, _ in listing.calls:
            visit(functions[name])

    visit(program.functions[-1])
    return list(order.values())


def _listing(node: ast.FunctionDef, names: Container[str]) -> Listing:
    _, *text = ast.unparse(node).splitlines()
    calls = [(name, arguments) for name, arguments in _calls(node) if name in names]
    parameters = tuple(a.arg for a in node.args.args)
    origins: list[Origin | None] = [vars(statement).get("origin") for statement in unparsed_statements(node.body)]
    written = vars(node).get("written")
    if written is not None:  # its lines are those of the lowered text
        places = written_lines(written)
        file = written.__code__.co_filename
        origins = [None if origin is None else (file, places[origin[1] - 1]) for origin in origins]
    lines = tuple(zip(text, origins, strict=True))
    return Listing(node.name, parameters, vars(node).get("origin"), lines, tuple(dict.fromkeys(calls)))


def _calls(node: ast.AST) -> Iterator[tuple[str, tuple[str, ...]]]:
    """List calls by name with the texts of their arguments, from top to bottom."""
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        yield node.func.id, tuple(map(ast.unparse, node.args))
    for part in ast.iter_child_nodes(node):
        yield from _calls(part)
