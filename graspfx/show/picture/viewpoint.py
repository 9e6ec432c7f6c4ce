"""From where a grasp in space is seen best."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspfx.show.picture.painter import Camera

FloatArray = NDArray[np.float64]

ELEVATIONS = (22.0, 35.0, 50.0)
FRONT = -60.0  # [degrees], the azimuth that is taken if none is better
ALONG_AN_AXIS = (45, 60, 75)  # [degrees] from there, where a box shows one of its faces edge on, or nearly


def best_view(contacts: FloatArray, out: FloatArray, extent: float) -> tuple[float, float]:
    """Find a view with most contacts on the near side and apart from each other; the usual corner if none is better.

    Args:
        contacts: points that are to be seen (n, 3) [m].
        out: directions away from the object there (n, 3).
        extent: size of what is drawn [m].

    Returns:
        Azimuth and elevation [degrees].
    """
    lengths = np.linalg.norm(out, axis=1)
    out = out[lengths > 0.0] / lengths[lengths > 0.0, None]
    best, angles = -np.inf, (FRONT, ELEVATIONS[0])
    for elevation in ELEVATIONS:
        for turn in range(0, 360, 15):
            azimuth = FRONT + turn
            if turn % 90 in ALONG_AN_AXIS:
                continue
            project = Camera(azimuth, elevation).project
            facing = project(out)[:, 2] if len(out) else np.zeros(1)
            flat = project(contacts)[:, :2] / extent
            apart = np.linalg.norm(flat[:, None] - flat, axis=2) + np.eye(len(flat))
            worth = (
                np.clip(facing + 0.35, 0.0, 0.6).sum() + 0.5 * np.clip(apart.min(axis=1, initial=0.2), 0.0, 0.2).sum()
            )
            worth -= 1e-3 * (min(turn, 360 - turn) / 15 + abs(elevation - ELEVATIONS[0]) / 15)
            if worth > best + 1e-9:
                best, angles = worth, (azimuth, elevation)
    return angles
