"""Disk cache of scenes that Python makes: the file runs every time, and what it makes is checked once."""

from __future__ import annotations

import json
import pickle
import sys
from collections.abc import Mapping
from hashlib import sha256
from typing import Any

import numpy as np

from graspfx import installed, plugins
from graspfx.assembly.scene_cache import FORMAT, PLAIN, data_files, digests, is_self_contained
from graspfx.compile import cache
from graspfx.compile.own_sources import source_stamps, stamps_in
from graspfx.scene.model import Scene
from graspfx.scene.source import Source
from graspfx.scene.table_memory import CheckedTable

SEPARATOR = b"\n"  # after the names and digests of data files, before the scene


class SceneMemory:
    """A memory of scenes and of the notes on them, by all that their checks depend on.

    The key holds the whole table with its numbers to the last bit, where relative paths start, what is installed, and
    time and size of every source file of GraspFX and of the shelf of devices; data files that the scene names are
    compared by their content. A scene that names code is not kept.
    """

    def __init__(self) -> None:
        shelf = list(stamps_in(str(plugins.shelf("devices"))))
        distributions = installed.distributions()
        self._about = FORMAT, sys.version, distributions, source_stamps(), shelf
        self._usable = distributions is not None

    def recall(self, table: Mapping[str, Any], source: Source) -> CheckedTable | None:
        """Recall what the checks made of a table; None if they have to be made."""
        content = self._load("scene", table, source)
        return None if content is None else CheckedTable(*pickle.loads(content))

    def keep(self, table: Mapping[str, Any], source: Source, scene: Scene) -> None:
        """Keep a scene that has just passed its checks, if nothing but its table and data files tells what it is."""
        if self._usable and is_self_contained(scene):
            parts = vars(scene), scene.model_fields_set, scene.to_dict()
            self._store("scene", table, source, scene, pickle.dumps(parts, protocol=pickle.HIGHEST_PROTOCOL))

    def notes(self, scene: Scene) -> list[str] | None:
        """Recall the notes on a scene; None if nobody has looked."""
        content = self._load("notes", scene.to_dict(), scene.source)
        return None if content is None else [str(note) for note in json.loads(content)]

    def keep_notes(self, scene: Scene, notes: list[str]) -> None:
        """Keep the notes on a scene."""
        if self._usable and is_self_contained(scene):
            self._store("notes", scene.to_dict(), scene.source, scene, json.dumps(notes).encode())

    def _load(self, kind: str, table: Mapping[str, Any], source: Source) -> bytes | None:
        key = self._key(kind, table, source)
        entry = cache.load(key) if key else None
        if entry is None:
            return None
        head, _, content = entry.partition(SEPARATOR)
        names, files = json.loads(head)
        return content if files == digests(source, names) else None

    def _store(self, kind: str, table: Mapping[str, Any], source: Source, scene: Scene, content: bytes) -> None:
        key, names = self._key(kind, table, source), list(data_files(scene))
        files = digests(source, names)
        if key and files is not None:
            cache.store(key, json.dumps([names, files]).encode() + SEPARATOR + content)

    def _key(self, kind: str, table: Mapping[str, Any], source: Source) -> str:
        """Digest all that the answer depends on; an empty text for a table with other than plain values."""
        if not self._usable:
            return ""
        try:
            values = _canonical(table)
        except TypeError:
            return ""
        origin = (
            str(source.path),
            source.name,
            source.is_trusted,
            source.is_recorded,
            _canonical(source.overrides),
            source.preset,
        )
        return sha256(repr((kind, self._about, origin, values)).encode()).hexdigest()


def _canonical(value: Any) -> Any:
    """Write nested values so that their `repr` tells them apart, kind by kind and to the last bit.

    Raises:
        TypeError: a value of another kind than numbers, texts, lists, tables and arrays of numbers.
    """
    if type(value) in PLAIN:
        return value
    if isinstance(value, list | tuple):
        return type(value)(map(_canonical, value)) if type(value) in (list, tuple) else _refuse(value)
    if isinstance(value, dict):
        return [(_canonical(key), _canonical(each)) for key, each in value.items()]
    if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "biuf":
        return "array", value.dtype.str, value.shape, value.tobytes()
    return _refuse(value)


def _refuse(value: Any) -> Any:
    raise TypeError(type(value).__name__)
