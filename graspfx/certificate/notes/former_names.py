"""Settings of devices that a scene calls by their former names."""

from __future__ import annotations

from graspfx.build.wiring import table_at
from graspfx.scene.keys import dotted
from graspfx.scene.model import Scene


def former_notes(scene: Scene) -> list[str]:
    """Write a sentence for each device table with such settings."""
    tables = dict(table_at(scene, i) for i in range(len(scene.finger)))
    return [
        f"{dotted((*at, old))} is called {now!r} now: the old name is still read"
        for at, table in tables.items()
        for old, now in table.former.items()
    ]
