"""Warnings about a run: fingers that never touch, objects that are lost, contacts that chatter."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graspfx.cones.problem import SLIDE
from graspfx.coupling.fade import BAND

if TYPE_CHECKING:
    from graspfx.recording.record import Recording

FELL = 1e-3  # [m]: an object that is put down sinks less
MOST_TOUCHES = 10  # of one finger: a hand does not close as often in a run
FASTEST = 5.0  # [1/s]: nor as fast


def remarks(recording: Recording) -> list[str]:
    """Write a sentence for each warning; none for a run of attached contacts, or without a tick."""
    needs = {"gap", "touching", *(f"objects/{name}/position" for name in recording.layout.objects)}
    if not needs.isdisjoint(recording.layout.omitted) or recording.gap is None or not len(recording):
        return []
    return [*_shortfall(recording), *_untouched(recording, recording.gap), *_lost(recording), *_chatter(recording)]


def _shortfall(recording: Recording) -> Iterator[str]:
    """Free fingers that left the split where they could still touch again."""
    needed = recording.outcome.fade_needed
    if needed > 0.0:
        h1 = 1e-4 * math.ceil(1e4 * needed)
        short = _length(recording.outcome.fade_shortfall)
        yield (
            f"free fingers began to leave the split {short} too near for the forces of this run: "
            f"set coupling.fade = [{h1:.4g}, {h1 + BAND:.4g}]"
        )


def _untouched(recording: Recording, gap: NDArray[np.float64]) -> Iterator[str]:
    layout = recording.layout
    for i in np.flatnonzero(~recording.touching.any(axis=0)):
        name = layout.objects[layout.finger_objects[i]]
        yield f"{layout.fingers[i]} never touches {name}: {_length(gap[:, i].min())} away at the nearest"


def _lost(recording: Recording) -> Iterator[str]:
    """List objects that every finger leaves for good, and that slide out of the last ones or fall afterwards."""
    layout = recording.layout
    down = np.array(recording.header.scene_table.get("gravity") or [0.0] * layout.dimensions, dtype=float)
    down /= np.linalg.norm(down) or 1.0
    for number, name in enumerate(layout.objects):
        own = np.flatnonzero(np.array(layout.finger_objects) == number)
        ticks = np.flatnonzero(recording.touching[:, own].any(axis=1))
        if not ticks.size or ticks[-1] == len(recording) - 1:
            continue
        last = ticks[-1]
        left = own[recording.touching[last, own]]
        slid = recording.status is not None and bool((recording.status[last, left] == SLIDE).all())
        position = recording.objects[name].position[last:] @ down
        fell = float(np.nanmax(position) - position[0])
        remarks = ["slides out of the fingers"] if slid else []
        remarks += [f"falls by {_length(fell)}"] if fell > FELL else []
        if remarks:
            yield f"{name} {' and '.join(remarks)}: none touches it after {recording.time[last]:.4g} s"


def _chatter(recording: Recording) -> Iterator[str]:
    touching = recording.touching
    touches = (touching[1:] & ~touching[:-1]).sum(axis=0)
    often = np.flatnonzero(touches > max(MOST_TOUCHES, FASTEST * recording.end))
    if often.size:
        names = ", ".join(recording.layout.fingers[i] for i in often)
        verb = "touches and lets" if often.size == 1 else "touch and let"
        yield f"{names} {verb} go up to {touches.max()} times: contacts ring where stiffness and period are too large"


def _length(metres: float) -> str:
    return f"{metres:.3g} m" if metres >= 1.0 else f"{1e3 * metres:.3g} mm"
