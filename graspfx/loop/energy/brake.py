"""Damping where a grasp leaks energy: the least, in the mode that leaks, within what a finger may exert."""

from __future__ import annotations

import math
from typing import Any

from graspfx.coupling import block as at
from graspfx.coupling.limit import limit_again
from graspfx.coupling.react import react
from graspfx.loop.energy import ledger
from graspfx.loop.energy.leak import balance
from graspfx.loop.energy.leak import brake as least_damping
from graspfx.loop.energy.ledger import modes
from graspfx.objects import integrators as body

ROUNDING = 1e-12  # of the largest energy so far: a smaller debt is none
DAMPING = ledger.OUT + 24  # of internal, translation, rotation, as added [N s/m]


def control(S: Any, B: Any, T: float) -> bool:
    """Adds to the forces of this sample what pays the debt of each mode in one more step like the last.

    Damping a W Q_j d/T (`leak.brake`) with a at most m/(2 T), m the least mass that a step of any mode
    moves: held for a sample, damping of that size takes the most energy that it can, and of twice that size none.
    Then each finger's force is brought back into its cone and within the limits.
    Returns whether any force has changed.
    """
    for j in range(3):
        B[DAMPING + j] = 0.0
    least = ROUNDING * B[ledger.SCALE]
    owes = False
    for j in range(3):
        owes = owes or balance(B, ledger.LEDGER, j) < -least
    if not owes or B[ledger.STARTED] == 0.0:
        return False
    n = int(S[at.FINGERS])
    width = 4 if S[at.COORDINATES] > 3.0 else 3
    found = least_damping(
        B, ledger.LEDGER, ledger.ROWS, ledger.STRIDE, n, width, ledger.BRAKE, ledger.STEP, ledger.WEIGHT,
        modes(n), int(S[at.SHIFTS]), int(B[ledger.COUNT]), ledger.ROW, T, bound(S, T, B[ledger.LIGHT]),
    )  # fmt: skip
    B[DAMPING], B[DAMPING + 1], B[DAMPING + 2] = found
    for i in range(n):
        push(S, B, i)
    if S[at.LIMITS] != 0.0:
        limit_again(S, 0)  # type: ignore[call-arg] # a block for its record
    react(S, 0)  # type: ignore[call-arg] # a block for its record
    return True


def bound(S: Any, T: float, light: float) -> float:
    """m/(2 T) [N s/m], 1/m = max w_i/m_i + sum w_i/m_v + sum w_i |r_i|^2/I: no mode is moved more easily."""
    n, d, o = int(S[at.FINGERS]), int(S[at.DIMENSIONS]), at.BODY
    total = squares = 0.0
    for i in range(n):
        r = at.ROW + i * at.STRIDE
        w = S[r + at.WEIGHT]
        total += w
        for a in range(3):
            arm = S[r + at.POSITION + a] - S[o + body.POSITION + a]
            squares += w * arm * arm
    if S[at.SHIFTS] > 0.0:
        light += total / S[o + body.MASS]
    if S[at.TURNS] > 0.0:
        J = o + body.INERTIA
        least = S[J + 2] if d == 2 else min(S[J], S[J + 1], S[J + 2])
        light += squares / least
    return float(0.5 / (T * light)) if light > 0.0 else 0.0


def push(S: Any, B: Any, i: int) -> None:
    """Adds the brake of finger i to its force, inside its cone; BRAKE becomes what was added."""
    s, b = at.ROW + i * at.STRIDE, ledger.ROWS + i * ledger.STRIDE + ledger.BRAKE
    f, m = s + at.LOCAL, s + at.NORMAL
    if S[at.ATTACHED] != 0.0:
        for a in range(4):
            S[f + a] += B[b + a]
        return
    if S[s + at.TOUCHING] == 0.0:
        for a in range(4):
            B[b + a] = 0.0
        return
    added = S[m] * B[b] + S[m + 1] * B[b + 1] + S[m + 2] * B[b + 2]
    pushed = S[m] * S[f] + S[m + 1] * S[f + 1] + S[m + 2] * S[f + 2]
    normal = max(pushed + added, 0.0)
    rubs = S[at.STICK] != 0.0 or S[s + at.COEFFICIENT] > 0.0
    x = S[f] - pushed * S[m]
    y = S[f + 1] - pushed * S[m + 1]
    z = S[f + 2] - pushed * S[m + 2]
    t = S[f + 3]
    if rubs:
        x += B[b] - added * S[m]
        y += B[b + 1] - added * S[m + 1]
        z += B[b + 2] - added * S[m + 2]
        t += B[b + 3]
        limit = S[s + at.COEFFICIENT] * normal
        size = math.sqrt(x * x + y * y + z * z + t * t)
        scale = 1.0
        if normal == 0.0:
            scale = 0.0
        elif S[at.STICK] == 0.0 and size > limit:
            scale = limit / size
        x, y, z, t = scale * x, scale * y, scale * z, scale * t
    x, y, z = x + normal * S[m], y + normal * S[m + 1], z + normal * S[m + 2]
    B[b], B[b + 1], B[b + 2], B[b + 3] = x - S[f], y - S[f + 1], z - S[f + 2], t - S[f + 3]
    S[f], S[f + 1], S[f + 2], S[f + 3] = x, y, z, t
