"""Content of the touch-screen page for planar scenes: a static description, and binary pictures of the state."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspfx.live.frame import STATES, Frame, Frames
from graspfx.live.scenery import Scenery, Solid
from graspfx.screen.touch_orders import Box
from graspfx.show.style import CONTACTS, EXTERNAL, INTERNAL

if TYPE_CHECKING:
    from graspfx.live.frame import Pose
    from graspfx.show.squeeze_and_push import Modes

FloatArray = NDArray[np.float64]

WIDE, HIGH = 2.1, 1.4  # half width and height of the touchable area, in extents of the scene
CAVEAT = "The force is shown here, not felt."
LEGEND = (
    ("squeeze (internal force)", INTERNAL, True),
    ("push (external force)", EXTERNAL, True),
    ("free", CONTACTS["free"], False),
    ("touches or sticks", CONTACTS["stick"], False),
    ("slides", CONTACTS["slide"], False),
    ("at its limit", CONTACTS["limit"], False),
)


def box_of(scenery: Scenery) -> Box:
    """Choose the touchable area: around the scene's middle, with room to move objects."""
    x, y = float(scenery.middle[0]), float(scenery.middle[1])
    half, high = WIDE * scenery.extent, HIGH * scenery.extent
    return Box(x - half, y - high, x + half, y + high)


def description(scenery: Scenery, title: str, fingers: Sequence[int], touchable: int, box: Box, fault: str = "") -> str:
    """Return the static content of the page, as JSON.

    Args:
        scenery: Scenery of the scene.
        title: Title of the page.
        fingers: Numbers of the fingers in the order of the page.
        touchable: Number of fingers that can be touched; they come first.
        box: Touchable area.
        fault: Fault of the run; empty for none.
    """
    objects = [each for each in scenery.solids if each.object is not None]
    most = "one finger" if touchable == 1 else f"up to {touchable} fingers"
    return json.dumps({
        "title": title,
        "hint": f"Touch with {most}. {CAVEAT}",
        "fault": fault,
        "box": box,
        "touchable": touchable,
        "fingers": [
            {"name": scenery.fingers[i], "colour": scenery.colours[i], "radius": float(scenery.radii[i])}
            for i in fingers
        ],
        "objects": [_shape(each) for each in objects],
        "obstacles": [_shape(each) for each in scenery.solids if each.object is None],
        "states": [CONTACTS[state] for state in STATES],
        "internal": INTERNAL,
        "external": EXTERNAL,
        "legend": LEGEND,
    })  # fmt: skip


def picture(frames: Frames, scenery: Scenery, fingers: Sequence[int]) -> bytes:
    """Encode the last frame: tick, time, squeeze, push, poses (x, y, angle), and seven numbers per finger.

    The seven numbers are position, internal force, external force and state. Missing forces are 0, other numbers NaN.
    """
    frame = frames[-1]
    squeeze, push = _modes(frames.modes)
    numbers = [float(frame.tick), frame.time, squeeze, push]
    for solid in scenery.solids:
        if solid.object is not None:
            numbers += _pose(frame.objects.get(solid.object))
    for i in fingers:
        numbers += [*_planar(frame.fingertips, i), *_planar(frame.internal, i), *_planar(frame.external, i)]
        numbers.append(float(STATES.index(frame.states[i])))
    return np.array(numbers).tobytes()


def fingertips(frame: Frame, dimensions: int) -> FloatArray:
    """Return the positions of the fingertips (n, d) [m]."""
    return frame.fingertips[:, :dimensions]


def _shape(solid: Solid) -> dict[str, Any]:
    """Return the outline of a slab: its front vertices, which come first."""
    outline = solid.vertices[: len(solid.vertices) // 2, :2]
    return {"name": solid.name, "colour": solid.colour, "loops": [outline.round(9).tolist()]}


def _pose(pose: Pose | None) -> list[float]:
    if pose is None:
        return [math.nan] * 3
    angle = 2.0 * math.atan2(float(pose.wxyz[3]), float(pose.wxyz[0]))
    return [float(pose.position[0]), float(pose.position[1]), angle]


def _planar(values: FloatArray | None, i: int) -> list[float]:
    return [0.0, 0.0] if values is None else values[i, :2].tolist()


def _modes(modes: Mapping[str, Modes]) -> tuple[float, float]:
    """Return the largest squeeze and the largest push of any object [N]; NaN if unknown."""
    values = [(float(each.mean_squeeze[-1]), float(np.linalg.norm(each.push[-1]))) for each in modes.values()]
    squeezes = [squeeze for squeeze, _ in values if math.isfinite(squeeze)]
    pushes = [push for _, push in values if math.isfinite(push)]
    return max(squeezes, default=math.nan), max(pushes, default=math.nan)
