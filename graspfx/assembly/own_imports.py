"""Imports of a Python file from its own folder or package, as its statements have them; nothing is run."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

PACKAGE = "__init__.py"
SHARED = ("site-packages", "dist-packages")  # folders of everybody's packages, which are nobody's own
OURS = Path(__file__).resolve().parents[1]


def python_files(path: Path) -> list[Path]:
    """List a file, and of a Python file what it imports from its own folder or package, and what that imports, ...

    Statements `import` and `from ... import` count, wherever they stand. What is imported by other means or from other
    folders, extension modules, and GraspFX itself are left out; so is what a file imports that is no Python.
    """
    files: dict[Path, None] = {}
    left = [path]
    while left:
        file = left.pop()
        if file in files:
            continue
        files[file] = None
        if file.suffix == ".py":
            left += [each.resolve() for each in _imports(file) if not each.resolve().is_relative_to(OURS)]
    return list(files)


def _imports(path: Path) -> Iterator[Path]:
    try:
        tree = ast.parse(path.read_bytes())
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):  # whoever runs it says so
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                for root in _roots(path, alias.name):
                    yield from _modules(root, alias.name)
        elif isinstance(node, ast.ImportFrom):
            module = node.module or ""
            roots = [path.parents[node.level - 1]] if 0 < node.level <= len(path.parents) else _roots(path, module)
            for root in roots:
                for alias in node.names:
                    yield from _modules(root, f"{module}.{alias.name}".strip("."), node.level > 0)


def _roots(path: Path, module: str) -> Iterator[Path]:
    """List the folders in which a name at the top level is looked for: the file's own, and that of its package."""
    folder = path.parent
    if folder.name not in SHARED:
        yield folder
    while (folder / PACKAGE).is_file() and folder != folder.parent:
        name, folder = folder.name, folder.parent
        if not (folder / PACKAGE).is_file() and module.partition(".")[0] == name:
            yield folder


def _modules(root: Path, name: str, is_inside: bool = False) -> Iterator[Path]:
    """List the files that an import of a dotted name runs, of those that are there."""
    if is_inside:
        yield from filter(Path.is_file, [root / PACKAGE])
    place = root
    for part in name.split("."):
        place = place / part
        yield from filter(Path.is_file, [place.with_name(f"{part}.py"), place / PACKAGE])
