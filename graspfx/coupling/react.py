"""The reaction of a sample: forces in world axes, and the wrench that they make on the object."""

from __future__ import annotations

from typing import Any

from graspfx.coupling import block as at
from graspfx.coupling.approach import LARGEST, LOST, pose
from graspfx.objects import integrators as body

FINE = 0


def react(S: Any) -> int:
    """Give world forces, their sum and moment about the object's centre: f_v = G f (eq. 2); LOST if not finite."""
    n = int(S[at.FINGERS])
    d = int(S[at.DIMENSIONS])
    x, R, _, _ = pose(S)
    where = at.CONTACT_WORLD if S[at.AT_CONTACT] != 0.0 else at.POSITION
    fx = fy = fz = mx = my = mz = 0.0
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        a, b, c = S[r + at.LOCAL], S[r + at.LOCAL + 1], S[r + at.LOCAL + 2]
        u, v, w = a, b, c
        if d > 1:
            u = S[R] * a + S[R + 1] * b + S[R + 2] * c
            v = S[R + 3] * a + S[R + 4] * b + S[R + 5] * c
            w = S[R + 6] * a + S[R + 7] * b + S[R + 8] * c
        S[r + at.FORCE], S[r + at.FORCE + 1], S[r + at.FORCE + 2] = u, v, w
        fx, fy, fz = fx + u, fy + v, fz + w
        if d > 1:
            px, py, pz = S[r + where] - S[x], S[r + where + 1] - S[x + 1], S[r + where + 2] - S[x + 2]
            mx += py * w - pz * v
            my += pz * u - px * w
            mz += px * v - py * u
        if S[at.COORDINATES] > 3.0:
            f, torsion = r + at.TWIST_AXIS, S[r + at.PATCH] * S[r + at.LOCAL + 3]
            a, b, c = torsion * S[f], torsion * S[f + 1], torsion * S[f + 2]
            u = S[R] * a + S[R + 1] * b + S[R + 2] * c
            v = S[R + 3] * a + S[R + 4] * b + S[R + 5] * c
            w = S[R + 6] * a + S[R + 7] * b + S[R + 8] * c
            S[r + at.MOMENT], S[r + at.MOMENT + 1], S[r + at.MOMENT + 2] = u, v, w
            mx, my, mz = mx + u, my + v, mz + w
    o = at.BODY + body.FORCE
    S[o], S[o + 1], S[o + 2] = fx, fy, fz
    o = at.BODY + body.MOMENT
    S[o], S[o + 1], S[o + 2] = mx, my, mz
    return FINE if abs(fx + fy + fz + mx + my + mz) <= LARGEST else LOST
