"""The modules of GraspFX with their imports, wherever a statement stands, and the map of rooms that follows from them.

`python -m tests.support.rooms` prints the map: docs/development/map.md.
"""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Collection, Iterator, Mapping
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGE = "graspfx"
SHELF = "graspfx.devices"

Graph = Mapping[str, Collection[str]]


@cache
def files() -> Mapping[str, Path]:
    """Return every module of the package and of the shelf of devices, by its dotted name."""
    found = {}
    for folder, under in ((PACKAGE, PACKAGE), ("devices", SHELF)):
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(ROOT / folder).with_suffix("").parts
            found[".".join((under, *(parts[:-1] if parts[-1] == "__init__" else parts)))] = path
    return found


@cache
def upward() -> frozenset[tuple[str, str]]:
    """Return the imports that pyproject.toml allows against the direction, as pairs of modules: the ways up."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"]
    pairs = (edge.split(" -> ") for each in contracts if each["id"] == "rooms" for edge in each["ignore_imports"])
    return frozenset((source, target) for source, target in pairs if source != PACKAGE)


@cache
def imports() -> Graph:
    """Return what each module imports: at its top, in its functions, and for type checkers alone.

    A package that is entered on the way to a module counts as imported too, unless the importing module is inside of
    it. The ways up are left out, and so is the package's own file, which lists the public names of every room for type
    checkers and loads them by name.
    """
    graph = {name: frozenset(_imported(name, ast.parse(path.read_text("utf-8")))) for name, path in files().items()}
    return graph | {PACKAGE: frozenset()}


def _imported(module: str, tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        named: list[str] = []
        if isinstance(node, ast.Import):
            named = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            members = [f"{node.module}.{alias.name}" for alias in node.names]
            named = [member if member in files() else node.module for member in members]
        for name in named:
            if (module, name) in upward():
                continue
            parts = name.split(".")
            ways = (".".join(parts[:k]) for k in range(2, len(parts) + 1))
            yield from (
                way for way in ways if way in files() and (way == name or not f"{module}.".startswith(f"{way}."))
            )


def cycles(graph: Graph) -> list[list[str]]:
    """Return the groups of nodes that lead to one another."""
    reach = {node: _reached(graph, node) for node in graph}
    groups = {frozenset(b for b in reach[a] if a in reach[b]) for a in graph if a in reach[a]}
    return sorted(sorted(group) for group in groups)


def _reached(graph: Graph, start: str) -> set[str]:
    found: set[str] = set()
    ways = [start]
    while ways:
        for node in graph.get(ways.pop(), ()):
            if node not in found:
                found.add(node)
                ways.append(node)
    return found


def room_of(module: str, depth: int = 1) -> str:
    """Return the room in which a module stands, or the module itself where it stands in none."""
    parts = module.split(".")
    if module.startswith(SHELF):
        return "devices"
    folders = parts[1:] if files()[module].name == "__init__.py" else parts[1:-1]
    return "/".join(folders[:depth]) or parts[-1]


def rooms(depth: int = 1) -> Graph:
    """Return which room imports which."""
    graph: dict[str, set[str]] = {}
    for module, others in imports().items():
        if module == PACKAGE:
            continue
        room = room_of(module, depth)
        graph.setdefault(room, set()).update(room_of(other, depth) for other in others if other != PACKAGE)
        graph[room].discard(room)
    return graph


def direct(graph: Graph) -> Graph:
    """Return a graph without the ways that lead over another node too."""
    reach = {node: _reached(graph, node) for node in graph}
    return {a: {b for b in to if not any(b in reach[c] for c in to if c != b)} for a, to in graph.items()}


def in_order(graph: Graph) -> list[str]:
    """Return the nodes of a graph without cycles from top to bottom, each as far down as it can stand."""
    heights: dict[str, int] = {}

    def height(node: str) -> int:
        if node not in heights:
            heights[node] = 1 + max((height(other) for other in graph[node]), default=-1)
        return heights[node]

    return sorted(graph, key=lambda node: (-height(node), node))


def subject(room: str) -> str:
    """Return the first line of what a room says of itself."""
    module = "devices" if room == "devices" else f"{PACKAGE}.{room.replace('/', '.')}"
    path = ROOT / "devices" / "__init__.py" if room == "devices" else files()[module]
    return (ast.get_docstring(ast.parse(path.read_text("utf-8"))) or "").partition("\n")[0]


def page() -> str:
    """Return the map as a page."""
    graph = rooms()
    order = in_order(graph)
    arrows = [f"    {a.strip('_')} --> {b}" for a in order for b in order if b in direct(graph)[a]]
    whole = rooms(9)
    inner = {room: [each for each in sorted(whole) if each.startswith(f"{room}/")] for room in order}
    lines = []
    for room in order:
        lines.append(f"| **{room}** | {subject(room)} | {_listed(graph[room], order)} |")
        lines += [f"| {each} | {subject(each)} | |" for each in inner[room]]
    return "\n".join([HEAD, *arrows, MIDDLE, *lines, ""])


def _listed(names: Collection[str], order: list[str]) -> str:
    return ", ".join(name for name in order if name in names)


HEAD = """# Map of packages

`make map` draws this map from the import statements, and a test compares it with the code. An arrow points from a
package to a package that it imports; arrows that follow from others are omitted. All arrows point down, and no two
files import one another, not even in a function or for type checkers only.

```mermaid
flowchart TD"""

MIDDLE = """```

A method may import a function of a package above its own. pyproject.toml lists each of these imports
(`ignore_imports` of the contract `rooms`), and they are not drawn here.
Drivers are in `devices/`, outside of the framework, and import `graspfx.protocols` only.

| package | subject | imports |
|---|---|---|"""


if __name__ == "__main__":
    print(page(), end="")
