"""JSON messages of a stream: a hello message, then states; SI units, right-handed 3-D coordinates."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from graspfx import __version__
from graspfx.live.frame import Frame
from graspfx.live.guides import Guide
from graspfx.live.scenery import Scenery
from graspfx.show.picture.instant import lifted

if TYPE_CHECKING:
    from graspfx.scene.model import Scene

PROTOCOL = "graspfx-stream/1"  # increased with each incompatible change
UNITS = {"length": "m", "force": "N", "time": "s"}


def hello_message(
    scene: Scene, scenery: Scenery, guides: Sequence[Guide], *, rate: float, farthest: float, closest: float,
    run: int,
) -> str:  # fmt: skip
    """Return the hello message: names, frames and units, and the guides that clients may move.

    Args:
        scene: Running scene.
        scenery: Scenery of the scene.
        guides: Guides that clients may move; empty for none.
        rate: Highest rate of states [Hz].
        farthest: Largest component of an offset [m].
        closest: Largest absolute squeeze [m].
        run: Number of the run in the stream.
    """
    table = scene.to_dict()
    return _json({
        "type": "hello",
        "protocol": PROTOCOL,
        "version": __version__,
        "title": scene.title,
        "run": run,
        "dimensions": scene.dimensions,
        "period": scene.period,
        "rate": rate,
        "units": UNITS,
        "handedness": "right",
        "up": "z" if scenery.up[2] else "y",
        "fingers": [
            {"name": name, "object": scene.object[own].name, "colour": colour, "radius": float(radius)}
            for name, own, colour, radius in zip(
                scene.finger_names, scene.finger_objects, scenery.colours, scenery.radii, strict=True
            )
        ],
        "objects": [
            {"name": each.name, "shape": _shape(table, "object", i)} for i, each in enumerate(scene.object)
        ],
        "obstacles": [
            {"name": each.name, "shape": _shape(table, "obstacle", i)} for i, each in enumerate(scene.obstacle)
        ],
        "guides": [
            {"name": each.name, "fingers": list(each.fingers), "position": _triple(lifted(each.position[None], 3)[0]),
             "squeezes": each.place is None}
            for each in guides
        ],
        "farthest": farthest,
        "closest": closest,
    })  # fmt: skip


def state_message(frame: Frame, number: int, run: int, state: str, fault: str) -> str:
    """Return a state message.

    Args:
        frame: Frame of a row.
        number: Number of the state.
        run: Number of the run in the stream.
        state: "running", "paused" or "ended".
        fault: Fault of the run; empty for none.
    """
    missing = [None] * len(frame.states)
    forces, internal, external = (
        missing if each is None else each for each in (frame.force, frame.internal, frame.external)
    )
    return _json({
        "type": "state",
        "number": number,
        "run": run,
        "tick": frame.tick,
        "time": frame.time,
        "state": state,
        "fault": fault,
        "objects": [
            {"name": name, "position": _triple(pose.position), "orientation": _xyzw(pose.wxyz)}
            for name, pose in frame.objects.items()
        ],
        "fingers": [
            {
                "position": _triple(frame.fingertips[i]), "contact": contact,
                "contact_position": _triple(frame.contact_position[i]), "force": _triple(forces[i]),
                "internal": _triple(internal[i]), "external": _triple(external[i]),
            }
            for i, contact in enumerate(frame.states)
        ],
    })  # fmt: skip


def _json(table: dict[str, Any]) -> str:
    return json.dumps(table, separators=(",", ":"), allow_nan=False)


def _triple(vector: Any) -> list[float] | None:
    """Convert a vector to a list; None if it is missing or not finite."""
    if vector is None:
        return None
    numbers = [float(each) for each in vector]
    return numbers if all(map(math.isfinite, numbers)) else None


def _xyzw(wxyz: Any) -> list[float] | None:
    w, x, y, z = (float(each) for each in wxyz)
    return [x, y, z, w] if all(map(math.isfinite, (w, x, y, z))) else None


def _shape(table: dict[str, Any], kind: str, number: int) -> Any:
    """Return a shape as in the scene; None for a point."""
    entries = table.get(kind)
    entry = entries if isinstance(entries, dict) else entries[number] if entries else {}
    return entry.get("shape")
