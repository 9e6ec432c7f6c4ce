"""Check of the columns that a scene asks to be recorded."""

from __future__ import annotations

from collections.abc import Iterator

from graspfx.errors import LONGEST_KEY, closest
from graspfx.loop.columns import Layout, columns_of
from graspfx.scene.tables.scene_table import SceneTable


def record_faults(scene: SceneTable) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Find names of columns that no recording of such fingers and objects has, whatever the coupling."""
    names = scene.record.columns
    if not names:
        return
    every = Layout(
        dimensions=scene.dimensions,
        fingers=scene.finger_names,
        objects=tuple(thing.name for thing in scene.object),
        finger_objects=(0,) * len(scene.finger),
        moments=True, slips=True, observed=True, controlled=True, limits=True, guarded=True, normals=True,
        torsion_axes=True,
        predicted=tuple(range(len(scene.object))),
    )  # fmt: skip
    for i, name in enumerate(names):
        if not columns_of(every, name):
            names_ = [*every.columns, *(column.name for column in every.derived)]
            close = closest(name, names_) if len(name) <= LONGEST_KEY else None
            hint = f"; did you mean {close!r}?" if close else f" (there are {', '.join(names_)})"
            yield ("record", "columns", i), f"expected the name of a column, given {name!r}{hint}"
