"""One force on the page: an arrow that is moved as fingertips are, and drawn anew only as its length changes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from graspfx.live.arrow_places import Arrow

SHAFT, HEAD, LONG = 0.009, 0.022, 0.05  # radius of a shaft, of a head, length of a head: shares of the extent
MOST_HEAD = 0.6  # of an arrow's length
ROUGH = 0.01  # of a length: a smaller change is not drawn


def rgb(colour: str) -> tuple[int, int, int]:
    """Read "#rrggbb" as three numbers up to 255."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def linear(colour: str) -> tuple[int, int, int]:
    """Read "#rrggbb" as light: viser takes the colours of arrows, unlike all others, as linear (IEC 61966-2-1)."""
    shares = [each / 255.0 for each in rgb(colour)]
    light = [each / 12.92 if each <= 0.04045 else ((each + 0.055) / 1.055) ** 2.4 for each in shares]
    red, green, blue = (round(255.0 * each) for each in light)
    return red, green, blue


class ForceArrow:
    """An arrow along its own z axis, in two pieces.

    A browser moves a node at once, and redraws one as it comes to it: of an arrow that moved by being drawn anew the
    force would trail behind its finger.

    Args:
        api: of the page's scene.
        name: of the node.
        colour: as "#rrggbb".
        extent: of the scene [m].
    """

    def __init__(self, api: Any, name: str, colour: str, extent: float) -> None:
        self._extent, self._length, self._pulls = extent, 0.0, False
        self._node = api.add_arrows(
            name, np.array([[[0.0, 0.0, -extent], [0.0, 0.0, 0.0]]]), linear(colour), shaft_radius=SHAFT * extent,
            head_radius=HEAD * extent, head_length=LONG * extent, visible=False,
        )  # fmt: skip

    def show(self, arrow: Arrow | None) -> None:
        """Draw a force; None for none."""
        if arrow is None:
            if self._node.visible:
                self._node.visible = False
            return
        if abs(arrow.length - self._length) > ROUGH * self._length or arrow.pulls != self._pulls:
            self._length, self._pulls = arrow.length, arrow.pulls
            ends = (0.0, arrow.length) if arrow.pulls else (-arrow.length, 0.0)
            self._node.points = np.array([[[0.0, 0.0, z] for z in ends]], dtype=np.float32)
            head = min(LONG * self._extent, MOST_HEAD * arrow.length)
            if head != self._node.head_length:
                self._node.head_length = head
        self._node.position, self._node.wxyz = arrow.at, from_z(arrow.along)
        if not self._node.visible:
            self._node.visible = True


def from_z(along: Any) -> tuple[float, float, float, float]:
    """Give the shortest turn from the z axis to a unit vector, as a quaternion w, x, y, z."""
    x, y, z = (float(each) for each in along)
    if z < -1.0 + 1e-9:
        return 0.0, 1.0, 0.0, 0.0
    w = float(np.sqrt(0.5 * (1.0 + z)))
    return w, -0.5 * y / w, 0.5 * x / w, 0.0
