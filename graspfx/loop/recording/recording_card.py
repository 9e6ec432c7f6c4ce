"""A recording on a card, and the motion of one of its objects."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from graspfx.card import Card, counted, listed

MOST = 3  # faults, or changes
CALLS = (
    ".summary(), .plot(), .picture(time), .to_xarray(), .to_frame(), .to_csv(path), .save(path)\n"
    ".time, .finger_position, .finger_force, .internal_force, .external_force, .touching, .objects[name], ..."
)
MEASURES = (
    ("position", "m"),
    ("velocity", "m/s"),
    ("orientation", "rad or x y z w"),
    ("angular_velocity", "rad/s"),
    ("wrench", "N, N m"),
    ("law", "0 Coulomb's, 1 associated"),
    ("residual", "N"),
)


def recording_card(history: Any) -> Card:
    """Write the card of a recording."""
    header = history.header
    name = header.scene or "a scene"
    return Card(f"Recording of {name}{f': {header.title}' if header.title else ''}", [*_rows(history)], CALLS)


def _rows(history: Any) -> Iterator[tuple[str, str]]:
    header, layout, outcome, ticks = history.header, history.layout, history.outcome, len(history)
    engine = f", {outcome.engine}" if outcome.engine else ""
    broken = "" if outcome.complete else "; NOT complete: the run broke off, goes on or was killed"
    seconds = f"{history.end:g} s"
    fewer = f", a row every {header.every}" if header.every > 1 else ""
    yield "time", f"{seconds}, {counted(history.ticks, 'tick')} of {1e3 * history.period:g} ms{fewer}{engine}{broken}"
    yield "left out", listed(layout.omitted)
    yield "set", listed(f"{key} = {value!r}" for key, value in header.overrides.items())
    devices = "simulated" if layout.simulated else "real"
    space = counted(layout.dimensions, "dimension")
    yield "fingers", f"{len(layout.fingers)} in {space}, {devices}: {listed(layout.fingers)}"
    if ticks and not {"touching", "finger_force"} & set(layout.omitted):
        touching = 100.0 * history.touching.mean(axis=0)
        yield "touching", listed(f"{each:.0f} %" for each in touching) + " of the time"
        peak = np.linalg.norm(history.finger_force, axis=2).max(axis=0)
        yield "peak force", listed(f"{each:.3g}" for each in peak) + " N"
    yield "objects", listed(layout.objects)
    yield "energies", "booked by mode: .energy[name]" if layout.observed else ""
    yield "changes", _some(history.changes)
    yield "faults", _some(history.faults) or "none"
    yield "made", " by ".join(each for each in (header.created, _maker(header.versions)) if each)


def _maker(versions: Any) -> str:
    return f"GraspFX {versions['graspfx']}" if "graspfx" in versions else ""


def _some(things: Any) -> str:
    lines = [str(each) for each in things[:MOST]]
    return "\n".join([*lines, *([f"and {len(things) - MOST} more"] if len(things) > MOST else [])])


def motion_card(motion: Any) -> Card:
    """Write the card of an object's motion."""
    rows = []
    for name, unit in MEASURES:
        values = getattr(motion, name)
        if values is not None:
            rows.append((name, f"{values.shape} [{unit}]{_ends(values)}"))
    return Card(f"Motion of an object over {counted(len(motion.position), 'tick')}", rows)


def _ends(values: np.ndarray[Any, Any]) -> str:
    if not len(values):
        return ""
    first, last = (np.array2string(np.round(end, 6) + 0.0, separator=", ") for end in (values[0], values[-1]))
    return f", {first} at first, {last} at last"
