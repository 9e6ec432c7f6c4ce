"""Which points of a body can touch a plane: its features on a flat buffer, and where each is lowest."""

from __future__ import annotations

import math
from typing import Any

from graspfx.objects.integrators import ROTATION

# A feature is five numbers: its kind, then what follows.
BALL = 0  # x y z of its centre in the body, its radius: a corner has none
RIM = 1  # z of a circle about the body's z axis, its radius: the lowest point alone
NOTCH = 2  # x y z: a fixed point of a rim, which counts while the rim lies nearly flat
ELLIPSOID = 3  # semi-axes
FEATURE = 5  # entries of each

FLAT, TILTED = 1e-4, 1e-2  # sines of a rim's tilt between which its lowest point comes to bear
STEEP = 0.5  # sine of a rim's tilt above which its fixed points do not count
SIDES = 8  # fixed points of a rim, and directions in which a plane's contacts are chosen
MOST = SIDES + 1  # contacts with one plane


def lowest(S: Any, o: int, F: Any, f: int, nx: float, ny: float, nz: float) -> tuple[float, float, float, float]:
    """How far the feature at f bears on a plane of unit normal n, 0 to 1, and its lowest point from the centre, world.

    Ball c - r n; rim of radius r about z: c - r m_xy/|m_xy|; ellipsoid -A^2 m/|A m|, with m = R'n the normal in the
    body's axes.
    """
    R = o + ROTATION
    kind = int(F[f])
    x, y, z = F[f + 1], F[f + 2], F[f + 3]
    if kind == BALL:
        r = F[f + 4]
        return (
            1.0,
            S[R] * x + S[R + 1] * y + S[R + 2] * z - r * nx,
            S[R + 3] * x + S[R + 4] * y + S[R + 5] * z - r * ny,
            S[R + 6] * x + S[R + 7] * y + S[R + 8] * z - r * nz,
        )
    mx = S[R] * nx + S[R + 3] * ny + S[R + 6] * nz
    my = S[R + 1] * nx + S[R + 4] * ny + S[R + 7] * nz
    mz = S[R + 2] * nx + S[R + 5] * ny + S[R + 8] * nz
    tilt = math.sqrt(mx * mx + my * my)
    if (kind == RIM and tilt <= FLAT) or (kind == NOTCH and tilt > STEEP):
        return 0.0, 0.0, 0.0, 0.0
    bears = 1.0
    if kind == RIM:
        # a point that runs round the rim of a cylinder that lies flat must not bear there at once: it would never rest
        s = min(1.0, (tilt - FLAT) / (TILTED - FLAT))
        bears = s * s * (3.0 - 2.0 * s)
        r = F[f + 4] / tilt
        x, y = -r * mx, -r * my
    if kind == ELLIPSOID:
        a, b, c = x * mx, y * my, z * mz
        r = 1.0 / math.sqrt(a * a + b * b + c * c)
        x, y, z = -x * a * r, -y * b * r, -z * c * r
    return (
        bears,
        S[R] * x + S[R + 1] * y + S[R + 2] * z,
        S[R + 3] * x + S[R + 4] * y + S[R + 5] * z,
        S[R + 6] * x + S[R + 7] * y + S[R + 8] * z,
    )


def thin(F: Any, rows: int, stride: int, count: int, arm: int, gap: int, frame: int) -> int:
    """Of more than MOST points near one plane leaves the deepest and the outermost in SIDES directions of the plane.

    A row has its arm (3 entries) and its gap; `frame` holds the plane's normal and tangents. The rows that stay move to
    the front, in their order. Returns how many there are.
    """
    if count <= MOST:
        return count
    chosen = 0
    for i in range(count):
        if F[rows + i * stride + gap] < F[rows + chosen * stride + gap]:
            chosen = i
    F[rows + chosen * stride] = -1.0 - F[rows + chosen * stride]  # marked
    for side in range(SIDES):
        c, s = math.cos(2.0 * math.pi * side / SIDES), math.sin(2.0 * math.pi * side / SIDES)
        far = -math.inf
        for i in range(count):
            r = rows + i * stride + arm
            along = 0.0
            for a in range(3):
                along += F[r + a] * (c * F[frame + 3 + a] + s * F[frame + 6 + a])
            if along > far:
                far, chosen = along, i
        if F[rows + chosen * stride] >= 0.0:
            F[rows + chosen * stride] = -1.0 - F[rows + chosen * stride]
    left = 0
    for i in range(count):
        r = rows + i * stride
        if F[r] < 0.0:
            F[r] = -1.0 - F[r]
            for a in range(stride):
                F[rows + left * stride + a] = F[r + a]
            left += 1
    return left
