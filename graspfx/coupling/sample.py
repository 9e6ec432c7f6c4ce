"""One whole sample: contacts, split, eq. (4), cones, reaction."""

from __future__ import annotations

from typing import Any

from graspfx.coupling import block as at
from graspfx.coupling.approach import AGAIN, LARGEST, LOST, approach, pose, refactor, turn_axes
from graspfx.coupling.gains import fill_gains
from graspfx.coupling.law import push
from graspfx.coupling.projection import attached, unilateral
from graspfx.coupling.rays import press
from graspfx.coupling.slip import rub
from graspfx.objects import kernels as body

FINE = 0


def resplit(S: Any) -> None:
    """The split, if the gains need it, and the matrices of gains that are no numbers, where they have changed."""
    if S[at.MIXED] != 0.0:
        turn_axes(S)
    if S[at.EQUAL] == 0.0:
        refactor(S)
    if S[at.DENSE] != 0.0:
        fill_gains(S)


def respond(S: Any, again: bool) -> int:
    """Forces on the object and its wrench. AGAIN, where `again` allows it, asks for the split anew."""
    if S[at.ATTACHED] != 0.0:
        fault = attached(S)
    elif S[at.FRICTION] != 0.0:
        fault = rub(S)
    elif S[at.RAYS] != 0.0:
        fault = press(S)
    else:
        fault = unilateral(S, again)
    if fault == FINE:
        fault = react(S)
        if S[at.FADE] != 0.0 and S[at.EQUAL] == 0.0:
            check_fade(S)
        if S[at.TURNS] != 0.0 and S[at.EQUAL] == 0.0 and S[at.BLENDED] != 0.0:
            S[at.IN_BAND] += 1.0
    return fault


def sample(S: Any) -> int:
    """Motion in, forces and wrench out; returns FINE, or why every force is zero."""
    fault = approach(S)
    passes = int(S[at.FINGERS])  # at worst the fingers lose their anchors one after another
    if fault == FINE:
        resplit(S)
        fault = respond(S, True)
    while fault == AGAIN:
        resplit(S)
        passes -= 1
        fault = respond(S, passes > 0)
    if fault != FINE:
        let_go(S)
    return fault


def react(S: Any) -> int:
    """Forces in world axes, their sum and moment about the object's centre: f_v = G f (eq. 2); LOST if not finite."""
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


def let_go(S: Any) -> None:
    """Zero force at every finger and on the object."""
    for i in range(int(S[at.FINGERS])):
        r = at.ROW + i * at.STRIDE
        S[r + at.TOUCHING] = 0.0
        S[r + at.STATUS] = 0.0
        for a in range(3):
            S[r + at.FORCE + a] = 0.0
            S[r + at.MOMENT + a] = 0.0
        for a in range(4):
            S[r + at.LOCAL + a] = 0.0
            S[r + at.RETAINED + a] = 0.0
    for a in range(3):
        S[at.BODY + body.FORCE + a] = 0.0
        S[at.BODY + body.MOMENT + a] = 0.0


def check_fade(S: Any) -> None:
    """Keep the largest shortfall of NEAR: below 1/2 |1/kep - 1/kip| sum |f| a fading finger can touch again."""
    kep, kip, release = S[at.EXTERNAL_STIFFNESS], S[at.INTERNAL_STIFFNESS], S[at.RELEASE]
    if S[at.DENSE] == 0.0:
        if kep <= 0.0 or kip <= 0.0:
            return
        release = 0.5 * abs(1.0 / kep - 1.0 / kip)
    total = 0.0
    for i in range(int(S[at.FINGERS])):
        total += push(S, i, int(S[at.DIMENSIONS]))
    S[at.SHORTFALL] = max(S[at.SHORTFALL], release * total - S[at.NEAR])
