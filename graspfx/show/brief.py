"""Rows of the brief figure: how deep fingers stand in the surface, what squeezes the object, what pushes it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from graspfx.show.modes import Modes
from graspfx.show.panels import ALL, MM, Curve, Row, View, curve, pushes
from graspfx.show.strokes import PUSHES, SQUEEZE, Stroke
from graspfx.show.style import INK

HEIGHT = 1.1  # [inches]
DEPTH = Stroke(INK, SQUEEZE.width)


def brief_rows(columns: Sequence[View]) -> list[Row]:
    """List depth, squeeze and push of what is shown side by side, as far as the recordings say them."""
    with np.errstate(over="ignore", invalid="ignore"):
        forces = [view.force_modes for view in columns]
        pairs = list(zip(columns, forces, strict=True))
        along = pushes(forces)
        rows = [
            Row("depth [mm]", tuple(_depth(view) for view in columns), HEIGHT),
            Row("squeeze [N]", tuple(_squeeze(view, each) for view, each in pairs), HEIGHT),
            Row("push [N]", tuple(_pushes(view, each, along) for view, each in pairs), HEIGHT, signed=True),
        ]
    return [row for row in rows if any(row.panels)]


def _depth(view: View) -> tuple[Curve, ...]:
    """Plot how deep fingers stand in the surface, a free one not at all: their mean and range."""
    gap = view.recording.gap if view.has("gap") and view.has("touching") else None
    if gap is None or not view.fingers:
        return ()
    depth = MM * np.where(view.touching, -gap[:, view.fingers], 0.0)
    return (curve(ALL, depth.mean(axis=1), DEPTH, depth),)


def _squeeze(view: View, forces: Modes | None) -> tuple[Curve, ...]:
    if forces is None or len(view.fingers) < 2:
        return ()
    name = "internal force" if len(view.fingers) == 2 else "internal force, mean and range"
    return (curve(name, forces.mean_squeeze, SQUEEZE, forces.squeeze),)


def _pushes(view: View, forces: Modes | None, axes: Sequence[int]) -> tuple[Curve, ...]:
    if forces is None:
        return ()
    names = ["external force" + (f", {'xyz'[a]}" if view.dimensions > 1 else "") for a in axes]
    return tuple(
        curve(name, forces.push[:, a], PUSHES[a]) for name, a in zip(names, axes, strict=True) if a < view.dimensions
    )
