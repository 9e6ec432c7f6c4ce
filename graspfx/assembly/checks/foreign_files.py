"""Files that a scene may not name: those outside of its folder, and Python of a recording, since it is code."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from graspfx.errors import InputError, abbreviate
from graspfx.plugins import is_file_name
from graspfx.scene.source import Source
from graspfx.scene.tables.fields import Table
from graspfx.scene.tables.hands import MadeHand, Path
from graspfx.scene.tables.part_tables import Device, Object
from graspfx.scene.tables.scene_table import SceneTable
from graspfx.scene.tables.shapes import MeshShape

Location = tuple[str | int, ...]
Finding = tuple[Location, str]

CODE: tuple[tuple[type[Table], str], ...] = ((Device, "name"), (MadeHand, "kind"), (Object, "dynamics"))
DATA: tuple[tuple[type[Table], str], ...] = ((MeshShape, "mesh"), (Path, "file"))
REPLAY, COMMAND = "gx.replay(..., trust=True) in Python", "--trust on the command line, or GRASPFX_TRUST=1"
READ = f"the Python that a recording names runs only if you say so: read it, then {REPLAY}, {COMMAND}"
DO = "move it there, or say that you trust the scene:"


def trust_faults(scene: SceneTable, source: Source) -> list[Finding]:
    """Find every path that leads out of the folder of the scene's file, and take it out of the tables.

    Of a scene that stands in a recording every path of Python is one: the recording itself says where its folder is.

    What is left of the scene then names no such file, so that the checks that come later cannot import or read it.
    """
    return [] if source.is_trusted else list(_faults((), scene, source))


def _faults(at: Location, part: Any, source: Source) -> Iterator[Finding]:
    if isinstance(part, tuple):
        for k, each in enumerate(part):
            yield from _faults((*at, k), each, source)
    if not isinstance(part, Table):
        return
    for kind, name in (*CODE, *DATA):
        text = part.__dict__.get(name) if isinstance(part, kind) else None
        if not isinstance(text, str) or ((kind, name) in CODE and not is_file_name(text)):
            continue
        if (kind, name) in CODE and source.is_recorded and not source.is_of_user(text):
            del part.__dict__[name]
            yield (*at, name), f"{abbreviate(text)}, from {source.folder}; {READ}"
        elif _is_foreign(text, source):
            del part.__dict__[name]
            ways = f"{REPLAY}, {COMMAND}" if source.is_recorded else COMMAND
            yield (*at, name), f"outside of the scene's folder, {source.folder}: {abbreviate(text)}; {DO} {ways}"
    for name, value in list(part.__dict__.items()):
        yield from _faults((*at, name), value, source)


def _is_foreign(text: str, source: Source) -> bool:
    try:
        return not source.holds(text)
    except InputError:  # a path that leads nowhere: said by what would read it
        return False
