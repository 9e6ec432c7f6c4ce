"""Disk cache of validated scenes, which can be run without repeated checks."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from hashlib import sha256
from typing import TYPE_CHECKING, Any, NamedTuple, cast

from graspfx import installed, plugins
from graspfx.compile import cache
from graspfx.compile.own_sources import source_stamps, stamps_in
from graspfx.environment import to_path
from graspfx.errors import Fault, InputError, SceneError
from graspfx.plugins import BUILT_IN
from graspfx.scene.keys import Key
from graspfx.scene.source import Source
from graspfx.scene.tables.reading import Readable, listed

if TYPE_CHECKING:
    from graspfx.scene.model import Scene


FORMAT = 4


class Place(NamedTuple):
    """Place of a scene in the cache.

    Attributes:
        key: Key in the cache: digest of all inputs of the scene's checks except its data files.
        source: Source of the scene with its overrides.
    """

    key: str
    source: Source


class KeptTable:
    """A table of a cached scene, with the fields of the validated table as attributes."""

    def __init__(self, fields: Mapping[str, Any], settings: Mapping[str, Any]) -> None:
        self.__dict__.update(fields)
        self._settings = settings

    @property
    def settings(self) -> dict[str, Any]:
        """Keys of the table that are not fields, with their values."""
        return dict(self._settings)


class KeptScene(Readable, KeptTable):
    """A scene from the disk cache, which `run` accepts in place of a `Scene`."""

    _stock = None

    def __init__(self, fields: Mapping[str, Any], source: Source, written: dict[str, Any]) -> None:
        super().__init__(fields, {})
        self.source, self._written = source, written

    def to_dict(self) -> dict[str, Any]:
        """Return the scene as nested tables, as `Scene.to_dict` does."""
        return self._written

    def error(self, faults: Iterable[tuple[Key, str]]) -> SceneError:
        """Return an error for faults that are found after the scene's checks."""
        return SceneError(self.source.name, [Fault(".".join(map(str, at)), text) for at, text in faults])


def place(name: str, overrides: Mapping[str, Any], preset: str | None = None) -> Place | None:
    """Compute the cache key of a scene in a TOML file; None for a scene that cannot be cached.

    The key depends on the text and path of the file, overrides, preset, trust, the version of Python, installed
    packages, and, as for Python's bytecode, on time and size of every source file of GraspFX and its drivers. Meshes
    and recorded paths are not part of the key: `cached` compares their content with that of the checked files.

    Raises:
        UnknownNameError, InputError: As for `load`.
    """
    path = plugins.find("scenes", name)
    installed_ = installed.distributions()
    if path.suffix != ".toml" or installed_ is None:
        return None
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):  # `load` reports the error
        return None
    shelf = list(stamps_in(str(plugins.shelf("devices"))))
    changes = preset, list(overrides.items())
    source = Source(plugins.shown_path(path), text, path, overrides, preset or "")
    parts = FORMAT, sys.version, str(path), text, changes, source.is_trusted, installed_, source_stamps(), shelf
    return Place(sha256(repr(parts).encode()).hexdigest(), source)


def cached(where: Place) -> tuple[Scene, list[str]] | None:
    """Return a scene and its notes from the cache; None if it is not cached, or one of its data files has changed."""
    content = cache.load(where.key)
    if content is None:
        return None
    entry = pickle.loads(content)
    if entry["files"] != digests(where.source, entry["names"]):
        return None
    source = replace(where.source, preset_values=entry["preset_values"])
    return cast("Scene", KeptScene(vars(entry["scene"]), source, entry["written"])), entry["notes"]


def keep(where: Place, scene: Scene, notes: list[str]) -> None:
    """Cache a scene that has been run, with its notes, if the scene is determined by its key and data files."""
    if scene.source.text != where.source.text or not is_self_contained(scene):
        return
    names = list(data_files(scene))
    files = digests(where.source, names)
    if files is None:
        return
    entry = {
        "scene": _kept(scene), "written": scene.to_dict(), "preset_values": dict(scene.source.preset_values),
        "notes": notes, "names": names, "files": files,
    }  # fmt: skip
    cache.store(where.key, pickle.dumps(entry, protocol=pickle.HIGHEST_PROTOCOL))


def is_self_contained(scene: Scene) -> bool:
    """Return whether a scene has only built-in dynamics, hands and drivers, and no hardware."""
    from graspfx.assembly.resolve import resolve

    folder = scene.source.folder
    devices = [*scene.device, *(finger.device for finger in scene.finger if not isinstance(finger.device, str))]
    return (
        all(thing.dynamics in BUILT_IN["dynamics"] for thing in scene.object)
        and not any(hand.form == "made" for hand in _hands(scene))
        and all(plugins.find("devices", each.name, folder).is_relative_to(plugins.shelf("devices")) for each in devices)
        and resolve(scene).simulated
    )


def _hands(scene: Scene) -> list[Any]:
    return [*scene.hand, *(finger.hand for finger in scene.finger if not isinstance(finger.hand, str | None))]


def data_files(scene: Scene) -> Iterator[str]:
    """Yield the names of a scene's data files: meshes and recorded paths."""
    for shape in (*(each.shape for each in scene.object), *(each.shape for each in scene.obstacle)):
        if shape is not None and shape.kind == "mesh" and shape.mesh is not None:
            yield shape.mesh
    for hand in _hands(scene):
        motions = () if hand.form == "made" else listed(hand.motion)
        yield from (motion.file for motion in motions if motion.kind == "path" and motion.file is not None)


def digests(source: Source, names: Iterable[str]) -> list[list[str]] | None:
    """Return path and digest of each named file of a scene; None if a file cannot be read."""
    try:
        paths = [to_path("file", name, folder=source.folder).resolve() for name in names]
        return [[str(path), sha256(path.read_bytes()).hexdigest()] for path in paths]
    except (OSError, RuntimeError, InputError):  # `load` reports the error
        return None


def _kept(value: Any) -> Any:
    """Replace tables by `KeptTable`, which can be loaded without importing the classes of tables."""
    if isinstance(value, tuple | list):
        return type(value)(map(_kept, value))
    if isinstance(value, dict):
        return {key: _kept(each) for key, each in value.items()}
    if not hasattr(type(value), "model_fields"):
        return value
    fields = {name: _kept(getattr(value, name)) for name in type(value).model_fields}
    if hasattr(value, "form"):
        fields["form"] = value.form
    return KeptTable(fields, _kept(getattr(value, "settings", {})))
