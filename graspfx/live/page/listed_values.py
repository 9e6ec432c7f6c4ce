"""List of a recorded scene's values for a page: gains first, with units and changes over time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from graspfx.recording.record import Recording

GAINS = {  # gains of eq. (4) by key
    "coupling.external.stiffness": ("external stiffness, kep", "N/m"),
    "coupling.internal.stiffness": ("internal stiffness, kip", "N/m"),
    "coupling.external.damping": ("external damping, ked", "N s/m"),
    "coupling.internal.damping": ("internal damping, kid", "N s/m"),
    "coupling.friction": ("friction", ""),
}
OBJECTS = {
    "mass": ("mass", "kg"),
    "density": ("density", "kg/m³"),
    "viscosity": ("viscosity", "N s/m"),
    "rotational_viscosity": ("rotational viscosity", "N m s/rad"),
}
UNITS = {"stiffness": "N/m", "damping": "N s/m", "squeeze": "m", "offset": "m"} | {
    name: unit for name, (_, unit) in OBJECTS.items()
}
LONGEST = 60  # longest text of a value
MOST = 60  # most values listed

Table = Mapping[str, Any]


def values_of(recording: Recording) -> list[dict[str, Any]]:
    """List values as tables of `key`, `label`, `unit` and `values`, which are pairs of start time [s] and text."""
    table = recording.header.scene_table
    rows = {key: (label, unit) for key, label, unit in _names(recording.layout.objects, table)}
    for change in recording.changes:
        rows.setdefault(change.key, (change.key, UNITS.get(change.key.rpartition(".")[2], "")))
    return [
        {"key": key, "label": label, "unit": unit, "values": _over_time(recording, key, table)}
        for key, (label, unit) in [*rows.items()][:MOST]
    ]


def _names(objects: Sequence[str], table: Table) -> Iterator[tuple[str, str, str]]:
    """List the keys that the scene sets, with labels and units."""
    for key, (label, unit) in GAINS.items():
        if value_at(table, key) is not None:
            yield key, label, unit
    own = table.get("object", ())
    is_one = isinstance(own, Mapping)
    for i, name in enumerate(objects):
        for part, (label, unit) in OBJECTS.items():
            key = f"object.{part}" if is_one or len(objects) == 1 else f"object.{i}.{part}"
            if value_at(table, key) is not None:
                yield key, label if len(objects) == 1 else f"{label} of {name}", unit


def _over_time(recording: Recording, key: str, table: Table) -> list[tuple[float, str]]:
    start = value_at(table, key)
    changes = [(change.tick * recording.period, text_of(change.value)) for change in recording.changes
               if change.key == key]  # fmt: skip
    return [(0.0, "–" if start is None else text_of(start)), *changes]


def value_at(table: Any, key: str) -> Any:
    """Find a value in nested tables and lists by its dotted key; None if there is none."""
    for part in key.split("."):
        if isinstance(table, list | tuple) and len(table) == 1 and not part.isdigit():
            table = table[0]
        if isinstance(table, Mapping) and part in table:
            table = table[part]
        elif isinstance(table, list | tuple) and part.isdigit() and int(part) < len(table):
            table = table[int(part)]
        else:
            return None
    return table


def text_of(value: Any) -> str:
    """Format a value briefly."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        return shorten(f"[{', '.join(map(text_of, value))}]")
    return shorten(str(value))


def shorten(text: str) -> str:
    """Shorten a text to fit into a cell."""
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."
