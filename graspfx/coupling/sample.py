"""One whole sample: contacts, split, eq. (4), cones, limits, reaction."""

from __future__ import annotations

from typing import Any

from graspfx.coupling import block as at
from graspfx.coupling.approach import AGAIN, approach, refactor, turn_axes
from graspfx.coupling.fade import compliance_of_numbers
from graspfx.coupling.gains import fill_gains
from graspfx.coupling.law import push
from graspfx.coupling.limit import forget_limits, limit
from graspfx.coupling.projection import attached, unilateral
from graspfx.coupling.rays import press
from graspfx.coupling.react import FINE, react
from graspfx.coupling.slip import move_anchors, rub
from graspfx.objects import integrators as body


def resplit(S: Any) -> None:
    """The split, if the gains need it, and the matrices of gains that are no numbers, where they have changed."""
    if S[at.MIXED] != 0.0:
        turn_axes(S)
    if S[at.EQUAL] == 0.0:
        refactor(S)
    if S[at.DENSE] != 0.0:
        fill_gains(S)


def respond(S: Any, again: bool) -> int:
    """Find the forces on the object. AGAIN, where `again` allows it, asks for the split anew."""
    if S[at.ATTACHED] != 0.0:
        return attached(S)
    if S[at.FRICTION] != 0.0:
        return rub(S)
    if S[at.RAYS] != 0.0:
        return press(S)
    return unilateral(S, again)


def sample(S: Any) -> int:
    """Motion in, forces and wrench out; returns FINE, or why every force is zero."""
    fault = couple(S)
    if S[at.LIMITS] != 0.0:
        fault = limit(S, fault)
    return conclude(S, fault)


def couple(S: Any) -> int:
    """Find the law's forces, from the motion; returns FINE or a fault."""
    fault = approach(S)
    passes = int(S[at.FINGERS])  # at worst the fingers lose their anchors one after another
    if fault == FINE:
        resplit(S)
        fault = respond(S, True)
    while fault == AGAIN:
        resplit(S)
        passes -= 1
        fault = respond(S, passes > 0)
    return fault


def conclude(S: Any, fault: int) -> int:
    """Give the object the wrench of the forces, or none after a fault; returns FINE, or why every force is zero."""
    if fault == FINE:
        if S[at.FRICTION] != 0.0:
            move_anchors(S)
        fault = react(S)
        if S[at.FADE] != 0.0 and S[at.EQUAL] == 0.0:
            check_fade(S)
        if S[at.TURNS] != 0.0 and S[at.EQUAL] == 0.0 and S[at.BLENDED] != 0.0:
            S[at.IN_BAND] += 1.0
    if fault != FINE:
        let_go(S)
    return fault


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
    if S[at.LIMITS] != 0.0:
        forget_limits(S)


def check_fade(S: Any) -> None:
    """Keep the largest shortfall of NEAR: below 1/2 |1/kep - 1/kip| sum |f| a fading finger can touch again."""
    release = S[at.RELEASE]
    if S[at.DENSE] == 0.0:
        release = compliance_of_numbers(S[at.EXTERNAL_STIFFNESS], S[at.INTERNAL_STIFFNESS])
    total = 0.0
    for i in range(int(S[at.FINGERS])):
        total += push(S, i, int(S[at.DIMENSIONS]))
    S[at.SHORTFALL] = max(S[at.SHORTFALL], release * total - S[at.NEAR])
