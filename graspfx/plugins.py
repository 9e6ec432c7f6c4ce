"""Lookup of devices, hands, scenes and dynamics by the path of a file, a built-in name, or an entry point's name."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from hashlib import sha256
from importlib import import_module
from importlib.machinery import PathFinder
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from os import PathLike, fspath
from pathlib import Path
from types import ModuleType
from typing import Literal

from graspfx import installed
from graspfx.environment import require_file, resolved, to_path
from graspfx.errors import LONGEST_KEY, GraspFXError, InputError, UnknownNameError, closest

Group = Literal["devices", "hands", "scenes", "dynamics"]

SUFFIXES: dict[Group, tuple[str, ...]] = {
    "devices": (".py",),
    "hands": (".py",),
    "scenes": (".toml", ".py"),
    "dynamics": (".py",),
}
SINGULAR: dict[Group, str] = {"devices": "device", "hands": "hand", "scenes": "scene", "dynamics": "dynamics"}
BUILT_IN: dict[Group, dict[str, str]] = {  # groups without a folder of built-in plug-ins
    "hands": {},
    "dynamics": {
        "native": "graspfx.objects.native_dynamics",
        "bullet": "graspfx.objects.bullet",
        "mujoco": "graspfx.objects.mujoco",
    },
}


class PluginError(GraspFXError):
    """Exception in the code of a plug-in; the message names file and line, and `__cause__` is the exception."""


@dataclass(frozen=True)
class Plugin:
    """A plug-in, as the path of a file or the name of a module that may not be imported yet."""

    origin: str
    path: Path | None = None
    module: str = ""


def names(group: Group) -> dict[str, str]:
    """Return the names of a group, each with a description of its origin, without importing a plug-in."""
    return {name: " and ".join(plugin.origin for plugin in plugins) for name, plugins in sorted(_table(group).items())}


def find(group: Group, name: str | PathLike[str], folder: Path | None = None) -> Path:
    """Return the path of a plug-in's file; a relative path is relative to `folder` (default: the current folder).

    Raises:
        UnknownNameError: If no plug-in has this name.
        InputError: If the file does not exist, or several plug-ins have this name.
    """
    plugin = _plugin(group, name, folder)
    return plugin.path if plugin.path is not None else _module_file(group, plugin)


def source_of(group: Group, name: str) -> Path | None:
    """Return the path of a plug-in's file without importing a module; None if the file cannot be found in this way."""
    plugin, *_ = _table(group)[name]
    if plugin.path is not None:
        return plugin.path
    places: list[str] | None = None
    for last in plugin.module.split("."):
        spec = PathFinder.find_spec(last, places)
        if spec is None:
            return None
        places = list(spec.submodule_search_locations or ())
    return Path(spec.origin) if spec is not None and spec.has_location and spec.origin else None


def load(group: Group, name: str | PathLike[str], folder: Path | None = None) -> ModuleType:
    """Return the module for a name or path; the errors are those of `find`, and those that the module raises."""
    return _loaded(group, _plugin(group, name, folder))


def load_blaming(group: Group, name: str | PathLike[str], folder: Path | None = None) -> ModuleType:
    """Return the module as `load` does, but convert exceptions that the module raises to a PluginError."""
    plugin = _plugin(group, name, folder)
    with blaming(plugin.path or Path(plugin.module)):
        return _loaded(group, plugin)


def _loaded(group: Group, plugin: Plugin) -> ModuleType:
    if plugin.path is None or plugin.module:
        return import_module(plugin.module)
    if plugin.path.suffix != ".py":
        raise InputError(SINGULAR[group], str(plugin.path), "a Python file", "a TOML file cannot be imported")
    return _imported_file(plugin.path)


def is_file_name(text: str) -> bool:
    """Return whether a text is the path of a plug-in's file, by its suffix, and not the name of a plug-in."""
    return text.endswith((".py", ".toml"))


def shelf(group: Group) -> Path:
    """Return the folder of the built-in drivers or scenes: in the package, or beside the package in a checkout."""
    package = Path(__file__).parent
    inside = package / group
    return inside if inside.is_dir() else package.parent / group


@contextmanager
def blaming(path: Path) -> Iterator[None]:
    """Convert exceptions of the code in a file to a PluginError that names file and line; pass on GraspFX's own errors.

    All exceptions are converted, because a user's code may raise any of them.
    """
    try:
        yield
    except GraspFXError:
        raise
    except Exception as error:
        text = error.msg if isinstance(error, SyntaxError) else error
        raise blamed(path, error, f"{type(error).__name__}: {text}") from error


def blamed(path: Path, error: Exception, text: str) -> PluginError:
    """Return a PluginError with a text and the line of the file in which `error` was raised or passed on."""
    line = error.lineno if isinstance(error, SyntaxError) and error.filename == str(path) else None
    trace = error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == str(path):
            line = trace.tb_lineno
        trace = trace.tb_next
    place = shown_path(path) if line is None else f"{shown_path(path)}:{line}"
    return PluginError(f"{place}: {text}")


def shown_path(path: Path) -> str:
    """Return a path for messages; a path in the current folder is relative to this folder."""
    here = Path.cwd()
    return str(path.relative_to(here)) if path.is_relative_to(here) else str(path)


def _plugin(group: Group, name: str | PathLike[str], folder: Path | None) -> Plugin:
    if not isinstance(name, str | PathLike):
        raise InputError(SINGULAR[group], name, "a name or the path of a file")
    text = fspath(name)
    if is_file_name(text):
        path = resolved(SINGULAR[group], to_path(SINGULAR[group], text, folder=folder))
        if path.suffix not in SUFFIXES[group]:
            raise InputError(SINGULAR[group], text, f"a file that ends in {' or '.join(SUFFIXES[group])}")
        require_file(SINGULAR[group], text, path)
        return Plugin(origin=str(path), path=path)
    table = _table(group)
    if text not in table:
        raise UnknownNameError(SINGULAR[group], text, table, _file_hint(group, text, folder or Path()))
    first, *others = table[text]
    if others:
        origins = " and ".join(plugin.origin for plugin in table[text])
        raise InputError(
            SINGULAR[group], text, f"one plug-in of that name, but found {origins}", "give the path of a file instead"
        )
    return first


def _file_hint(group: Group, text: str, folder: Path) -> str:
    if len(text) > LONGEST_KEY or not text.isprintable():  # such a text cannot be the name of a file
        return f"give the path of a file that ends in {' or '.join(SUFFIXES[group])}"
    for suffix in SUFFIXES[group]:
        if text and (folder / f"{text}{suffix}").is_file():
            return f"there is a file {text}{suffix}: give its name with the suffix"
        close = closest(text, [path.stem for path in folder.glob(f"*{suffix}")]) if folder.is_dir() else None
        if close:
            return f"there is a file {close}{suffix}: give its name with the suffix"
    return f"give the path of a file that ends in {' or '.join(SUFFIXES[group])}"


_tables: ContextVar[dict[Group, dict[str, list[Plugin]]] | None] = ContextVar("kept", default=None)


@contextmanager
def unchanged() -> Iterator[None]:
    """Search installed packages and built-in files at most once per group while the block runs."""
    token = _tables.set({})
    try:
        yield
    finally:
        _tables.reset(token)


def _table(group: Group) -> dict[str, list[Plugin]]:
    tables = _tables.get()
    if tables is None:
        return _read_table(group)
    if group not in tables:
        tables[group] = _read_table(group)
    return tables[group]


def _read_table(group: Group) -> dict[str, list[Plugin]]:
    table: dict[str, list[Plugin]] = {}
    for name, plugin in (*_shelved(group), *_entry_points(group)):
        table.setdefault(name, []).append(plugin)
    return table


def _shelved(group: Group) -> Iterator[tuple[str, Plugin]]:
    if group in BUILT_IN:
        for name, module in BUILT_IN[group].items():
            yield name, Plugin(origin=f"GraspFX ({module})", module=module)
        return
    for path in sorted(shelf(group).iterdir()):
        if path.name.startswith(("_", ".")):
            continue
        if path.suffix in SUFFIXES[group]:
            module = f"graspfx.{group}.{path.stem}" if path.suffix == ".py" and path.stem.isidentifier() else ""
            yield path.stem.replace("_", "-"), Plugin(origin=f"GraspFX ({group}/{path.name})", path=path, module=module)
        elif (path / "__init__.py").is_file():  # a driver that is a package
            module, origin = f"graspfx.{group}.{path.name}", f"GraspFX ({group}/{path.name}/)"
            yield path.name.replace("_", "-"), Plugin(origin=origin, path=path / "__init__.py", module=module)


def _entry_points(group: Group) -> Iterator[tuple[str, Plugin]]:
    for point in installed.entry_points(f"graspfx.{group}"):
        yield point.name, Plugin(origin=f"{point.owner} ({point.module})", module=point.module)


def _module_file(group: Group, plugin: Plugin) -> Path:
    """Return the file of a module; for scenes, `package.name` may also refer to the file package/name.toml."""
    parent, _, stem = plugin.module.rpartition(".")
    spec = find_spec(plugin.module)
    if spec is not None and spec.origin is not None:
        return Path(spec.origin)
    package = find_spec(parent) if parent else None
    for folder in (package and package.submodule_search_locations) or ():
        table = Path(folder) / f"{stem}.toml"
        if group == "scenes" and table.is_file():
            return table
    raise InputError(SINGULAR[group], plugin.origin, f"a module or file {stem} in {parent or 'the top level'}")


def _imported_file(path: Path) -> ModuleType:
    """Return the module of a file, which is imported once and again after each change of the file."""
    stamp = path.stat()
    key = sha256(f"{path} {stamp.st_mtime_ns} {stamp.st_size}".encode()).hexdigest()[:12]
    name = f"graspfx_file_{path.stem.replace('-', '_')}_{key}"
    if name in sys.modules:
        return sys.modules[name]
    spec = spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise InputError("path", str(path), "a Python file")
    module = module_from_spec(spec)
    with ExitStack() as undo:
        sys.modules[name] = module  # set before the module runs, because dataclasses look up their module
        undo.callback(sys.modules.pop, name)
        spec.loader.exec_module(module)
        undo.pop_all()
    return module
